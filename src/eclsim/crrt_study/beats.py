"""Steady beats of the study: all schemes at all speeds, solved as one batch, as labelled datasets.

Every difference from the patient on ECMO alone at the same speed has exactly two parts. `flow` is the
difference if the patient keeps the stressed volume of the patient without CRRT (the circuit is primed with
the volume that it holds). `uptake` is the rest, the effect of the blood that the circuit has taken up.

Beats that were not found have no numbers (`eclsim.outputs.steady_beat`). This module reports them with the
reasons.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from eclsim.cases.resolve import resolve_parameters, with_blood_of
from eclsim.circuit import Choice, Circuit
from eclsim.devices.crrt import CRRT, Crrt, crrt
from eclsim.devices.ecmo import POSITIONS
from eclsim.files import finite
from eclsim.gas.network import GasStatus
from eclsim.orbit.model import AS_PUBLISHED, PATIENT_HELD, POLICY_WORDS, circuit_of, values_of
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch
from eclsim.outputs.alarms import impossible
from eclsim.outputs.gas import recirculated_fractions
from eclsim.outputs.limits import level, limits_of
from eclsim.outputs.results import output_labels
from eclsim.outputs.signals import output_names, signal_labels, unstressed_volume
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat
from eclsim.parameters.fluid import SECTION as FLUID
from eclsim.patient.sites import SAME_IN_REGIONS

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.crrt_study.schemes import Scheme
    from eclsim.crrt_study.study import CrrtStudy

Variables = dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]]
"""Contents of a dataset: dimensions, values and labels by name."""
ACCESS, RETURN, SPEED = "crrt.access_site", "crrt.return_site", "ecmo.speed_rpm"
START_PRESSURE, VENOUS_COMPLIANCE = "P0svn", "Csvn"


@dataclass(frozen=True)
class StudyCircuits:
    """Circuits of a patient on ECMO with switchable CRRT lines, and of the same patient without CRRT.

    Args:
        circuit: circuit with CRRT; `crrt.access_site` and `crrt.return_site` select from `nodes`.
        without: circuit without CRRT.
        values: parameters of the case, including the CRRT flow.
        nodes: compartments to which a line may be connected.
        schemes: schemes of the study.
    """

    circuit: Circuit
    without: Circuit
    values: dict[str, float]
    nodes: tuple[str, ...]
    schemes: tuple[Scheme, ...]

    def run(
        self,
        speeds: np.ndarray,
        policy: str,
        keep: Sequence[int] = (),
        patient_volume_ml: float | None = None,
        patients: Mapping[str, np.ndarray] | None = None,
    ) -> SteadyBeat:
        """Solve all schemes at all speeds; members vary fastest by variant, then by speed, then by scheme.

        Args:
            speeds: pump speeds [rpm].
            policy: blood volume policy.
            keep: indices of members whose waveforms are kept.
            patient_volume_ml: stressed volume of the patient with `patient_held`; None takes the case's own.
            patients: parameters in which variants of the patient differ, each (variants,); all on one grid.
        """
        values, patients = self._values(patient_volume_ml), patients or {}
        places = np.array([[self.nodes.index(n) for n in s.nodes] for s in self.schemes], dtype=float)
        variants = len(next(iter(patients.values()), [0.0]))
        per_scheme = len(speeds) * variants
        members = values | {
            ACCESS: np.repeat(places[:, 0], per_scheme),
            RETURN: np.repeat(places[:, 1], per_scheme),
            SPEED: np.tile(np.repeat(speeds, variants), len(places)),
        }
        members |= {name: np.tile(column, len(places) * len(speeds)) for name, column in patients.items()}
        start = values | {ACCESS: places[0, 0], RETURN: places[0, 1]}
        batch = Batch(self.circuit, members, len(places) * per_scheme, policy)
        finest = int(batch.resolutions().max()) if patients else None
        result = steady_beat(batch, waveforms=None, keep=keep, start=start, resolution=finest)
        return result.determined_only()

    def run_without(self, speeds: np.ndarray, policy: str) -> SteadyBeat:
        """Solve the steady beats of the patient on ECMO alone."""
        batch = Batch(self.without, self.values | {SPEED: speeds}, len(speeds), policy)
        return steady_beat(batch, waveforms=None, keep=None, start=self.values).determined_only()

    def _values(self, patient_volume_ml: float | None) -> dict[str, float]:
        """Return parameters with the systemic veins filled so that the patient starts with a given volume."""
        if patient_volume_ml is None:
            return self.values
        batch = Batch(self.without, self.values, 1, PATIENT_HELD)
        missing = patient_volume_ml - float(batch.volume().target[0])
        start = self.values[START_PRESSURE] + missing / self.values[VENOUS_COMPLIANCE]
        return self.values | {START_PRESSURE: start}


def study_circuits(case: Case, schemes: Sequence[Scheme], crrt_flow_ml_min: float) -> StudyCircuits:
    """Return the circuits for a case with ECMO; the schemes replace its own CRRT connection."""
    without_crrt = case.model_copy(update={"crrt": None})
    without = circuit_of(without_crrt)
    others = dict.fromkeys(node for s in schemes for node in s.nodes if node not in POSITIONS.values())
    nodes = (*POSITIONS.values(), *sorted(others))
    section = case.crrt or Crrt(flow_ml_min=crrt_flow_ml_min, access_site="post_oxy", return_site="pre_oxy")
    lines = crrt(Choice(nodes, ACCESS), Choice(nodes, RETURN), section.dialyses)
    circuit = without + with_blood_of(case, lines)
    # The case's own CRRT: its filter meets the patient's haematocrit and bicarbonate.
    own = resolve_parameters(case.model_copy(update={"crrt": section}))
    values = values_of(without_crrt)
    values |= {name: v for name, v in own.items() if name.startswith((f"{CRRT.key}.", f"{FLUID}."))}
    values["crrt.flow_ml_min"] = crrt_flow_ml_min
    return StudyCircuits(circuit, without, values, nodes, tuple(schemes))


# --- labelled datasets ----------------------------------------------------------------------------


GROUPS = ("patient", "ecmo", "crrt")


FURTHER_QUANTITIES = ("patient_volume_change", "recirculated_fraction", "past_oxygenator")


def quantities(circuits: StudyCircuits) -> tuple[str, ...]:
    """Names of the numbers of a scheme's beat: mean pressures and flows, outputs, and derived quantities."""
    signals = (s for s in map(str, circuits.circuit.signals()) if s[0] in "PQ")
    return (*signals, *output_names(circuits.circuit), *FURTHER_QUANTITIES)


def means(
    circuits: StudyCircuits,
    runs: Sequence[SteadyBeat],
    without_crrt: Sequence[SteadyBeat],
    policies: Sequence[str],
    speeds: np.ndarray,
) -> xr.Dataset:
    """Cycle means, outputs, volumes and recirculation over `policy`, `scheme` and `speed`."""
    dims = ("policy", "scheme", "speed")
    shape = (len(circuits.schemes), len(speeds))
    data = _variables(runs, dims, shape)
    pairs = zip(runs, without_crrt, strict=True)
    change = np.stack([r.volume("patient").reshape(shape) - a.volume("patient") for r, a in pairs])
    about = "stressed volume of the patient at phase 0, minus that without CRRT at the same speed and policy"
    data["patient_volume_change"] = (dims, change, {"units": "mL", "long_name": about})
    data["recirculated_fraction"] = (
        dims, np.stack([_recirculation(circuits, r).reshape(shape) for r in runs]),
        {"units": "1", "long_name": "share of the access flow that comes straight from the return line"},
    )  # fmt: skip
    passing = np.array([[s.past_oxygenator] for s in circuits.schemes]) * data["Qcrrtpump"][1]
    data["past_oxygenator"] = (
        dims, passing / (passing + np.abs(data["Qecmooxy"][1])),
        {"units": "1", "long_name": "share of the ECMO's blood that the CRRT carries past the oxygenator"},
    )  # fmt: skip
    coordinates = {
        "policy": list(policies),
        "scheme": [s.letter for s in circuits.schemes],
        "speed": ("speed", speeds, {"units": "rpm", "long_name": "ECMO pump speed"}),
        "connection": ("scheme", [s.name for s in circuits.schemes]),
        "access_site": ("scheme", [s.access_site for s in circuits.schemes]),
        "return_site": ("scheme", [s.return_site for s in circuits.schemes]),
        "behind_oxygenator": ("scheme", [s.returns_behind_oxygenator for s in circuits.schemes]),
    }
    return xr.Dataset(data, coordinates)


def without(without_crrt: Sequence[SteadyBeat], policies: Sequence[str], speeds: np.ndarray) -> xr.Dataset:
    """Cycle means, outputs and volumes without CRRT over `policy` and `speed`."""
    data = _variables(without_crrt, ("policy", "speed"), (len(speeds),))
    speed = ("speed", speeds, {"units": "rpm", "long_name": "ECMO pump speed"})
    return xr.Dataset(data, {"policy": list(policies), "speed": speed})


def waveforms(circuits: StudyCircuits, runs: Sequence[SteadyBeat], policies: Sequence[str]) -> xr.Dataset:
    """Waveforms at the case's speed over `policy`, `scheme` and `phase`; volumes are total, not stressed."""
    first, data = runs[0], {}
    phases = next(iter(first.waveforms.values())).phases
    for k, signal in enumerate(first.signals):
        values = np.stack([[r.waveforms[m].values[:, k] for m in sorted(r.waveforms)] for r in runs])
        values = values + unstressed_volume(circuits.circuit, signal, circuits.values)
        data[signal] = (("policy", "scheme", "phase"), values, signal_labels(circuits.circuit, signal))
    data |= _whole_vessel_pressures(data)
    period = 60.0 / circuits.values["heart_rate_bpm"]
    coordinates = {
        "policy": list(policies),
        "scheme": [s.letter for s in circuits.schemes],
        "phase": ("phase", phases, {"units": "1", "long_name": "phase of the beat"}),
        "time": ("phase", phases * period, {"units": "s", "long_name": "time"}),
    }
    return xr.Dataset(data, coordinates)


def _variables(records: Sequence[SteadyBeat], dims: tuple[str, ...], shape: tuple[int, ...]) -> Variables:
    """Means of all pressures and flows, all outputs, volumes by group, and how each search ended."""
    first, circuit = records[0], records[0].batch.circuit

    def stacked(rows: list[np.ndarray]) -> np.ndarray:
        return np.stack([np.asarray(row).reshape(shape) for row in rows])

    data: Variables = {}
    for signal in (s for s in first.signals if s[0] in "PQ"):
        labels = signal_labels(circuit, signal) | {"cell_methods": "phase: mean"}
        data[signal] = (dims, stacked([r.mean(signal) for r in records]), labels)
    data |= _whole_vessel_pressures(data)
    for name in first.names:
        data[name] = (dims, stacked([r.output(name) for r in records]), output_labels(name))
    for group in (g for g in GROUPS if any(c.group == g for c in circuit.compartments)):
        labels = {"units": "mL", "long_name": f"stressed volume of {group} at phase 0"}
        data[f"{group}_volume"] = (dims, stacked([r.volume(group) for r in records]), labels)
    data["converged"] = (dims, stacked([r.determined for r in records]), {"long_name": "steady beat found"})
    texts = [np.array([Status(k).word for k in r.status]) for r in records]
    data["status"] = (dims, stacked(texts), {"long_name": "how the search for the steady beat ended"})
    if first.of_gases:
        ends = [np.array([GasStatus(k).word for k in r.gas_status]) for r in records]
        about = {"long_name": "how the search for the steady gas state ended"}
        data["gas_status"] = (dims, stacked(ends), about)
    data["beats"] = (dims, stacked([r.orbits.beats for r in records]), {"long_name": "beats computed"})
    return data


def _whole_vessel_pressures(data: Variables) -> Variables:
    """Pressures of vessels that a patient with regions has divided, under the names of the whole vessels."""
    parts = {f"P{vessel}": f"P{part}" for vessel, part in SAME_IN_REGIONS.items()}
    return {vessel: data[part] for vessel, part in parts.items() if part in data}


def _recirculation(circuits: StudyCircuits, records: SteadyBeat) -> np.ndarray:
    """Recirculated share of every member from its mean flows, shape (members,)."""
    names = [c.name for c in circuits.circuit.connections]
    flows = np.stack([records.mean("Q" + name) for name in names])
    per_scheme = flows.shape[1] // len(circuits.schemes)
    result = []
    for k, scheme in enumerate(circuits.schemes):
        circuit = circuits.without + crrt(*scheme.nodes)
        for member in range(k * per_scheme, (k + 1) * per_scheme):
            if not records.determined[member]:
                result.append(np.nan)
                continue
            shares = recirculated_fractions(circuit, dict(zip(names, flows[:, member], strict=True)))
            result.append(shares["crrt"])
    return np.array(result)


# --- median and variation over the schemes, as in section 3.3 of Thiel et al. ---------------------


SUMMARISED = (
    "Psart", "Psvn", "Ppart", "Pcrrttuin", "Pcrrttuout", "Pecmodrain", "PF", "MAP", "CO", "EDVRV", "ESVRV",
)  # fmt: skip
"""Quantities that are compared between the schemes: cycle means, and the right ventricle's volumes."""


def summarise(means: xr.Dataset) -> xr.Dataset:
    """Compute median, absolute and relative variation over the dimension `scheme`.

    Args:
        means: quantities with a dimension `scheme`; NaN if the beat was not found.

    Returns:
        For each quantity `<name>_median`, `<name>_variation` (largest minus smallest),
        `<name>_variation_percent` (variation relative to the magnitude of the median) and `<name>_highest`,
        `<name>_lowest` (letters of schemes; empty unless all are known); `schemes_known`, the number of
        schemes that these are computed from.
    """
    result: Variables = {}
    letters = means["scheme"].values.astype(str)
    dims = tuple(str(d) for d in means[SUMMARISED[0]].dims if d != "scheme")
    for name in SUMMARISED:
        values = means[name].transpose("scheme", *dims).values
        units = means[name].attrs.get("units", "")
        with warnings.catch_warnings():  # NaN if no scheme is known
            warnings.filterwarnings("ignore", message="All-NaN")
            median = np.nanmedian(values, axis=0)
            variation = np.nanmax(values, axis=0) - np.nanmin(values, axis=0)
        percent = 100.0 * variation / np.where(median == 0.0, np.nan, np.abs(median))
        for word, numbers, unit, long_name in (
            ("median", median, units, f"median of {name} over the schemes"),
            ("variation", variation, units, f"largest less smallest {name}"),
            ("variation_percent", percent, "%", f"variation of {name} relative to the median"),
        ):
            result[f"{name}_{word}"] = (dims, numbers, {"units": unit, "long_name": long_name})
        known = np.isfinite(values).all(axis=0)
        for word, choose in (("highest", np.argmax), ("lowest", np.argmin)):
            letter_there = np.where(known, letters[choose(np.nan_to_num(values), axis=0)], "")
            result[f"{name}_{word}"] = (dims, letter_there, {"long_name": f"scheme with the {word} {name}"})
    all_values = np.stack([means[name].transpose("scheme", *dims).values for name in SUMMARISED])
    about = {"units": "1", "long_name": "schemes whose beat was found, of which these are computed"}
    result["schemes_known"] = (dims, np.isfinite(all_values).all(axis=0).sum(axis=0), about)
    return xr.Dataset(result, {d: means[d] for d in dims})


# --- blood taken up by the tubing, and changed flow -----------------------------------------------


_PARTS = {"difference": "", "uptake": ": by the blood taken up", "flow": ": by changed flow"}
SPLIT_QUANTITIES = ("Psart", "Psvn", "Ppart", "MAP", "CO", "PF", "EDVRV", "ESVRV")


def split_differences(
    circuits: StudyCircuits, published: SteadyBeat, without: SteadyBeat, at: np.ndarray, speed: float
) -> xr.Dataset:
    """Differences from the patient without CRRT at one speed, split into uptake and flow.

    Args:
        circuits: circuits of the study.
        published: beats of all schemes with the published volume policy.
        without: beat of the patient without CRRT at this speed.
        at: indices of the members of `published` at this speed, one per scheme.
        speed: pump speed [rpm].

    Returns:
        Over `scheme`: `<name>_difference`, `<name>_uptake`, `<name>_flow`, and `blood_taken_up` [mL]; NaN if
        one of the beats was not found. `status` tells how the search with constant patient volume ended.
    """
    volume, letters = float(without.volume("patient")[0]), [scheme.letter for scheme in circuits.schemes]
    primed, status = None, [NOT_COMPUTED] * len(letters)
    if without.determined[0]:
        primed = circuits.run(np.array([speed]), PATIENT_HELD, patient_volume_ml=volume)
        status = [Status(k).word for k in primed.status]
    about = {"long_name": "how the search with constant patient volume ended"}
    result: Variables = {"status": (("scheme",), np.array(status), about)}
    for name in SPLIT_QUANTITIES:
        base = float(value(without, name)[0])
        total = value(published, name)[at] - base
        flow = np.full_like(total, np.nan) if primed is None else value(primed, name) - base
        units = output_labels(name)["units"] if name in published.names else "mmHg"
        for word, part in (("difference", total), ("uptake", total - flow), ("flow", flow)):
            about = {"units": units, "long_name": f"{name} less that without CRRT{_PARTS[word]}"}
            result[f"{name}_{word}"] = (("scheme",), part, about)
    about = {"units": "mL", "long_name": "stressed volume that the circuit takes from the patient"}
    result["blood_taken_up"] = (("scheme",), volume - published.volume("patient")[at], about)
    attributes = {"compared_with": "patient on ECMO without CRRT", "blood_volume_policy": AS_PUBLISHED}
    return xr.Dataset(result, {"scheme": letters}, attributes)


def value(records: SteadyBeat, name: str) -> np.ndarray:
    """Return a quantity by name: an output of the registry, else the mean of a waveform.

    For a vessel that a patient with regions has divided, `SAME_IN_REGIONS` gives the vessel to read.
    """
    if name in records.names:
        return records.output(name)
    return records.mean(name if name in records.signals else name[0] + SAME_IN_REGIONS[name[1:]])


# --- beats that were not found, in words ------------------------------------------------------------


SOLVED_STATUSES = (Status.CONVERGED.word, GasStatus.STEADY.word)
GASES = "gas state"
WITHOUT_CRRT = "without CRRT"
REASONS = {
    "no_ejection": "the native heart ejects next to nothing",
    "not_converged": "the search for it did not converge",
    "not_finite": "pressures or flows became infinite",
    "one_of_many": "valves stay shut, so that the volumes depend on where the computation began",
    "invalid_input": "a value is not allowed",
    "no_oxygen": "a tissue gets less than a tenth of the oxygen that it needs",
    "no_removal": "carbon dioxide is hardly removed",
}
"""Reason in words, by status."""
MOST_SPEEDS_NAMED = 4


@dataclass(frozen=True, slots=True)
class MissingBeats:
    """Beats of one scheme, or their gas states, that were not found for the same reason.

    Args:
        policy: blood volume policy.
        place: "scheme a" or "without CRRT".
        speeds: pump speeds [rpm].
        status: how the search ended, in lower case.
        condition: further condition of these beats.
        state: kind of state that was not found, "beat" or "gas state".
    """

    policy: str
    place: str
    speeds: tuple[float, ...]
    status: str
    condition: str = ""
    state: str = "beat"

    @property
    def reason(self) -> str:
        """Speeds without a steady state, and the reason."""
        return speeds_without_solution(self.speeds, [self.status] * len(self.speeds), self.state)

    @property
    def sentence(self) -> str:
        """Place and speeds without a steady state, and the reason."""
        return f"{f'{self.place} {self.condition}'.strip()}: {self.reason}"

    @property
    def advice(self) -> str:
        """Meaning of the status, with advice."""
        return (GasStatus if self.state == GASES else Status)[self.status.upper()].message


def speeds_without_solution(speeds: Sequence[float], statuses: Sequence[str], state: str = "beat") -> str:
    """Speeds without a steady beat or gas state, with reasons; empty if all were found.

    Args:
        speeds: pump speeds [rpm].
        statuses: status for each speed; speeds with a solution are left out.
        state: kind of state, "beat" or "gas state".
    """
    reasons = dict.fromkeys(status for status in statuses if status not in SOLVED_STATUSES)
    messages = []
    for reason in reasons:
        affected = [v for v, status in zip(speeds, statuses, strict=True) if status == reason]
        messages.append(f"no steady {state} at {speeds_text(affected)} ({REASONS[reason]})")
    return ", ".join(messages)


def speeds_text(speeds: Sequence[float]) -> str:
    """List a few speeds, or of many the first, the last and the number."""
    numbers = [f"{speed:.0f}" for speed in speeds]
    if len(numbers) > MOST_SPEEDS_NAMED:
        return f"{len(numbers)} speeds from {numbers[0]} to {numbers[-1]} rpm"
    return f"{joined_with_and(numbers)} rpm"


def joined_with_and(names: Sequence[str]) -> str:
    """Words with commas and an "and" before the last."""
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def unsettled(study: CrrtStudy) -> tuple[MissingBeats, ...]:
    """All beats that were not found, by policy, scheme and reason."""
    result: list[MissingBeats] = []
    for policy in study.policies:
        for letter in study.means["scheme"].values.astype(str):
            result += _grouped(policy, f"scheme {letter}", study.means.sel(policy=policy, scheme=letter))
        result += _grouped(policy, WITHOUT_CRRT, study.without_crrt.sel(policy=policy))
    return (*result, *_primed(study))


def _grouped(policy: str, place: str, data: xr.Dataset) -> Iterator[MissingBeats]:
    """One entry for each reason; gas states of beats that were not found are left out."""
    speeds, beats = data["speed"].values, data["status"].values.astype(str)
    kinds = {"beat": beats}
    if "gas_status" in data:
        kinds[GASES] = np.where(data["converged"], data["gas_status"], SOLVED_STATUSES[1]).astype(str)
    for state, reasons in kinds.items():
        for reason in dict.fromkeys(reason for reason in reasons if reason not in SOLVED_STATUSES):
            yield MissingBeats(policy, place, tuple(speeds[reasons == reason].tolist()), reason, state=state)


def _primed(study: CrrtStudy) -> Iterator[MissingBeats]:
    """Schemes whose beat with the blood volume of the patient without CRRT was not found."""
    if study.uptake is None:
        return
    letters, statuses = (study.uptake[name].values.astype(str) for name in ("scheme", "status"))
    for letter, status in zip(letters, statuses, strict=True):
        if status not in (*SOLVED_STATUSES, NOT_COMPUTED):
            yield MissingBeats("patient_held", f"scheme {letter}", (study.case_speed,), status, PRIMED)


PRIMED = "with the volume of the patient without CRRT"
NOT_COMPUTED = "not_computed"
"""Status of a beat that was not computed because the beat to compare with was not found."""


MOST_LINES = 20


def missing_beats_text(study: CrrtStudy) -> list[str]:
    """Every beat or gas state that was not found, with reason and advice; empty if all were found."""
    places_of: dict[MissingBeats, list[str]] = {}
    for entry in study.unsettled:
        places_of.setdefault(replace(entry, place=""), []).append(entry.place)
    lines = []
    for entry, places in places_of.items():
        how = entry.condition or POLICY_WORDS[entry.policy].partition(":")[0]
        lines.append(f"{_places(places)}, {how}: {entry.reason}")
    if len(lines) > MOST_LINES:
        lines = [*lines[:MOST_LINES], f"and {len(lines) - MOST_LINES} more, see the list in the JSON object"]
    if study.samples_without_a_beat and study.uncertainty is not None:
        count = ", ".join(f"{number} (scheme {k})" for k, number in study.samples_without_a_beat.items())
        total = study.uncertainty.attrs["samples"]
        what = "Samples of the patient's parameters without a steady beat that a patient can have"
        lines.append(f"{what}, of {total}: {count}")
    advice = dict.fromkeys(entry.advice for entry in study.unsettled)
    return [*lines, *(f"What this means: {text}" for text in advice)]


def _places(places: list[str]) -> str:
    """Combine places of one kind, such as "schemes a, b and c"."""
    letters = [place.removeprefix("scheme ") for place in places if place.startswith("scheme ")]
    others = [place for place in places if not place.startswith("scheme ")]
    terms = [schemes_named(letters)] if letters else []
    sentence = joined_with_and([*terms, *others])
    return sentence[0].upper() + sentence[1:]


def schemes_named(letters: list[str]) -> str:
    """Text such as "Scheme a" or "Schemes a, b and c"."""
    return f"Scheme{'s' if len(letters) > 1 else ''} {joined_with_and(letters)}"


# --- the nine schemes at one speed as plain data, for the page -------------------------------------


LINES = {
    line: (output, f"P{CRRT.lines[f'{line}_site']}")
    for line, output in (("access", "crrt_access_pressure"), ("return", "crrt_return_pressure"))
}
"""Output and waveform of each line's pressure."""
POINTS = 60


def line_pressures_of_nine_schemes(case: Case, policy: str) -> dict[str, object] | None:
    """Pressures of both lines in each scheme; None without a rotary ECMO pump or with named CRRT sections.

    A scheme with a beat that no patient can have is not `possible` and has no waveforms.
    """
    from eclsim.crrt_study.schemes import named_crrts, nine_schemes

    if case.ecmo is None or not isinstance(case.ecmo.pump, str) or named_crrts(case):
        return None

    chosen = tuple(nine_schemes().values())
    flow = float(CRRT.usual["flow_ml_min"]) if case.crrt is None else case.crrt.flow_ml_min
    circuits = study_circuits(case, chosen, flow)
    result = circuits.run(np.array([float(case.ecmo.speed_rpm or 0.0)]), policy, keep=range(len(chosen)))
    even = np.linspace(0.0, 1.0, POINTS)
    cells = []
    for k, scheme in enumerate(chosen):
        cell: dict[str, object] = {
            "letter": scheme.letter, "name": scheme.name,
            "settings": {"crrt.access_site": scheme.access_site, "crrt.return_site": scheme.return_site},
            "converged": bool(result.determined[k]), "steady": bool(result.converged[k]),
            "MAP": {"mean": (pressure := float(result.output("MAP")[k])), "level": level("MAP", pressure)},
            "possible": not impossible(result.findings(k)),
        }  # fmt: skip
        for line, (output, signal) in LINES.items():
            mean = float(result.mean(signal)[k])
            wave = np.interp(even, result.waveforms[k].phases, result.waveform(signal, k))
            shown = wave if cell["converged"] and cell["possible"] else []
            cell[line] = {"mean": mean, "level": level(output, mean), "wave": shown}
        cells.append(finite(cell, digits=5))
    limits = {
        line: sorted(limit.value for limit in limits_of(output) if limit.kind == "alarm")
        for line, (output, _) in LINES.items()
    }
    return {"cells": cells, "flow": flow, "limits": limits, "device": CRRT.key}
