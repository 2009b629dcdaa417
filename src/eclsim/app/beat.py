"""One steady beat for the page: numbers, and waveforms on an even grid; without the labels of a dataset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.app.circuits import page_circuit
from eclsim.haemodynamics.alarms import findings
from eclsim.haemodynamics.dataset import outcome
from eclsim.haemodynamics.evaluation import output_names
from eclsim.haemodynamics.measures import Measures
from eclsim.haemodynamics.outputs import output
from eclsim.haemodynamics.recirculation import recirculated_fraction
from eclsim.haemodynamics.signals import unstressed_volume, whole_beat
from eclsim.parameters.devices import OXYGENATORS
from eclsim.solver.beat import beat_program
from eclsim.solver.model import circuit_of
from eclsim.solver.recording import MEAN, RATE
from eclsim.solver.status import Status
from eclsim.solver.steady import Batch, steady_beats

if TYPE_CHECKING:
    from eclsim.app.state import PageState
    from eclsim.circuit import Circuit

POINTS = 200
"""Points of a waveform on the page: 5 ms at 60 beats a minute."""


@dataclass(frozen=True)
class Beat:
    """The steady beat of a state.

    Args:
        circuit: compiled circuit.
        values: its parameters.
        period: length of the beat [s].
        waves: waveforms at `POINTS` even phases; pressures [mmHg], flows [mL/s], volumes [mL].
        means: means of all pressures and flows.
        outputs: scalar outputs by name.
        notes: limits that are broken, as (kind, sentence).
        status: how the search for the beat ended.
        message: in words.
    """

    circuit: Circuit
    values: Mapping[str, float]
    period: float
    waves: Mapping[str, np.ndarray]
    means: Mapping[str, float]
    outputs: Mapping[str, float]
    notes: tuple[tuple[str, str], ...]
    status: Status
    message: str

    @property
    def converged(self) -> bool:
        """Whether there is a steady beat."""
        return self.status is Status.CONVERGED


def compute_beat(state: PageState, near: Mapping[str, float] | None = None) -> Beat:
    """The steady beat of a state.

    Args:
        state: case and blood volume policy.
        near: parameter values of the same circuit to start the search from.
    """
    circuit, values = page_circuit(state.case)
    steady = steady_beats(Batch(circuit, values, 1, state.policy), near=near)
    program = beat_program(circuit, int(steady.resolution[0]))
    signals = program.signals
    _, recorded = program.trace(signals)(steady.orbits.states[:, 0], steady.batch.packed(program)[:, 0])
    series = dict(zip(signals, whole_beat(np.asarray(recorded)).T, strict=True))
    measures = Measures(series, program.grid.phases)
    outputs = {n: float(output(n).compute(measures)) for n in output_names(circuit)}
    shown = {name: values_ for name, values_ in series.items() if not name.endswith((RATE, MEAN))}
    means = {n: float(measures.mean(n)) for n in shown if n[0] in "PQ"}
    _add_recirculation(state, means, outputs)
    status, message = outcome(steady, outputs)
    extremes = {n: (float(s.min()), float(s.max())) for n, s in shown.items()}
    notes = [(f.kind, f.sentence) for f in findings(outputs, extremes)] + _label_notes(state, outputs)
    return Beat(
        circuit, values, 60.0 / values["heart_rate_bpm"],
        _resampled(circuit, values, shown, program.grid.phases), means, outputs, tuple(notes), status,
        message,
    )  # fmt: skip


def _resampled(
    circuit: Circuit, values: Mapping[str, float], series: Mapping[str, np.ndarray], phases: np.ndarray
) -> dict[str, np.ndarray]:
    even = np.linspace(0.0, 1.0, POINTS, endpoint=False)
    found = {}
    for name, wave in series.items():
        shift = unstressed_volume(circuit, name[1:], values) if name[0] == "V" else 0.0
        found[name] = np.interp(even, phases, wave) + shift
    return found


def _add_recirculation(state: PageState, means: Mapping[str, float], outputs: dict[str, float]) -> None:
    if state.case.crrt is None:
        return
    fixed = circuit_of(state.case)
    flows = {c.name: means["Q" + c.name] for c in fixed.connections}
    if all(np.isfinite(f) for f in flows.values()):
        fraction = recirculated_fraction(fixed, flows)
        if fraction is not None:
            outputs["crrt_recirculated_fraction"] = fraction


def _label_notes(state: PageState, outputs: Mapping[str, float]) -> list[tuple[str, str]]:
    if state.case.ecmo is None or "PF" not in outputs:
        return []
    said = OXYGENATORS[state.case.ecmo.oxygenator].label_warning(outputs["PF"])
    return [("warning", f"ECMO flow of {said}")] if said else []


def plain(beat: Beat, waves: tuple[str, ...]) -> dict[str, Any]:
    """A beat as compact plain data for the browser; null for what is not finite."""
    return {
        "period": round(beat.period, 5),
        "waves": {n: _rounded(beat.waves[n]) for n in waves if n in beat.waves},
        "means": {n: _finite(v) for n, v in beat.means.items()},
        "outputs": {n: _finite(v) for n, v in beat.outputs.items()},
        "notes": [list(note) for note in beat.notes],
        "converged": beat.converged,
        "status": beat.status.name.lower(),
        "message": beat.message,
    }


def _rounded(wave: np.ndarray) -> list[float | None]:
    if np.isfinite(wave).all():
        return np.round(wave, 2).tolist()
    return [_finite(v) for v in wave.tolist()]


def _finite(value: float) -> float | None:
    return float(f"{value:.6g}") if np.isfinite(value) else None
