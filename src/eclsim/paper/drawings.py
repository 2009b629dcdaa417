"""The figures of the comparison with the paper as SVG text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from eclsim.crrt_study.drawings import drawings as crrt_drawings
from eclsim.paper.names import Item, items_of
from eclsim.reporting.html import svg_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from eclsim.crrt_study.study import CrrtStudy
    from eclsim.paper.cohort import CohortPart
    from eclsim.paper.reproduction import Reproduction
    from eclsim.sensitivity.results import SensitivityResult


def drawings(
    result: Reproduction, progress: Callable[[str], None] = lambda _: None
) -> dict[str, tuple[str, ...]]:
    """SVG text of every figure, by key."""
    found: dict[str, tuple[str, ...]] = {}
    made = crrt_drawings(result.crrt.explained)
    for item in items_of(result.parts):
        if not item.drawings:
            continue
        progress(f"drawing {item.title}")
        if item.part == "crrt":
            found[item.key] = (
                made[name] if (name := item.drawings[0]) in made else _circuit(result.crrt.explained),
            )
        else:
            found[item.key] = tuple(svg_text(draw()) for draw in _of(item, result))
    return found


def _of(item: Item, result: Reproduction) -> list[Callable[[], Figure]]:
    if item.part == "cohort" and result.cohort is not None:
        return [_cohort_figure(name, result.cohort) for name in item.drawings]
    if item.part == "sensitivity" and result.sensitivity is not None:
        return [_sobol_figure(name, result.sensitivity.average) for name in item.drawings]
    if item.part == "positions" and result.positions is not None:
        return [_sobol_figure(name, _named(result.positions.designed)) for name in item.drawings]
    return []


_WORDS = {
    "crrt.access_site": "access\nposition", "crrt.return_site": "return\nposition",
    "ecmo.speed_rpm": "pump\nspeed",
    "R": "resis-\ntances", "C": "compli-\nances", "L": "inert-\nances", "E": "elas-\ntances",
}  # fmt: skip


def _named(finished: SensitivityResult) -> SensitivityResult:
    """The analysis with its factors in words that fit under a column."""
    words = tuple(_WORDS.get(name, name) for name in finished.indices.factors)
    return replace(finished, indices=replace(finished.indices, factors=words))


def _sobol_figure(name: str, finished: SensitivityResult) -> Callable[[], Figure]:
    from eclsim.paper.sensitivity import TABLE_2
    from eclsim.sensitivity import figures

    return {
        "total": lambda: figures.plot_heat_map(finished.indices, "ST", "paper"),
        "difference": lambda: figures.plot_heat_map(finished.indices, "ST-S1"),
        "sums": lambda: figures.plot_sums(finished.indices, TABLE_2),
        "distributions": lambda: figures.plot_distributions(finished.indices, finished.values),
        "convergence": lambda: figures.plot_convergence(finished.convergence),
    }[name]


def _cohort_figure(name: str, part: CohortPart) -> Callable[[], Figure]:
    from eclsim.identification import search_figures as figures
    from eclsim.parameters.thiel2025 import PARAMETERS

    units = {n: PARAMETERS[n].unit for n in part.slices.names}
    return {
        "scatter": lambda: figures.plot_scatter(part.results, part.r2),
        "boxes": lambda: figures.plot_boxes(part.results),
        "slices": lambda: figures.plot_slices(part.slices, units),
    }[name]


def _circuit(study: CrrtStudy) -> str:
    """Patient, ECMO and CRRT with the means of the case, which is connected as in scheme g."""
    from eclsim.orbit.model import model_of
    from eclsim.reporting.schematic import draw_circuit
    from eclsim.simulation.single import simulate_case

    return svg_text(draw_circuit(model_of(study.case).circuit, simulate_case(study.case)))
