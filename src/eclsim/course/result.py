"""A course as a labelled dataset, by steady beats or beat by beat."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from eclsim.circuit.network import BLOOD_VOLUME
from eclsim.course.alarms import Alarm, after_arrest, clock_time
from eclsim.course.drug_remarks import remarks_on_drugs
from eclsim.course.fluid_remarks import remarks_on_fluids
from eclsim.course.laws import Laws
from eclsim.course.timeline import MINUTE, Timeline
from eclsim.devices.description import CAUTION, Finding, labelled_sentence
from eclsim.files import ORIGIN
from eclsim.fluid.law import GIVEN, REFILLED, REMOVED
from eclsim.orbit.model import CASE, case_record
from eclsim.orbit.status import Status
from eclsim.outputs.alarms import doubted_outputs
from eclsim.outputs.gas import LUNG_FLOW, OF_LUNG_FLOW, lung_blood_stands
from eclsim.outputs.limits import consecutive_runs
from eclsim.outputs.results import output_labels, variable
from eclsim.outputs.uncertainty import misses_of
from eclsim.parameters.regulation import EXTRA_VOLUME
from eclsim.slow import DerivedQuantity

MOST_SPANS = 4
TIME, IMPOSSIBLE = "time_min", "impossible"
BALANCE_TERMS = {"given_ml": GIVEN, "removed_ml": REMOVED, "refilled_ml": REFILLED}
BALANCE = (*BALANCE_TERMS, "blood_volume_start_ml", "blood_volume_end_ml", "error_ml")


def labelled_course(
    time: np.ndarray,
    outputs: Mapping[str, np.ndarray],
    laws: Laws,
    states: np.ndarray,
    derived: Sequence[DerivedQuantity],
) -> xr.Dataset:
    """Return outputs, slow states and quantities derived from them over time, each with its unit.

    Args:
        time: times of the moments [s].
        outputs: outputs at the moments, by name in the registry.
        laws: laws of the slow states.
        states: slow states at the moments, shape (states, moments).
        derived: quantities derived from them at the moments.
    """
    data = {name: variable(TIME, values, **output_labels(name)) for name, values in outputs.items()}
    for row, state in zip(states, laws.states, strict=True):
        shown = np.where(row < 0.0, 0.0, row) if state.fades else row
        data[state.name] = variable(TIME, shown, units=state.unit, long_name=f"slow state: {state.words}")
    for quantity in derived:
        data[quantity.name] = variable(
            TIME, quantity.values, units=quantity.unit, long_name=quantity.description
        )
    axis = variable(TIME, time / MINUTE, units="min", long_name="time from the start")
    return xr.Dataset(data, coords={TIME: axis})


def attributes_of(
    timeline: Timeline,
    policy: str,
    message: str,
    balance: Mapping[str, float],
    warnings: Sequence[str],
    approximations: Sequence[str] = (),
    remarks: Sequence[str] = (),
) -> dict[str, Any]:
    """Attributes of every course; `message` is the reason for an early end, empty if there was none.

    `approximations` lists where steady beats replace transients; `cautions` lists where the model differs
    from patients for fluid given or lost, the last of them `remarks` on the course itself. Both are also
    among `warnings`. `balance` is empty if the course did not begin. `case_values` are parameters that differ
    from those of the case, such as those of a draw.
    """
    cautions = []
    if balance:  # a course that did not begin may lack the values to remark on, such as a pump speed
        cautions = [*remarks_on_fluids(timeline), *remarks_on_drugs(timeline), *remarks]
    return {
        **ORIGIN,
        "id": timeline.case.patient.id,
        CASE: json.dumps(case_record(timeline.case, policy)),
        "case_values": json.dumps(dict(timeline.overrides)),
        "converged": int(not message),
        "status": "stopped" if message else "finished",
        "message": message,
        "balance": json.dumps(balance),
        "events": json.dumps([event.as_object() for event in timeline.case.events]),
        "warnings": [
            *timeline.case.doubts, *warnings, *approximations, *timeline.cut_short(),
            *(labelled_sentence(CAUTION, text) for text in cautions),
        ],
        "approximations": list(approximations),
        "cautions": cautions,
        "blood_volume_policy": policy,
    }  # fmt: skip


def remarks_on_measurements(timeline: Timeline, outputs: Mapping[str, np.ndarray]) -> list[str]:
    """A sentence if a course does not begin with the beat of the patient who was measured, else none.

    Args:
        timeline: timeline of the course; variants such as draws of a posterior have no sentence.
        outputs: outputs at the moments, by name.
    """
    if timeline.overrides:
        return []
    first = {name: float(values[0]) for name, values in outputs.items() if len(values)}
    return misses_of(timeline.case, first, "the beat at 00:00")


def balance_of(laws: Laws, states: np.ndarray, in_effect: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Balance of the patient's blood volume [mL]; `error_ml` is the part that is not accounted for.

    Args:
        laws: laws of the slow states.
        states: slow states at all moments, shape (states, moments).
        in_effect: parameters at the moments, by key.
    """
    if not states.shape[-1]:
        return dict.fromkeys(BALANCE, 0.0)
    change = dict(zip(laws.names, states[:, -1] - states[:, 0], strict=True))
    doors = {key: float(change.get(name, 0.0)) for key, name in BALANCE_TERMS.items()}
    before, after = (float(in_effect[BLOOD_VOLUME][k] + in_effect[EXTRA_VOLUME][k]) for k in (0, -1))
    moved = doors["given_ml"] - doors["removed_ml"] + doors["refilled_ml"]
    ends = {"blood_volume_start_ml": before, "blood_volume_end_ml": after}
    return doors | ends | {"error_ml": after - before - moved}


def impossible_among(
    moment_findings: Sequence[Sequence[Finding]], arrest: Sequence[Alarm], minute: np.ndarray
) -> xr.Variable:
    """Whether at each moment a chamber is empty, a vein sucked shut or the patient not alive: `IMPOSSIBLE`.

    Args:
        moment_findings: findings of each moment.
        arrest: alarm of an arrest that is not survived, if there is one.
        minute: time of each moment [min].
    """
    collapses = [any(finding.kind == "collapse" for finding in findings) for findings in moment_findings]
    return variable(TIME, (np.array(collapses, dtype=bool) | after_arrest(arrest, minute)).astype(int))


def mark_read_with_care(result: xr.Dataset, moment_findings: Iterable[Sequence[Finding]]) -> None:
    """Set the attribute `read_with_care` of each output that a caution concerns at any moment to 1."""
    for name in doubted_outputs(finding for findings in moment_findings for finding in findings):
        if name in result:
            result[name].attrs["read_with_care"] = 1


def impossible_moments(result: xr.Dataset) -> np.ndarray:
    """Whether each moment of a course is impossible; all False if limits were not checked."""
    return result[IMPOSSIBLE].to_numpy() == 1 if IMPOSSIBLE in result else np.zeros(result.sizes[TIME], bool)


def undetermined_moments(result: xr.Dataset) -> np.ndarray:
    """Whether the beat of each moment of a course is one of many; what the case does not determine is NaN."""
    known = result["status"].to_numpy() if "status" in result else np.zeros(result.sizes[TIME], str)
    return known == Status.ONE_OF_MANY.word


def has_standing_lung_blood(result: xr.Dataset) -> bool:
    """Whether blood in the pulmonary artery stands still at some moment, so that its gases are NaN."""
    if LUNG_FLOW not in result or not {*OF_LUNG_FLOW} & {*result.data_vars}:
        return False
    return bool(lung_blood_stands(result[LUNG_FLOW].to_numpy()).any())


def undetermined_in_words(minute: np.ndarray, undetermined: np.ndarray) -> str:
    """Sentence on the moments whose beats are one of many; empty if there are none."""
    runs = consecutive_runs(np.flatnonzero(undetermined).tolist())
    if not runs:
        return ""
    named = [
        clock_time(minute[run[0]])
        + (f" to {clock_time(minute[run[-1] + 1])}" if run[-1] + 1 < len(minute) else " on")
        for run in runs[:MOST_SPANS]
    ]
    further = f" and {len(runs) - MOST_SPANS} more times" if len(runs) > MOST_SPANS else ""
    return (
        f"valves stay shut from {', from '.join(named)}{further}: pressures and volumes that the case does "
        "not determine are left blank there and raise no alarms; slow states that depend on them, as plasma "
        "and interstitium do, continue with those of one possible beat"
    )


def spans_in_words(result: xr.Dataset, reasons: bool = False) -> str:
    """Sentence on the spans in which every beat was followed; empty if there are none.

    Args:
        result: a course.
        reasons: whether the reason of each span follows in brackets.
    """
    spans = json.loads(result.attrs.get("spans", "[]"))
    if not spans:
        return ""
    named = [
        f"{clock_time(s['from_min'], True)} to {clock_time(s['until_min'], True)}"
        + (f" ({s['reason']})" if reasons else "")
        for s in spans[:MOST_SPANS]
    ]
    further = f" and {len(spans) - MOST_SPANS} more" if len(spans) > MOST_SPANS else ""
    return f"followed beat by beat {', '.join(named)}{further}"
