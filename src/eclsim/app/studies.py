"""Studies beyond one beat: the speed ramp and the nine schemes, each as one batch, and 90 % bands.

The members of a posterior are solved in blocks, one block after another in one thread, so that a processor
remains free for the knobs. Between blocks, the computation stops if its result is no longer needed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.app.beat import page_circuit
from eclsim.app.display import curves_of, plain_curves, sweep_of, waves_of
from eclsim.app.state import key_of
from eclsim.beat.grid import needed_resolution
from eclsim.beat.heartbeat import beat_program
from eclsim.circuit.assembly import assemble
from eclsim.files import finite
from eclsim.identification.density import DENSITY_OPTIONS
from eclsim.orbit.execution import SIDE_BY_SIDE, Execution
from eclsim.orbit.steady import Batch
from eclsim.outputs.alarms import impossible, stays_closed
from eclsim.outputs.limits import limits_of
from eclsim.outputs.signals import output_names, watched_waveforms
from eclsim.outputs.steady_beat import steady_beat

if TYPE_CHECKING:
    from eclsim.app.posterior import PosteriorDraws
    from eclsim.app.state import PageState
    from eclsim.circuit import Circuit

SPEEDS = 15
VALVE_OUTPUTS = ("aortic_valve_flow", "peak_aortic_valve_flow")
"""Outputs that show whether the aortic valve opens, the purpose of a ramp with an assist pump."""


def ramp(state: PageState) -> dict[str, Any] | None:
    """Compute outputs over the speeds of the state's pump; None without a rotary pump.

    Outputs are null at a speed whose beat did not converge or is impossible in a patient. `closed` lists the
    speeds at which the aortic valve never opens. `undetermined` lists those at which closed heart valves trap
    blood: the trapped volume, and with it all pressures, depends on where the search started.
    """
    sweep = sweep_of(state.case)
    if sweep is None:
        return None
    circuit, values = page_circuit(state.computed_case)
    speeds = np.unique([*np.linspace(sweep.low, sweep.high, SPEEDS), sweep.present])
    members = values | {sweep.key: speeds}
    resolution = int(np.max(needed_resolution(assemble(circuit), members)))
    batch = Batch(circuit, members, len(speeds), state.policy)
    shown = [curve.output for _, curve in curves_of(state.case) if curve.output in output_names(circuit)]
    judged, watched = _judging(circuit)
    valve = [n for n in VALVE_OUTPUTS if n in output_names(circuit)]
    names = list(dict.fromkeys([*shown, *judged, *valve]))
    result = steady_beat(batch, names, waveforms=watched, start=values, resolution=resolution)
    possible = np.array([not impossible(result.findings(k)) for k in range(len(speeds))])
    flows = zip(*(result.output(n).tolist() for n in valve), strict=True)
    closed = np.array([stays_closed(*flow) for flow in flows] or [False] * len(speeds))
    return {
        "of": key_of(state), "key": sweep.key, "own": sweep.present, "speeds": speeds.tolist(),
        "outputs": {n: plain_curve(np.where(possible, result.output(n), np.nan)) for n in shown},
        "curves": plain_curves(state.case, shown),
        "lost": speeds[~result.converged].tolist(), "impossible": speeds[~possible].tolist(),
        "closed": speeds[closed & possible].tolist(),
        "undetermined": speeds[result.converged & ~result.determined & possible].tolist(),
    }  # fmt: skip


def _judging(circuit: Circuit) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the outputs and waveforms that show whether a beat is possible in a patient."""
    known = output_names(circuit)
    judged = (n for n in known if any(limit.kind == "collapse" for limit in limits_of(n, known)))
    return tuple(judged), watched_waveforms(circuit)


def schemes(state: PageState) -> dict[str, Any] | None:
    """Compute line pressures of the nine schemes at the state's speed; None without a rotary ECMO pump."""
    from eclsim.crrt_study.beats import line_pressures_of_nine_schemes

    result = line_pressures_of_nine_schemes(state.case, state.policy)
    return None if result is None else {"of": key_of(state), **result}


def plain_curve(values: np.ndarray) -> list[float | None]:
    """Return rounded numbers for the browser; null for those that are not finite."""
    return [finite(float(value), digits=5) for value in values]


# --- bands of a posterior ---------------------------------------------------------------------------


CENTRAL_90 = (0.05, 0.95)
POINTS = 100
RAMP_MEMBERS = 64
LOOP_POINTS = 60
MOST_LOOPS = 24
"""Number of loops drawn per ventricle: a band has no meaning for a closed curve."""
FEWEST_DRAWS = 10
"""Smallest number of remaining draws for which bands are computed."""
VENTRICLES = ("lv", "rv")
LOOP_WAVES = frozenset(kind + place for place in VENTRICLES for kind in "VP")
Wanted = Callable[[], bool]


@dataclass(frozen=True)
class Solved:
    """Draws whose steady beat is possible in a patient; draws are the last axis of the arrays.

    Args:
        phases: grid of the beat, as fractions of it.
        waves: waveforms by name, shape (points, draws).
        outputs: outputs by name, shape (draws,).
        lost: number of draws without a determined steady beat or, if gases are computed, a steady gas state.
        impossible: number of draws whose steady beat is impossible in a patient.
    """

    phases: np.ndarray
    waves: Mapping[str, np.ndarray]
    outputs: Mapping[str, np.ndarray]
    lost: int
    impossible: int

    @property
    def count(self) -> int:
        """Number of draws from which bands are computed."""
        return len(next(iter(self.outputs.values())))


def beat_bands(state: PageState, members: PosteriorDraws, current: Wanted) -> dict[str, Any] | None:
    """Compute bands of a state's waveforms and outputs, and loops of members; None if no longer needed."""
    circuit, values = page_circuit(state.computed_case)
    count = len(members.draws)
    signals = tuple(n for n in waves_of(state.case) if n in beat_program(circuit).signals)
    solved = solve(
        circuit, members.values(values, count), count, state.policy, values,
        (output_names(circuit), signals), current,
    )  # fmt: skip
    if solved is None:
        return None
    result = {
        "of": key_of(state), "count": count, "lost": solved.lost, "impossible": solved.impossible,
        "fewest": solved.count, "outputs": {}, "waves": {}, "loops": {},
    }  # fmt: skip
    if solved.count < FEWEST_DRAWS:
        return result
    even = np.linspace(0.0, 1.0, POINTS, endpoint=False)
    result["outputs"] = {n: plain_curve(np.quantile(v, CENTRAL_90)) for n, v in solved.outputs.items()}
    result["waves"] = {
        n: [plain_curve(np.interp(even, solved.phases, q)) for q in np.quantile(w, CENTRAL_90, axis=1)]
        for n, w in solved.waves.items()
        if n not in LOOP_WAVES
    }
    result["loops"] = {p: _loops(solved, p) for p in VENTRICLES}
    return result


def ramp_bands(state: PageState, members: PosteriorDraws, current: Wanted) -> dict[str, Any] | None:
    """Compute bands of outputs over the pump's speeds; None without such a pump, or if no longer needed."""
    sweep = sweep_of(state.case)
    if sweep is None:
        return None
    circuit, values = page_circuit(state.computed_case)
    names = tuple(c.output for _, c in curves_of(state.case) if c.output in output_names(circuit))
    count = min(RAMP_MEMBERS, len(members.draws))
    speeds = np.linspace(sweep.low, sweep.high, (SPEEDS + 1) // 2)
    bands: dict[str, list[Any]] = {n: [] for n in names}
    lost, impossible, fewest = 0, 0, count
    for speed in speeds:
        at_speed = {**values, sweep.key: float(speed)}
        solved = solve(
            circuit, members.values(at_speed, count), count, state.policy, values, (names, ()), current
        )
        if solved is None:
            return None
        lost, impossible = max(lost, solved.lost), max(impossible, solved.impossible)
        fewest = min(fewest, solved.count)
        for n in names:
            enough = solved.count >= FEWEST_DRAWS
            bands[n].append(np.quantile(solved.outputs[n], CENTRAL_90) if enough else (np.nan, np.nan))
    curves = {n: [plain_curve(side) for side in np.array(b).T] for n, b in bands.items()}
    return {
        "of": key_of(state), "speeds": speeds.tolist(), "count": count, "lost": lost,
        "impossible": impossible, "fewest": fewest, "outputs": curves,
    }  # fmt: skip


def solve(
    circuit: Circuit, values: Mapping[str, Any], count: int, policy: str, start: Mapping[str, float],
    shown: tuple[tuple[str, ...], tuple[str, ...]], current: Wanted,
) -> Solved | None:  # fmt: skip
    """Solve the steady beats of members in blocks, leaving out those impossible in a patient.

    Args:
        circuit: circuit of all members.
        values: a number or an array (members,) for each parameter.
        count: number of members.
        policy: blood volume policy.
        start: parameter values near those of all members, where the search starts.
        shown: names of the outputs and of the waveforms needed.
        current: returns whether the result is still needed; called before each block. If not, None is
            returned.
    """
    names, signals = shown
    resolution = int(np.max(needed_resolution(assemble(circuit), values)))
    judged, watched = _judging(circuit)
    recorded = tuple(dict.fromkeys((*signals, *watched)))
    outputs, waves, lost, impossible_draws = [], [], 0, 0
    for first in range(0, count, SIDE_BY_SIDE):
        if not current():
            return None
        part = slice(first, min(first + SIDE_BY_SIDE, count))
        chunk = {n: v[part] if np.ndim(v) else v for n, v in values.items()}
        batch = Batch(circuit, chunk, part.stop - first, policy)
        beat = steady_beat(
            batch, tuple(dict.fromkeys((*names, *judged))), waveforms=recorded,
            keep=None if signals else (), options=DENSITY_OPTIONS, start=start, resolution=resolution,
            execution=Execution(threads=1, width=SIDE_BY_SIDE),
        )  # fmt: skip
        steady = np.flatnonzero(beat.determined & ~beat.without_gases)
        good = [int(k) for k in steady if not impossible(beat.findings(int(k)))]
        outputs.append(beat.values[: len(names), good])
        waves += [beat.waveforms[k].values[:, : len(signals)] for k in good if signals]
        lost += batch.count - len(steady)
        impossible_draws += len(steady) - len(good)
    phases = beat_program(circuit, resolution).grid.phases
    table = np.stack(waves, axis=-1) if waves else np.empty((len(phases), len(signals), 0))
    result = dict(zip(names, np.concatenate(outputs, axis=1), strict=True))
    return Solved(phases, {n: table[:, k] for k, n in enumerate(signals)}, result, lost, impossible_draws)


def _loops(solved: Solved, place: str) -> list[list[list[float | None]]]:
    """Return loops of some of the 90 % of members nearest to the median loop."""
    sides = [solved.waves[kind + place] for kind in "VP"]
    away = np.zeros(solved.count)
    for wave in sides:
        middle = np.median(wave, axis=1, keepdims=True)
        spread = np.maximum(np.median(np.abs(wave - middle), axis=1, keepdims=True), 1e-3)
        away = np.maximum(away, (np.abs(wave - middle) / spread).max(axis=0))
    central = np.flatnonzero(away <= np.quantile(away, 0.9))[:MOST_LOOPS]
    even = np.linspace(0.0, 1.0, LOOP_POINTS)
    return [[plain_curve(np.interp(even, solved.phases, wave[:, m])) for wave in sides] for m in central]
