"""Robustness: a steady beat anywhere in the bounds of parameter identification, in seven configurations.

The seven fitted parameters are varied over their bounds (a tenth to ten times the start value) by a Sobol
sequence on a logarithmic scale. Some of these hearts do not eject; they must be reported as such and not
appear steady by chance. Beats reported as converged are continued for ten more beats without the solver.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial, reduce
from pathlib import Path
from typing import TypeVar

import numpy as np

from eclsim.cases.sections import Physiology
from eclsim.circuit.assembly import assemble
from eclsim.execution import Executor, Format, Progress, Tasks, complete_in, json_format
from eclsim.orbit.model import Model, model_of
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, SolvedOrbits, start_state
from eclsim.outputs.results import simulate
from eclsim.outputs.steady_beat import left_outputs, measured, steady_beat
from eclsim.paper.comparison import Check, Row, at_least, at_most
from eclsim.parameters.thiel2025 import BOUNDS
from eclsim.validation.reference_cases import PROTOCOLS, reference_case, with_devices_of

Argument = TypeVar("Argument")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Effort:
    """Extent of the validation, and where it is computed.

    Args:
        quick: whether to use one case for each kind of circuit instead of all cases.
        points: number of points of the robustness sweep in each configuration.
        executor: executor of the sweeps.
        folder: folder that stores their results; None keeps them in memory only.
        progress: called when a task is done.
    """

    quick: bool = False
    points: int = 512
    executor: Executor = field(default_factory=Executor)
    folder: Path | None = None
    progress: Progress | None = None

    def complete(self, tasks: Tasks[Argument, Result], format: Format[Result]) -> list[Result]:
        """Return the results of the tasks of a sweep, stored in a separate folder."""
        return complete_in(self.folder, tasks.title, tasks, format, self.executor, self.progress)


# --- the sweep --------------------------------------------------------------------------------------


CONFIGURATIONS: dict[str, list[str]] = PROTOCOLS["configurations"]
"""Configurations, with the reference cases that give patient and devices."""

EJECTING_L_MIN = 0.1
"""Native output from which on a steady beat must be found [L/min]."""
RECHECK_BEATS = 10
RECHECK_TOLERANCE = 1e-6
"""Largest change of a state over the further beats, relative to max(|state|, 1)."""
SETTLING_BEATS = 400
"""Number of plain beats from the published start that determine the native output without a steady beat."""
SEED = 2025
CHUNK = 512
"""Number of points of a configuration solved side by side, which is one task of the sweep."""
SWEPT = ("status", "output", "drift", "beats", "moved")
NEEDED_SHARE = 0.999
NAMED = 5
"""Number of points of a configuration that are examined individually."""


@dataclass(frozen=True)
class Sweep:
    """Results of one configuration as arrays over the points.

    Args:
        name: name of the configuration.
        values: the seven parameters of every point, by name.
        status: `Status` of every point.
        output: output of the left heart and an LVAD to the arteries [L/min]; without a steady beat, that of
            the last of `SETTLING_BEATS` plain beats.
        drift: largest change of a volume over the same beat [mL].
        beats: number of beats computed by the solver.
        moved: largest relative change of a state over ten more beats; NaN without a steady beat.
    """

    name: str
    values: dict[str, np.ndarray] = field(repr=False)
    status: np.ndarray
    output: np.ndarray
    drift: np.ndarray
    beats: np.ndarray
    moved: np.ndarray

    @property
    def converged(self) -> np.ndarray:
        """Whether a steady beat was found, for each point."""
        return (self.status == Status.CONVERGED) | (self.status == Status.ONE_OF_MANY)

    @property
    def ejecting(self) -> np.ndarray:
        """Whether the native output is large enough for a steady beat to be required."""
        return self.output > EJECTING_L_MIN

    @property
    def false_converged(self) -> np.ndarray:
        """Whether a beat was reported as converged but is not steady."""
        return self.converged & ~(self.moved <= RECHECK_TOLERANCE)

    @property
    def silent_nan(self) -> np.ndarray:
        """Whether a number is not finite although the status does not report it."""
        return (self.status != Status.NOT_FINITE) & ~np.isfinite(self.output)


def sobol_points(count: int) -> dict[str, np.ndarray]:
    """Values of the seven parameters, logarithmically spread over their bounds."""
    from scipy.stats import qmc

    exponent = int(np.ceil(np.log2(count)))
    sequence = qmc.Sobol(d=len(BOUNDS), scramble=True, seed=SEED)  # pyright: ignore[reportCallIssue]  # old name
    unit = sequence.random_base2(exponent)[:count]
    lower, upper = (np.log([getattr(b, end) for b in BOUNDS.values()]) for end in ("lower", "upper"))
    return dict(zip(BOUNDS, np.exp(lower + unit * (upper - lower)).T, strict=True))


def configuration_model(name: str) -> Model:
    """Circuit and values of a configuration; the fitted parameters are replaced later."""
    case = reduce(with_devices_of, map(reference_case, CONFIGURATIONS[name]))
    if beyond := PROTOCOLS["physiology"].get(name):
        case = case.model_copy(update={Physiology.section: Physiology(**beyond)})
    return model_of(case)


def sweep(name: str, points: dict[str, np.ndarray]) -> Sweep:
    """Solve a configuration at some points of the bounds."""
    model, count = configuration_model(name), len(next(iter(points.values())))
    beat = steady_beat(Batch(model.circuit, {**model.values, **points}, count), left_outputs(model.circuit))
    orbits, output = beat.orbits, beat.values.sum(axis=0)
    drift, moved = orbits.drift.copy(), np.full(count, np.nan)
    settled, unsettled = np.flatnonzero(beat.converged), np.flatnonzero(~beat.converged)
    start = orbits.states[:, settled]
    least = assemble(model.circuit).layout.smallest_sizes[:, None]
    change = np.abs(orbits.wait(settled, start, RECHECK_BEATS) - start)
    moved[settled] = (change / np.maximum(np.abs(start), least)).max(axis=0, initial=0.0)
    if len(unsettled):
        output[unsettled], drift[unsettled] = _after_waiting(model, orbits, unsettled)
    return Sweep(name, points, beat.status, output, drift, orbits.beats, moved)


Chunk = tuple[str, int, int]
"""A configuration, the index of its first point, and the index after its last one."""


def sweep_chunk(count: int, chunk: Chunk) -> dict[str, list[float]]:
    """Solve some of the `count` points of a configuration, and return the arrays of the sweep by name."""
    name, first, last = chunk
    points = {parameter: values[first:last] for parameter, values in sobol_points(count).items()}
    done = sweep(name, points)
    return {field: getattr(done, field).tolist() for field in SWEPT}


def sweeps(count: int, effort: Effort) -> list[Sweep]:
    """Solve all configurations at `count` points of the bounds."""
    chunks = [
        (name, first, min(first + CHUNK, count))
        for name in CONFIGURATIONS
        for first in range(0, count, CHUNK)
    ]
    inputs = {"points": count, "chunks": chunks, "seed": SEED}
    tasks = Tasks("robustness", "chunks of points", partial(sweep_chunk, count), chunks, inputs)
    results = effort.complete(tasks, json_format(dict[str, list[float]]))
    points = sobol_points(count)
    results_by_name = []
    for name in CONFIGURATIONS:
        pieces = [result for chunk, result in zip(chunks, results, strict=True) if chunk[0] == name]
        arrays = {field: np.concatenate([result[field] for result in pieces]) for field in SWEPT}
        arrays |= {field: arrays[field].astype(int) for field in ("status", "beats")}
        results_by_name.append(Sweep(name, points, **arrays))
    return results_by_name


def _after_waiting(model: Model, orbits: SolvedOrbits, members: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Left output [L/min] and drift [mL per beat] after many plain beats from the published start."""
    starts = [start_state(replace(model, values=orbits.batch.member(int(k)))) for k in members]
    before = orbits.wait(members, np.stack(starts, axis=1), SETTLING_BEATS)
    after = orbits.wait(members, before)
    drift = np.abs(after - before)[assemble(model.circuit).layout.volumes.where].max(axis=0)
    states = orbits.states.copy()
    states[:, members] = before
    taken_as_steady = replace(orbits, states=states, status=np.full(len(orbits.status), Status.CONVERGED))
    output = measured(taken_as_steady, left_outputs(model.circuit), (), ()).values.sum(axis=0)
    return output[members], drift


def checks(effort: Effort) -> list[Check]:
    """Check all configurations; points without a steady beat are listed with their drift."""
    rows: list[Row] = []
    remarks: list[str] = []
    points = effort.points
    for swept in sweeps(points, effort):
        rows += _rows(swept)
        remarks += _remarks(swept)
    title = f"Robustness: {points} Sobol points of the fit bounds x {len(CONFIGURATIONS)} configurations"
    bar = "99.9 % of those with a native output above 0.1 L/min converge; none falsely, none silently"
    return [Check("robustness", title, bar, tuple(rows), remarks=tuple(remarks))]


def _rows(sweep: Sweep) -> list[Row]:
    ejecting, settled = sweep.ejecting, sweep.converged
    share = float((ejecting & settled).sum() / max(ejecting.sum(), 1))
    recognised = _named(sweep)
    return [
        at_least(f"{sweep.name}: share of {ejecting.sum()} ejecting that converge", share, NEEDED_SHARE),
        at_most(f"{sweep.name}: called converged and not steady", float(sweep.false_converged.sum()), 0.0),
        at_most(
            f"{sweep.name}: largest change over 10 more beats", np.nanmax(sweep.moved), RECHECK_TOLERANCE
        ),
        at_most(f"{sweep.name}: number that is not finite, unsaid", float(sweep.silent_nan.sum()), 0.0),
        at_most(
            f"{sweep.name}: not steady and not named NO_EJECTION",
            float(recognised.size - recognised.sum()),
            0.0,
        ),
    ]


def _named(sweep: Sweep) -> np.ndarray:
    """Whether `simulate` reports the first few points without ejection and steady beat correctly.

    With almost no flow the equation is nearly singular. A point may be solved individually although it was
    not in the batch, whose program rounds differently.
    """
    still = np.flatnonzero(~sweep.converged & ~sweep.ejecting)[:NAMED]
    model = configuration_model(sweep.name)
    results = (simulate(model.with_values({n: float(v[k]) for n, v in sweep.values.items()})) for k in still)
    names = ("no_ejection", "converged", "one_of_many")
    return np.array([result.attrs["status"] in names for result in results], dtype=bool)


def _remarks(sweep: Sweep) -> list[str]:
    settled = sweep.converged
    beats = sweep.beats[settled]
    sentences = [
        f"{sweep.name}: {settled.sum()} of {settled.size} steady, median {np.median(beats):.0f} beats, "
        f"largest {beats.max()}"
    ]
    unsettled = np.flatnonzero(~settled)
    if len(unsettled):
        sentences.append(
            f"{sweep.name}: {len(unsettled)} without a steady beat; after {SETTLING_BEATS} plain beats the "
            f"native output is at most {sweep.output[unsettled].max():.2g} L/min, their drift at most "
            f"{sweep.drift[unsettled].max():.2g} mL a beat"
        )
    failed = np.flatnonzero(sweep.ejecting & ~settled)
    for k in failed[:NAMED]:
        point = ", ".join(f"{name} {value[k]:.4g}" for name, value in sweep.values.items())
        sentences.append(f"{sweep.name}: ejects {sweep.output[k]:.2f} L/min and is not steady: {point}")
    return sentences
