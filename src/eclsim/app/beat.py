"""The steady beat for the page: numbers, and waveforms on an even grid, without the metadata of a dataset."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.app.brief import brief_findings
from eclsim.app.display import PATIENT
from eclsim.app.texts import in_knob_labels, in_page_words, text, with_minus
from eclsim.beat.heartbeat import HEART_RATE
from eclsim.cases.resolve import switched_circuit
from eclsim.circuit import Circuit
from eclsim.devices.description import KeyFigure
from eclsim.files import finite
from eclsim.gas.network import GasStatus
from eclsim.orbit.model import values_of
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch
from eclsim.outputs.alarms import CAUTION, Finding, flows_differ, gravest_first, impossible, marks
from eclsim.outputs.gas import PlaceGases, of_moving_blood, recirculation
from eclsim.outputs.limits import place_levels
from eclsim.outputs.second_beat import caution_of_two, flows_in_words, second_beat
from eclsim.outputs.signals import unstressed_volume
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat
from eclsim.reporting.saturation import colour_of, text_colour_on
from eclsim.reporting.schematic_layout import dead_ends

if TYPE_CHECKING:
    from eclsim.app.state import PageState
    from eclsim.cases.case import Case
    from eclsim.course.beats import TransientBeat
    from eclsim.course.trapped import KnownBlood


def page_circuit(case: Case) -> tuple[Circuit, dict[str, float]]:
    """Return circuit and parameter values of a case.

    If all movable lines of a device are at sites of one other device, the sites are chosen by parameter
    values. Otherwise they are fixed, and moving a line compiles another circuit.
    """
    circuit, chosen = switched_circuit(case)
    return _same(circuit), values_of(case) | chosen


@lru_cache(maxsize=256)
def _same(circuit: Circuit) -> Circuit:
    """Return the same object for equal circuits, so that compiled programs are reused."""
    return circuit


# --- the beat ---------------------------------------------------------------------------------------


GAS_COLUMNS = ("SO2", "PO2", "PCO2", "pH", "O2", "CO2")
"""Blood gas quantities shown: %, mmHg, mmHg, -, and contents [mL/dL]."""
POINTS = 200
"""Number of points of a waveform on the page: every 5 ms at 60 beats per minute."""


@dataclass(frozen=True)
class Beat:
    """The beat of a state, steady unless it is one of a transient.

    Args:
        circuit: compiled circuit.
        values: parameter values of the circuit.
        period: duration of the beat [s].
        waves: waveforms at `POINTS` even phases; pressures [mmHg], flows [mL/s], volumes [mL].
        means: means of all pressures [mmHg] and flows [mL/s].
        outputs: scalar outputs by name.
        findings: violated limits and remarks on reading the numbers, the most serious first.
        status: outcome of the search for the beat.
        message: the outcome in words.
        gas_status: outcome of the search for the steady gas state; None if gases are not computed.
        gases: blood gases of all compartments, if there is a steady gas state.
        transient: whether this is one of successive beats, which need not be steady.
        effort: number of beats computed in the search; large if it started far away.
        undetermined: outputs that depend on where the search started, since closed valves trap blood.
        second: flows of a second steady beat at the same settings in words, if one was found.
        solved: the steady beat without waveforms, from which a second one is sought; None for a transient.
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
    gas_status: GasStatus | None = None
    gases: PlaceGases | None = None
    transient: bool = False
    effort: int = 0
    undetermined: tuple[str, ...] = ()
    second: str = ""
    solved: SteadyBeat | None = field(default=None, repr=False, compare=False)

    @property
    def converged(self) -> bool:
        """Whether the search found a steady beat; True for a beat of a transient, which needs no search."""
        return self.status in (Status.CONVERGED, Status.ONE_OF_MANY)

    @property
    def possible(self) -> bool:
        """Whether the beat is possible in a patient: no chamber without blood, no vessel sucked shut."""
        return not impossible(self.findings)

    def levels(self) -> dict[str, str]:
        """Return the level of each output: "ok", or the most serious finding about it, as in figures.

        Cautions have no level: they are about how to read a number.
        """
        marked = marks(self.findings, self.outputs, self.values)
        graver = {name: kind for name, kind in marked.items() if kind != CAUTION}
        return dict.fromkeys(self.outputs, "ok") | graver

    def place_levels(self) -> dict[str, str]:
        """Return the level of each compartment; a collapsed one is marked whatever its mean pressure."""
        result = place_levels(self.levels())
        for finding in self.findings:
            if finding.kind == "collapse" and finding.quantity[1:] in result:
                result[finding.quantity[1:]] = "collapse"
        return result


Program = tuple[Circuit, int]
"""Circuit and grid resolution, which determine a compiled program."""


def compute_beat(
    state: PageState, start: Beat | None = None, begins: Callable[[Program], None] | None = None
) -> Beat:
    """Compute the steady beat of a state.

    Args:
        state: case and blood volume policy.
        start: beat from which the search starts, if it is of the same circuit.
        begins: called with the program needed, before it may have to be compiled.
    """
    circuit, values = page_circuit(state.computed_case)
    return beat_of(state, circuit, values, start, begins)


def beat_of(
    state: PageState,
    circuit: Circuit,
    values: Mapping[str, float],
    start: Beat | None = None,
    begins: Callable[[Program], None] | None = None,
    blood: KnownBlood | None = None,
) -> Beat:
    """Compute the steady beat of a state at other values of its circuit, such as those of a later minute.

    Where valves stay shut, the blood behind them is that of `blood`, an earlier beat, if it is given.
    """
    batch = Batch(circuit, values, 1, state.policy)
    if begins is not None:
        begins((circuit, int(batch.resolutions()[0])))
    near = start.values if start is not None and start.circuit is circuit else None
    solved = steady_beat(batch, waveforms=None, keep=None, start=near)
    if blood is not None:
        from eclsim.course.trapped import beat_with_blood_of

        solved = beat_with_blood_of(solved, blood)
    outputs = of_moving_blood(solved.outputs())
    if solved.converged[0]:
        fixed = circuit.with_chosen_sites(values)
        flows = {c.name: float(solved.mean("Q" + c.name)[0]) for c in fixed.connections}
        outputs |= {name: value for name, (value, _) in recirculation(fixed, flows).items()}
    means = {n: float(solved.mean(n)[0]) for n in solved.signals if n[0] in "PQ"}
    series = {n: solved.waveform(n) for n in solved.signals}
    waves = _evenly(series, solved.waveforms[0].phases, circuit, values)
    message = in_page_words(solved.message())
    # Without a beat no limit would be broken, so that the alarm is one of all outputs.
    no_beat = Finding.without_limit("alarm", "", math.nan, message, *outputs)
    findings = tuple(solved.findings()) if solved.converged[0] else (no_beat,)
    rate = float(np.asarray(solved.values_in_effect()[HEART_RATE]))
    return Beat(
        circuit, values, 60.0 / (rate if rate > 0.0 else values[HEART_RATE]), waves, means, outputs, findings,
        Status(int(solved.status[0])), message,
        GasStatus(int(solved.gas_status[0])) if state.case.gas is not None else None, solved.gases.get(0),
        effort=int(solved.orbits.beats[0]), undetermined=solved.undetermined_outputs(),
        solved=replace(solved, waveforms={}, gases={}),
    )  # fmt: skip


def with_second_beat(beat: Beat, wanted: Callable[[], bool]) -> Beat | None:
    """Return a beat with the caution on a second steady beat at the same settings; None if none was found.

    Args:
        beat: the beat that is shown.
        wanted: returns whether the result is still needed.
    """
    if beat.solved is None or not beat.converged:
        return None
    other = second_beat(beat.solved, wanted=wanted)
    if other is None:
        return None
    findings = gravest_first([*beat.findings, caution_of_two(beat.solved, other)])
    return replace(beat, findings=tuple(findings), second=flows_in_words(other))


def transient_beat(state: PageState, moment: TransientBeat) -> Beat:
    """Convert a beat of a course beat by beat; the gases of compartments are not included."""
    series = dict(zip(moment.signals, moment.waves.T, strict=True))
    waves = _evenly(series, moment.phases, moment.circuit, moment.values)
    means = {n: float(v) for n, v in zip(moment.signals, moment.means, strict=True) if n[0] in "PQ"}
    gas = GasStatus.STEADY if state.case.gas is not None else None
    return Beat(
        moment.circuit, moment.values, moment.period, waves, means, moment.outputs, tuple(moment.findings),
        Status.CONVERGED, text("timeline_passing"), gas, transient=True,
    )  # fmt: skip


def _evenly(
    series: Mapping[str, np.ndarray], phases: np.ndarray, circuit: Circuit, values: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Interpolate waveforms at `POINTS` even phases; unstressed volumes are added to volumes."""
    even = np.linspace(0.0, 1.0, POINTS, endpoint=False)
    before = np.searchsorted(phases, even, side="right") - 1
    share = (even - phases[before]) / (phases[before + 1] - phases[before])
    table = np.stack(list(series.values()), axis=1)
    waves = table[before] + share[:, None] * (table[before + 1] - table[before])
    return {n: wave + unstressed_volume(circuit, n, values) for n, wave in zip(series, waves.T, strict=True)}


def plain(
    beat: Beat, waves: tuple[str, ...], figures: Sequence[KeyFigure] = PATIENT.figures
) -> dict[str, Any]:
    """Return a beat as compact plain data for the browser; null for numbers that are not finite.

    Args:
        beat: the beat.
        waves: names of the waveforms to include.
        figures: tiles of the page, by whose labels findings are named where there is little room.
    """
    return {
        "period": round(beat.period, 5),
        "waves": {n: _rounded(beat.waves[n]) for n in waves if n in beat.waves},
        "means": finite(beat.means, digits=6), "outputs": finite(beat.outputs, digits=6),
        "notes": [[f.kind, _said(f)] for f in beat.findings], "brief": brief_findings(beat.findings, figures),
        "cautions": _cautions(beat.findings), "levels": beat.levels(), "places": beat.place_levels(),
        "possible": beat.possible, "converged": beat.converged, "transient": beat.transient,
        "undetermined": list(beat.undetermined), "second": with_minus(beat.second),
        "apart": _apart(beat.outputs), "gas": _plain_gases(beat),
        "status": beat.status.word, "message": with_minus(in_knob_labels(beat.message)),
    }  # fmt: skip


def _apart(outputs: Mapping[str, float]) -> list[str]:
    """Return the flows with a tile of their own only where they differ from another."""
    nan = math.nan
    pairs = [(one.output, one.unlike) for one in PATIENT.figures if one.unlike]
    return [name for name, other in pairs if flows_differ(outputs.get(name, nan), outputs.get(other, nan))]


def _plain_gases(beat: Beat) -> dict[str, Any] | None:
    """Return gases and saturation colours of all compartments, or the reason why there are none."""
    if beat.gas_status is None:
        return None
    result: dict[str, Any] = {"message": with_minus(beat.gas_status.message), "places": {}, "exchanged": {}}
    if beat.gases is None:
        if beat.transient or not beat.converged:
            result["message"] = text("gases_passing") if beat.transient else beat.message
        return result
    without = dead_ends(beat.circuit)  # a balloon contains no blood of the patient
    for place, blood in beat.gases.places.items():
        if place in without:
            continue
        if place in beat.gases.standing:  # stagnant blood: the value left by the search has no meaning
            result["places"][place] = {"values": dict.fromkeys(GAS_COLUMNS), "standing": True}
            continue
        percent = 100.0 * float(blood.saturation)
        numbers = (percent, blood.po2, blood.pco2, blood.ph, blood.oxygen, blood.carbon_dioxide)
        values = {name: float(number) for name, number in zip(GAS_COLUMNS, numbers, strict=True)}
        colours = {"colour": colour_of(percent), "letters": text_colour_on(percent)}
        result["places"][place] = {"values": finite(values, digits=5), **colours}
    result["exchanged"] = finite({at: list(pair) for at, pair in beat.gases.exchanged.items()}, digits=6)
    return result


def _said(finding: Finding) -> str:
    return with_minus(in_knob_labels(finding.sentence))


def _cautions(findings: Iterable[Finding]) -> dict[str, str]:
    """Return the remarks on how to read each number, by output."""
    result: dict[str, list[str]] = {}
    for finding in findings:
        for name in finding.concerns if finding.kind == CAUTION else ():
            result.setdefault(name, []).append(_said(finding))
    return {name: "; ".join(sentences) for name, sentences in result.items()}


def _rounded(wave: np.ndarray) -> list[float | None]:
    if np.isfinite(wave).all():
        return np.round(wave, 2).tolist()
    return [finite(float(v), digits=6) for v in wave]
