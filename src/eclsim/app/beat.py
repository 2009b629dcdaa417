"""One steady beat for the page: numbers, and waveforms on an even grid; without the labels of a dataset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.app.circuits import page_circuit
from eclsim.beat.heartbeat import beat_program
from eclsim.beat.recording import MEAN, RATE
from eclsim.devices.ecmo import OXYGENATORS
from eclsim.files import finite
from eclsim.orbit.model import circuit_of
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, steady_beats
from eclsim.outputs.alarms import CAUTION, Finding, findings, impossible
from eclsim.outputs.dataset import outcome
from eclsim.outputs.evaluation import output_names
from eclsim.outputs.limits import level, place_levels
from eclsim.outputs.measures import Measures
from eclsim.outputs.recirculation import recirculated_fraction
from eclsim.outputs.registry import output
from eclsim.outputs.signals import unstressed_volume, whole_beat

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
        findings: limits that are broken and how numbers are to be read, the gravest first.
        status: how the search for the beat ended.
        message: in words.
    """

    circuit: Circuit
    values: Mapping[str, float]
    period: float
    waves: Mapping[str, np.ndarray]
    means: Mapping[str, float]
    outputs: Mapping[str, float]
    findings: tuple[Finding, ...]
    status: Status
    message: str

    @property
    def converged(self) -> bool:
        """Whether there is a steady beat."""
        return self.status is Status.CONVERGED

    @property
    def possible(self) -> bool:
        """Whether it can be the beat of a patient: no chamber without blood, no vessel sucked shut."""
        return not impossible(self.findings)

    def levels(self) -> dict[str, str]:
        """How each output stands to its limits: "ok", "warning", "alarm" or "collapse"."""
        return {name: level(name, value, self.outputs) for name, value in self.outputs.items()}

    def place_levels(self) -> dict[str, str]:
        """The same for each compartment; one that has collapsed is marked whatever its mean pressure."""
        found = place_levels(self.outputs)
        for finding in self.findings:
            if finding.kind == "collapse" and finding.quantity[1:] in found:
                found[finding.quantity[1:]] = "collapse"
        return found


def compute_beat(state: PageState, near: Mapping[str, float] | None = None) -> Beat:
    """The steady beat of a state.

    Args:
        state: case and blood volume policy.
        near: parameter values of the same circuit to start the search from.
    """
    circuit, values = page_circuit(state.case)
    steady = steady_beats(Batch(circuit, values, 1, state.policy), near=near, lone=True)
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
    said = [*findings(outputs, extremes, circuit_of(state.case)), *_label(state, outputs)]
    if doubt := steady.grid_doubt():
        said.append(Finding("warning", "grid", float("nan"), float("nan"), doubt))
    return Beat(
        circuit, values, 60.0 / values["heart_rate_bpm"],
        _resampled(circuit, values, shown, program.grid.phases), means, outputs, tuple(said), status,
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


def _label(state: PageState, outputs: Mapping[str, float]) -> list[Finding]:
    """A flow outside of what the oxygenator is labelled for."""
    if state.case.ecmo is None or not outputs.get("PF", -1.0) >= 0.0:  # backwards is an alarm of its own
        return []
    said = OXYGENATORS[state.case.ecmo.oxygenator].label_warning(outputs["PF"])
    text = f"ECMO flow of {said}"
    return [Finding("warning", "PF", outputs["PF"], float("nan"), text, concerns=("PF",))] if said else []


def plain(beat: Beat, waves: tuple[str, ...]) -> dict[str, Any]:
    """A beat as compact plain data for the browser; null for what is not finite."""
    return {
        "period": round(beat.period, 5),
        "waves": {n: _rounded(beat.waves[n]) for n in waves if n in beat.waves},
        "means": finite(beat.means, digits=6),
        "outputs": finite(beat.outputs, digits=6),
        "notes": [[f.kind, f.sentence] for f in beat.findings],
        "cautions": _cautions(beat.findings),
        "levels": beat.levels(),
        "places": beat.place_levels(),
        "possible": beat.possible,
        "converged": beat.converged,
        "status": beat.status.name.lower(),
        "message": beat.message,
    }


def _cautions(said: Iterable[Finding]) -> dict[str, str]:
    """How each number is to be read, where there is something to say."""
    found: dict[str, list[str]] = {}
    for finding in said:
        for name in finding.concerns if finding.kind == CAUTION else ():
            found.setdefault(name, []).append(finding.sentence)
    return {name: "; ".join(sentences) for name, sentences in found.items()}


def _rounded(wave: np.ndarray) -> list[float | None]:
    if np.isfinite(wave).all():
        return np.round(wave, 2).tolist()
    return [finite(float(v), digits=6) for v in wave]
