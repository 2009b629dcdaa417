"""A whole Sobol analysis of a case: inputs, design, runs, indices.

The paper names three states but not their parameter values. Here the resistance of the systemic
microcirculation is changed until the mean arterial pressure is in the middle of the paper's own class:
hypotension below 65 mmHg, hypertension above 92 mmHg (section 3.2). Everything else keeps the values of the
case.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import TYPE_CHECKING

from eclsim.arguments import Kind, WholeNumber, check_fields, flag, number_of
from eclsim.execution import Distribution, Executor, Progress, Tasks, as_folder
from eclsim.execution.tasks import run_tasks
from eclsim.inputs.mistakes import as_names, as_settings
from eclsim.orbit.model import AS_PUBLISHED, CaseSource, Model, VolumePolicy, as_case, case_json, model_of
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch
from eclsim.outputs.results import beat_warnings
from eclsim.outputs.signals import output_names
from eclsim.outputs.steady_beat import steady_beat
from eclsim.sensitivity.design import Design, DesignError
from eclsim.sensitivity.inputs import (
    CARDIOVASCULAR,
    OUTPUTS,
    InputError,
    Range,
    missing_outputs,
    varied_inputs,
)
from eclsim.sensitivity.ranges import checked_ranges
from eclsim.sensitivity.results import NO_CENTRAL_BEAT, SensitivityResult, indices_of_runs
from eclsim.sensitivity.runs import (
    Analysis,
    Evaluator,
    SampleFolder,
    SteadyBeatEvaluator,
    design_resolution,
    status_message,
    status_word,
)
from eclsim.simulation.target_flow import with_speed

if TYPE_CHECKING:
    from eclsim.cases.case import Case

PRELOAD = ("scipy.stats", "eclsim.outputs.steady_beat", "eclsim.sensitivity.runs")
"""Modules that a worker imports before its first block."""
COPIES_IN_MEMORY = 6
"""Largest number of copies of the points of a design and its results that are in memory at a time."""
SHARE_OF_MEMORY = 0.8


@dataclass(frozen=True, kw_only=True)
class SobolSettings:
    """Settings of a Sobol analysis.

    Args:
        samples: N, rows of Saltelli's design, a power of two.
        perturbation_percent: half width of the range of each number that is not in `ranges`.
        ranges: own ranges of inputs in their units, `{"Rmc": (0.5, 1.5)}`; `(0.1, 10.0, "log")` is uniform
            in the logarithm. For a cannula the sizes sold within the range are equally likely.
        parameters: names of the varied parameters; None for the paper's 24 cardiovascular ones.
        include: further inputs, such as `ecmo.speed_rpm`, `ecmo.drainage_fr`, `crrt.flow_ml_min`,
            `crrt.scheme`.
        groups: letters (R, C, L, E) of the groups whose parameters are combined into one factor each.
        outputs: names of outputs; None for the paper's seven, as far as the case has them.
        seed: seed of the design and of the bootstrap intervals.
        second_order: whether second-order indices are computed: N (2 F + 2) runs for F factors, else N (F +
            2).
        volume_policy: blood volume policy; None for the case's.
        values: start values that replace the case's own.
        until: stop at 64, 128, 256 ... rows once every total order is certain to this half width (95 %).
    """

    samples: int = 2048
    perturbation_percent: float = 25.0
    ranges: Mapping[str, Range] | None = None
    parameters: Sequence[str] | None = None
    include: Sequence[str] = ()
    groups: Sequence[str] = ()
    outputs: Sequence[str] | None = None
    seed: int = 1
    second_order: bool = True
    volume_policy: VolumePolicy | None = None
    values: Mapping[str, float] | None = None
    until: float | None = None

    def __post_init__(self) -> None:
        for what in ("parameters", "include", "groups", "outputs"):
            if (names := getattr(self, what)) is not None:
                object.__setattr__(self, what, as_names(names, what))
        check_fields(
            self, samples=WholeNumber(None), perturbation_percent=number_of, seed=WholeNumber(None),
            second_order=flag, values=Kind(Mapping, 'numbers by parameter, such as {"Rmc": 0.8}'),
            until=number_of, ranges=checked_ranges,
        )  # fmt: skip


def sensitivity(
    case: CaseSource,
    *,
    settings: SobolSettings | None = None,
    folder: str | os.PathLike[str] | None = None,
    distribution: Distribution | Executor | None = None,
    progress: Progress | None = None,
) -> SensitivityResult:
    """Compute Sobol indices of a case: the dependence of outputs [mmHg, L/min] on its parameters.

    Args:
        case: path of a case file, what `read_case` returned, or a case.
        settings: inputs, their ranges, and number of samples.
        folder: folder that stores the runs, block by block; None keeps them in memory only.
        distribution: where the blocks run, and whether blocks in the folder are reused.
        progress: called after every block.

    Raises:
        InputError: The case cannot have these names or ranges.
        UnknownValueError: The case does not use a start value of `values`.
        DesignError: The design is impossible or does not fit into memory.
        ExecutionError: The folder holds something else, or workers cannot be reached.
        ShardDone: This run computed one shard only; its runs are in the folder.
        ValueError: Hardly any row is free of failed runs.
        TypeError: The argument is no case, or the settings are no `SobolSettings`.
    """
    settings = as_settings(settings, SobolSettings)
    folder = as_folder(folder)
    with ExitStack() as stack:
        if not isinstance(distribution, Executor):
            chosen = as_settings(distribution, Distribution, "distribution")
            distribution = stack.enter_context(chosen.running(PRELOAD))
        case = with_speed(as_case(case), settings.volume_policy)[0]
        plan, model = plan_analysis(case, settings), model_of(case)
        around = replace(model, values={**model.values, **(settings.values or {})})
        measured = None if settings.values else case
        warnings = beat_warnings(around, settings.volume_policy, plan.evaluator.outputs, measured)
        central = missing_central_beat(plan.evaluator)
        plan = replace(plan, warnings=(*central, *plan.warnings, *warnings))
        place = stack.enter_context(TemporaryDirectory(prefix="eclsim-")) if folder is None else folder
        result = run_analysis(plan, Path(place), distribution, until=settings.until, progress=progress)
        return replace(result, case_json=case_json(case, settings.volume_policy))


def missing_central_beat(evaluator: Evaluator) -> tuple[str, ...]:
    """A sentence if the case itself, around which the inputs vary, ends without a result; else none."""
    status = int(evaluator({}, 1).status[0])
    if not status:
        return ()
    why = "valves of the heart stay shut, so its beat is one of many"
    if status != Status.ONE_OF_MANY:
        why = status_message(status)
    return (f"{NO_CENTRAL_BEAT} ({status_word(status)}: {why})",)


def plan_analysis(case: Case, settings: SobolSettings) -> Analysis:
    """Return the checked inputs and design of an analysis; nothing is run."""
    s = settings
    if s.until is not None and not 0.0 < s.until < math.inf:
        raise InputError([f"until = {s.until:g}: allowed: above 0, such as 0.02"])
    base = dict(model_of(case).with_values(s.values).values)
    parameters = CARDIOVASCULAR if s.parameters is None else s.parameters
    chosen = varied_inputs(case, base, parameters, s.include, s.groups, s.perturbation_percent, s.ranges)
    available = output_names(chosen.circuit)
    usual = [o for o in OUTPUTS if o in available]
    outputs = tuple(dict.fromkeys(usual if s.outputs is None else s.outputs))
    if wrong := missing_outputs(outputs, available) or ["no output given"] * (not outputs):
        raise InputError(wrong)
    design = Design(chosen.inputs, s.samples, s.seed, chosen.groups, s.second_order)
    check_memory(design, len(outputs))
    resolution = design_resolution(chosen.circuit, chosen.base, design)
    policy = s.volume_policy or case.volume_policy
    evaluator = SteadyBeatEvaluator(
        chosen.circuit, chosen.base, outputs, policy, case.patient.id, resolution=resolution
    )
    return Analysis(design, evaluator, chosen.warnings)


def check_memory(design: Design, outputs: int) -> None:
    """Raise an error for a design whose points and results do not fit into this machine's memory.

    Raises:
        DesignError: The design is too large; the message gives the largest number of rows that fits.
    """
    available = _memory_bytes()
    row = 8 * COPIES_IN_MEMORY * (len(design.inputs) + outputs) * design.runs_per_row
    if available is None or row * design.samples <= SHARE_OF_MEMORY * available:
        return
    largest = 1 << max(int(SHARE_OF_MEMORY * available // row).bit_length() - 1, 1)
    raise DesignError(
        f"samples = {design.samples}: {design.evaluations:,} runs take about "
        f"{row * design.samples / 1e9:.0f} GB of memory, this machine has {available / 1e9:.0f} GB; "
        f"allowed here: up to {largest} rows"
    )


def _memory_bytes() -> float | None:
    """Memory of this machine [bytes]; None if the system does not report it."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return None


def run_analysis(
    plan: Analysis,
    folder: Path,
    executor: Executor,
    *,
    until: float | None = None,
    progress: Progress | None = None,
) -> SensitivityResult:
    """Run missing blocks, write the samples, estimate; a shard ends after its runs with `ShardDone`.

    Args:
        plan: design and evaluator.
        folder: folder that stores the runs.
        executor: runs the blocks.
        until: stop at 64, 128, 256 ... rows once no total order is less certain than this (half width).
        progress: called after every block.
    """
    started = time.perf_counter()
    store, design = plan.folder(folder), plan.design
    store.open(executor)
    earlier = store.finished()
    executor.run_shard(plan.tasks, store, folder, progress)
    for rows in _stages(design, until):
        blocks = range(rows // design.rows_per_block)
        run_tasks(plan.tasks, store, blocks, executor.run, progress)
        part, runs = replace(design, samples=rows), store.load(blocks)
        result = indices_of_runs(part, plan.evaluator.outputs, runs, plan.warnings)
        certain = until is not None and result.indices.estimates.ST_conf.max() <= until
        if certain and result.indices.ranked:
            break
    store.finish(result.runs)
    seconds = time.perf_counter() - started
    stored = len(earlier & set(blocks)) * design.rows_per_block * design.runs_per_row
    known = replace(result.indices, seconds=seconds, warnings=plan.warnings, until=until, stored=stored)
    return replace(result, indices=known)


def merge_shards(folder: Path, shards: int | None = None) -> SensitivityResult:
    """Finish the analysis whose shards a folder holds, without its case.

    Args:
        folder: folder of the shards.
        shards: their number, to name those that are missing.

    Raises:
        ExecutionError: A shard is missing, or the folder holds no analysis.
    """
    store = SampleFolder.of_folder(folder)
    with Distribution(merge=True, merged_shards=shards).running() as executor:
        blocks = range(store.design.blocks)
        tasks = Tasks("sensitivity", "blocks", store.blocks.load, blocks)
        run_tasks(tasks, store, blocks, executor.run)
        result = indices_of_runs(store.design, store.outputs, store.load(blocks), store.warnings)
        store.finish(result.runs)
    return replace(result, indices=replace(result.indices, warnings=store.warnings))


def _stages(design: Design, until: float | None) -> list[int]:
    """Numbers of rows after which the intervals are checked."""
    if until is None:
        return [design.samples]
    smallest = min(max(design.rows_per_block, 64), design.samples)
    return [n for n in (design.samples >> k for k in range(20, -1, -1)) if n >= smallest]


# --- start values of a normal, a hypertensive and a hypotensive patient -----------------------------


TARGETS: MappingProxyType[str, float] = MappingProxyType(
    {"normal": 79.0, "hypertensive": 102.0, "hypotensive": 60.0}
)
"""Mean arterial pressure of each state [mmHg]: the cohort's median (Table 1); the middle between 92
and the cohort's 113; the middle between the cohort's 55 and 65."""

ADJUSTED = "Rmc"
_LARGEST_FACTOR = 32.0


class StateError(ValueError):
    """Raised if the case cannot reach a state, or the search met a patient without a steady beat."""


def state_values(model: Model, state: str, policy: str = AS_PUBLISHED) -> dict[str, float]:
    """Return the values that bring a model into a state: the resistance of the systemic microcirculation.

    The resistance [mmHg s/mL] gives the mean arterial pressure of `TARGETS`, to 0.001 mmHg.

    Raises:
        StateError: The pressure is not reached, or a beat during the search did not settle.
    """
    if state not in TARGETS:
        raise StateError(f"state {state}: allowed: {', '.join(TARGETS)}")
    from scipy.optimize import brentq

    target = TARGETS[state]

    def excess(log_factor: float) -> float:
        tried = model.with_values({ADJUSTED: model.values[ADJUSTED] * math.exp(log_factor)})
        return _mean_arterial_pressure(tried, policy) - target

    low, high = _bracket(excess)
    if low is None or high is None:
        limits = f"{ADJUSTED} / {_LARGEST_FACTOR:g} to {ADJUSTED} x {_LARGEST_FACTOR:g}"
        raise StateError(f"a mean arterial pressure of {target:g} mmHg: not reached from {limits}")
    root = brentq(excess, low, high, xtol=1e-6)
    return {ADJUSTED: model.values[ADJUSTED] * math.exp(float(root))}  # pyright: ignore[reportArgumentType]  # a number


def _bracket(excess: Callable[[float], float]) -> tuple[float | None, float | None]:
    """Find neighbouring powers of two of the scaling factor between which the pressure crosses its target."""
    excess_here, step = excess(0.0), math.log(2.0)
    direction = -1.0 if excess_here > 0.0 else 1.0
    log_factor = 0.0
    while abs(log_factor) < math.log(_LARGEST_FACTOR):
        following = log_factor + direction * step
        excess_next = excess(following)
        if excess_here * excess_next <= 0.0:
            return min(log_factor, following), max(log_factor, following)
        log_factor, excess_here = following, excess_next
    return None, None


def _mean_arterial_pressure(model: Model, policy: str) -> float:
    """Mean arterial pressure of the steady beat [mmHg]; raises `StateError` if there is none."""
    beat = steady_beat(Batch.of(model, policy), ("MAP",))
    if not beat.determined[0]:
        raise StateError(
            f"at {ADJUSTED} = {model.values[ADJUSTED]:.4g}, on the way to the target mean arterial "
            f"pressure, there is no steady beat ({Status(int(beat.status[0])).word}): {beat.message()}"
        )
    return float(beat.output("MAP")[0])
