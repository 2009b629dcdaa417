"""A whole Sobol analysis of a case: inputs, design, runs, indices."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eclsim.sensitivity.case_inputs import CARDIOVASCULAR, OUTPUTS, InputError, varied
from eclsim.sensitivity.design import Design, DesignError
from eclsim.sensitivity.evaluation import Evaluated, Evaluator, SteadyBeatEvaluator, design_resolution
from eclsim.sensitivity.indices import Indices, indices_of
from eclsim.sensitivity.runner import Executor, Progress, run_blocks
from eclsim.sensitivity.store import Store

if TYPE_CHECKING:
    from eclsim.cases.case import Case


COPIES = 6
"""How often the points of a design and its results are held at a time, at most."""
SHARE_OF_MEMORY = 0.8


@dataclass(frozen=True)
class Analysis:
    """What is to be run: a design and what it is run on."""

    design: Design
    evaluator: Evaluator


@dataclass(frozen=True)
class Finished:
    """A finished analysis: its indices, and the runs they come from."""

    design: Design
    indices: Indices
    found: Evaluated

    @property
    def values(self) -> np.ndarray:
        """Outputs of all rows without a failed run, shape (rows, runs per row, outputs)."""
        rows = self.found.values.reshape(-1, self.design.runs_per_row, len(self.indices.outputs))
        return rows[(self.found.status == 0).reshape(len(rows), -1).all(axis=1)]


def plan_analysis(
    case: Case,
    *,
    samples: int = 2048,
    perturbation_percent: float = 25.0,
    parameters: Sequence[str] = CARDIOVASCULAR,
    include: Sequence[str] = (),
    groups: Sequence[str] = (),
    outputs: Sequence[str] | None = None,
    seed: int = 1,
    second_order: bool = True,
    policy: str | None = None,
    values: Mapping[str, float] | None = None,
) -> Analysis:
    """Inputs and design of an analysis, checked; nothing is run.

    Args:
        case: patient and devices.
        samples: N, a power of two.
        perturbation_percent: half width of the range of each number.
        parameters: names of the parameters varied.
        include: further inputs, such as `ecmo.speed_rpm`, `ecmo.drainage_fr`, `crrt.flow_ml_min`,
            `crrt.scheme`.
        groups: letters (R, C, L, E) whose parameters are one factor together.
        outputs: names of outputs; left out, the paper's seven, as far as the case has them.
        seed: of the design.
        second_order: N (2 F + 2) runs, else N (F + 2).
        policy: blood volume policy; left out, the case's.
        values: start values in place of the case's own.
    """
    from eclsim.orbit.model import model_of
    from eclsim.outputs.evaluation import output_names

    base = {**model_of(case).values, **(values or {})}
    chosen = varied(case, base, parameters, include, groups, perturbation_percent)
    available = output_names(chosen.circuit)
    names = tuple(o for o in OUTPUTS if o in available) if outputs is None else tuple(dict.fromkeys(outputs))
    _check_outputs(names, available)
    design = Design(chosen.inputs, samples, seed, chosen.groups, second_order)
    check_memory(design, len(names))
    resolution = design_resolution(chosen.circuit, chosen.base, design)
    evaluator = SteadyBeatEvaluator(
        chosen.circuit, chosen.base, names, policy or case.volume_policy, resolution, case.patient.id
    )
    return Analysis(design, evaluator)


def check_memory(design: Design, outputs: int) -> None:
    """Refuse a design whose points and results do not fit into this machine's memory.

    Raises:
        DesignError: With the largest number of rows that fits.
    """
    available = _memory_bytes()
    row = 8 * COPIES * (len(design.inputs) + outputs) * design.runs_per_row
    if available is None or row * design.samples <= SHARE_OF_MEMORY * available:
        return
    largest = 1 << max(int(SHARE_OF_MEMORY * available // row).bit_length() - 1, 1)
    raise DesignError(
        f"samples = {design.samples}: {design.evaluations:,} runs take about "
        f"{row * design.samples / 1e9:.0f} GB of memory, this machine has {available / 1e9:.0f} GB; "
        f"allowed here: up to {largest} rows"
    )


def _memory_bytes() -> float | None:
    """Memory of this machine; None where the system does not tell."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return None


def _check_outputs(names: Sequence[str], available: Sequence[str]) -> None:
    from eclsim.parameters import did_you_mean

    wrong = []
    for name in names:
        if name not in available:
            hint = did_you_mean(name, available)
            said = f"; did you mean {hint}?" if hint else f"; allowed: {', '.join(available)}"
            wrong.append(f"{name}: no output of this case{said}")
    if wrong:
        raise InputError(wrong)


def analyse(case: Case, **options: object) -> Finished:
    """Sobol indices of a case in one call; options are those of `plan_analysis`. Nothing is kept on disk."""
    plan = plan_analysis(case, **options)  # pyright: ignore[reportArgumentType]  # checked there
    with tempfile.TemporaryDirectory(prefix="eclsim-") as folder:
        store = Store.of(Path(folder), plan.design, plan.evaluator)
        store.open(resume=False)
        return run_analysis(plan, store)


def run_analysis(
    plan: Analysis,
    store: Store,
    *,
    until: float | None = None,
    execute: Executor | None = None,
    report: Callable[[Progress], None] | None = None,
) -> Finished:
    """Run what is missing, write the samples, estimate.

    Args:
        plan: design and evaluator.
        store: an open store of this analysis.
        until: stop at 64, 128, 256 ... rows once no total order is less certain than this (half width).
        execute: where blocks are run.
        report: called after every block.
    """
    started = time.perf_counter()
    whole = plan.design
    for rows in _stages(whole, until):
        blocks = range(rows // whole.rows_per_block)
        run_blocks(store, plan.evaluator, blocks, execute, report)
        found = store.load(blocks)
        finished = conclude(replace(whole, samples=rows), plan.evaluator.outputs, found)
        if until is not None and finished.indices.estimates.ST_conf.max() <= until:
            break
    store.finish(finished.found)
    seconds = time.perf_counter() - started
    return replace(finished, indices=replace(finished.indices, seconds=seconds))


def _stages(design: Design, until: float | None) -> list[int]:
    """Numbers of rows after which the intervals are looked at."""
    if until is None:
        return [design.samples]
    smallest = max(design.rows_per_block, 64)
    return [n for n in (design.samples >> k for k in range(20, -1, -1)) if n >= min(smallest, design.samples)]


def conclude(design: Design, outputs: tuple[str, ...], found: Evaluated) -> Finished:
    """Indices of the runs of a whole design."""
    return Finished(design, indices_of(design, outputs, found), found)
