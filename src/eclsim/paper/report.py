"""Files of the comparison with the paper: an HTML page, CSV, JSON, and every figure and table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.crrt_study.report import drawings as crrt_drawings
from eclsim.files import csv_text, json_text, write_texts
from eclsim.orbit.model import model_of
from eclsim.paper.comparison import YES_NO, Row, Verdict
from eclsim.paper.printed import TABLE_2
from eclsim.paper.reproduction import INDEX, Item, Reproduction, items_of
from eclsim.reporting.html import Table, render, svg_text
from eclsim.reporting.numbers import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from eclsim.crrt_study.study import CrrtStudy
    from eclsim.paper.cohort import CohortComparison
    from eclsim.sensitivity.results import SensitivityResult

CHAPTERS = (
    ("Data and sensitivity of the circulation (sections 2.1, 2.3, 3.1)", ("2.", "3.1", "Table 2"),
     ("Figure 1", "Figure 3", "Figure S-1", "Figure S-3", "Figure S-4")),
    ("Fits of a cohort (section 3.2)", ("3.2", "Table 1"), ("Figure 4", "Figure S-2")),
    ("The nine CRRT schemes (section 3.3)", ("3.3, 3425", "3.3, 1.2", "3.3, 6", "3.3"),
     ("Figure 2", "Figure 5", "Figure 6")),
    ("Positions of the CRRT lines as inputs (section 3.3)", ("3.3, Figure",),
     ("Figure 7", "Figure S-5", "Figure S-6", "Figure S-7")),
    ("Discussion: other studies, limits, interactions (section 4)", ("4",), ()),
)  # fmt: skip
PAGE_HEAD = ("Quantity", "Paper", "Ours", "Difference", "Explained", "Unit", "Verdict")
CSV_HEAD = (
    "section", "quantity", "unit", "paper", "ours", "difference", "difference_percent", "explained",
    "tolerance", "verdict", "why",
)  # fmt: skip


def write_reproduction(
    result: Reproduction, folder: Path, progress: Callable[[str], None] = lambda _: None
) -> list[Path]:
    """Write all files to a folder, which is created if necessary, and return their paths."""
    drawn = draw_figures(result, progress)
    texts = {
        INDEX: reproduction_page(result, drawn),
        "reproduction.csv": _rows_csv(result.rows),
        "reproduction.json": json_text(as_object(result)),
    }
    for item in items_of(result.parts):
        texts |= dict(
            zip(item.files, drawn.get(item.key) or [_rows_csv(table_rows(item, result))], strict=True)
        )
    return write_texts(folder, texts)


def as_object(result: Reproduction) -> dict[str, object]:
    """The comparison as plain data."""
    unprinted = result.crrt.unprinted
    return {
        "parts": list(result.parts),
        "samples": None if result.sensitivity is None else result.sensitivity.samples,
        "synthetic_cohort": None if result.cohort is None else result.cohort.synthetic,
        "unstated_patient": {
            "blood_volume_ml": unprinted.blood_volume_ml,
            "heart_rate_bpm": unprinted.heart_rate_bpm,
            "misfit": unprinted.misfit,
            "misfit_as_assumed": unprinted.assumed_misfit,
        },
        "rows": [_values(row) for row in (*result.rows, *result.tables)],
    }


def _values(row: Row) -> dict[str, object]:
    values = (
        row.source, row.name, row.unit, row.expected, row.got, row.difference, row.percent, row.got_explained,
        None if row.expected is None else row.high - row.expected, str(row.verdict), row.reason,
    )  # fmt: skip
    return dict(zip(CSV_HEAD, values, strict=True))


def _rows_csv(rows: Sequence[Row]) -> str:
    return csv_text(CSV_HEAD, (_values(row).values() for row in rows), digits=None)


# --- the page -------------------------------------------------------------------------------------


def reproduction_page(result: Reproduction, drawn: Mapping[str, Sequence[str]]) -> str:
    """Return the page, given the figures as SVG text by key."""
    items = items_of(result.parts)
    return render(
        "paper/report.html",
        title="The paper, recomputed",
        counts=counts(result.rows),
        result=result,
        patient=result.crrt.study.case.patient,
        unstated=result.crrt.unprinted,
        items=items,
        chapters=[c for name, _, numbers in CHAPTERS if (c := _chapter(result, name, numbers, drawn))],
        tables=[
            (item, sum(row.holds for row in rows), _parameter_table(rows))
            for item in items
            if item.kind == "Table" and (rows := table_rows(item, result))
        ],
    )


def counts(rows: Sequence[Row]) -> str:
    """One sentence on how many numbers agree."""
    result = Counter(row.verdict for row in rows)
    return (
        f"{result[Verdict.AGREES]} of {len(rows)} printed numbers and statements come out as printed, "
        f"{result[Verdict.EXPLAINED]} more do once values that the paper does not state are filled in, "
        f"{result[Verdict.OTHER_DATA]} were measured on other patients or circuits, "
        f"{result[Verdict.DIFFERS]} differ"
    )


def _chapter(
    result: Reproduction, title: str, numbers: Sequence[str], drawn: Mapping[str, Sequence[str]]
) -> dict[str, object] | None:
    """Return a chapter with its figures and rows; None if no part of it was computed."""
    rows = [row for row in result.rows if chapter_of(row) == title]
    items = [item for item in items_of(result.parts) if item.title in numbers and item.drawings]
    if not rows and not items:
        return None
    sections = dict.fromkeys(row.source for row in rows)
    return {
        "title": title,
        "figures": [(item, _captioned(item, drawn[item.key])) for item in items],
        "counts": counts(rows),
        "sections": [
            (name if name.startswith("Table") else f"Section {name}",
             Table(PAGE_HEAD, [_cells(row) for row in rows if row.source == name], numeric=(1, 2, 3, 4)))
            for name in sections
        ],
    }  # fmt: skip


def _captioned(item: Item, svgs: Sequence[str]) -> list[tuple[str, str]]:
    letters = [f" ({'abcdefgh'[k]}, {name})" if len(svgs) > 1 else "" for k, name in enumerate(item.drawings)]
    return [(svg, f"{item.title}{part}: {item.caption}.") for svg, part in zip(svgs, letters, strict=True)]


def chapter_of(row: Row) -> str:
    """Chapter of a row: the one with the longest prefix of the row's section."""
    starts = ((start, title) for title, starts, _ in CHAPTERS for start in starts)
    return max((len(start), title) for start, title in starts if row.source.startswith(start))[1]


def _cells(row: Row) -> list[str]:
    verdict = f"{row.verdict}: {row.reason}" if row.reason else str(row.verdict)
    if row.unit == YES_NO:
        values = (row.expected, row.got, row.got_explained)
        paper, ours, explained = ("" if v is None else "yes" if v else "no" for v in values)
        return [row.name, paper, ours, "", explained, "", verdict]
    more = row.decimals + (row.unit != "1" or row.decimals > 0)
    paper, ours = number(row.expected, row.decimals), number(row.got, more)
    explained = number(row.got_explained, more, missing="")
    unit = "" if row.unit == "1" else row.unit
    return [row.name, paper, ours, f"{number(row.percent, 1)} %", explained, unit, verdict]


def _parameter_table(rows: Sequence[Row]) -> Table:
    cells = [[row.name, f"{row.expected:g}", f"{row.got:.4g}", row.unit, row.verdict] for row in rows]
    return Table(["Parameter", "Paper", "Ours", "Unit", "Verdict"], cells, numeric=(1, 2))


def table_rows(item: Item, result: Reproduction) -> list[Row]:
    """Rows of a numbered table."""
    return [row for row in (*result.rows, *result.tables) if row.source == item.title]


# --- the figures ----------------------------------------------------------------------------------


def draw_figures(
    result: Reproduction, progress: Callable[[str], None] = lambda _: None
) -> dict[str, tuple[str, ...]]:
    """SVG text of every figure, by key."""
    study, drawings = crrt_drawings(result.crrt.explained), {}
    for item in items_of(result.parts):
        if not item.drawings:
            continue
        progress(f"drawing {item.title}")
        if item.drawings[0] in study and item.part == "crrt":
            drawings[item.key] = (study[item.drawings[0]],)
        else:
            drawings[item.key] = tuple(svg_text(_figure(item.part, name, result)) for name in item.drawings)
    return drawings


def _figure(part: str, name: str, result: Reproduction) -> Figure:
    if part == "cohort" and result.cohort is not None:
        return _cohort_figure(name, result.cohort)
    if part == "sensitivity" and result.sensitivity is not None:
        return _sobol_figure(name, result.sensitivity.shown)
    if part == "positions" and result.positions is not None:
        return _sobol_figure(name, _readable(result.positions.shown))
    return _circuit(result.crrt.explained)


_FACTORS = {
    "crrt.access_site": "access\nposition", "crrt.return_site": "return\nposition",
    "ecmo.speed_rpm": "pump\nspeed",
    "R": "resis-\ntances", "C": "compli-\nances", "L": "inert-\nances", "E": "elas-\ntances",
}  # fmt: skip


def _readable(finished: SensitivityResult) -> SensitivityResult:
    """Return the analysis with factor names that fit under a column."""
    labels = tuple(_FACTORS.get(name, name) for name in finished.indices.factors)
    return replace(finished, indices=replace(finished.indices, factors=labels))


def _sobol_figure(name: str, finished: SensitivityResult) -> Figure:
    from eclsim.sensitivity import figures

    match name:
        case "total":
            return figures.plot_heat_map(finished.indices, "ST", "paper")
        case "difference":
            return figures.plot_heat_map(finished.indices, "ST-S1")
        case "sums":
            return figures.plot_sums(finished.indices, TABLE_2)
        case "distributions":
            return figures.plot_distributions(finished.indices, finished.values)
    return figures.plot_convergence(finished.convergence)


def _cohort_figure(name: str, cohort: CohortComparison) -> Figure:
    from eclsim.identification import figures

    if name == "scatter":
        return figures.plot_scatter(cohort.results, cohort.r2)
    if name == "boxes":
        return figures.plot_boxes(cohort.results)
    return figures.plot_slices(cohort.slices)


def _circuit(study: CrrtStudy) -> Figure:
    """Draw patient, ECMO and CRRT with the means of the case, which is connected as in scheme g."""
    from eclsim.reporting.schematic import draw_circuit
    from eclsim.simulation.single import simulate

    return draw_circuit(model_of(study.case).circuit, simulate(study.case))
