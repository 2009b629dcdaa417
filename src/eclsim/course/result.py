"""A course as a labelled result, whether it is of steady beats or of every beat."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from eclsim.circuit.network import BLOOD_VOLUME
from eclsim.course.alarms import clock_time
from eclsim.course.fluid_remarks import remarks_on_fluids
from eclsim.course.laws import Laws
from eclsim.course.timeline import MINUTE, Timeline
from eclsim.fluid.law import GIVEN, REFILLED, REMOVED
from eclsim.orbit.model import CASE, case_record
from eclsim.outputs.results import output_labels, variable
from eclsim.parameters.regulation import EXTRA_VOLUME

if TYPE_CHECKING:
    from eclsim.devices.description import Finding

MOST_SPANS = 4
TIME, IMPOSSIBLE = "time_min", "impossible"
BALANCE_TERMS = {"given_ml": GIVEN, "removed_ml": REMOVED, "refilled_ml": REFILLED}
BALANCE = (*BALANCE_TERMS, "blood_volume_start_ml", "blood_volume_end_ml", "error_ml")


def labelled_course(
    time: np.ndarray,
    outputs: Mapping[str, np.ndarray],
    laws: Laws,
    states: np.ndarray,
    in_effect: Mapping[str, np.ndarray],
) -> xr.Dataset:
    """Outputs and slow states over time, with what these mean to a reader, each with its unit.

    Args:
        time: of the moments [s].
        outputs: values at these, by name of the registry.
        laws: of the slow states.
        states: at these, shape (states, moments).
        in_effect: parameters at these, by key.
    """
    data = {name: variable(TIME, values, **output_labels(name)) for name, values in outputs.items()}
    for row, state in zip(states, laws.states, strict=True):
        data[state.name] = variable(TIME, row, units=state.unit, long_name=f"slow state {state.name}")
    for quantity in laws.derived_quantities(states, in_effect):
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
) -> dict[str, Any]:
    """Attributes of every course; `message` is why it ended early, empty where it did not.

    `approximations` says where steady beats stand for what takes time, `cautions` what of the fluid that is
    given and lost a course does not hold as patients do; both are among `warnings`, too. `balance` is empty
    where nothing began. `case_values` are parameters that are others than the case's, as of a draw.
    """
    cautions = remarks_on_fluids(timeline) if balance else []  # none of a patient who did not begin
    return {
        "id": timeline.case.patient.id,
        CASE: json.dumps(case_record(timeline.case, policy)),
        "case_values": json.dumps(dict(timeline.overrides)),
        "converged": int(not message),
        "status": "stopped" if message else "finished",
        "message": message,
        "balance": json.dumps(balance),
        "events": json.dumps([event.as_object() for event in timeline.case.events]),
        "warnings": [*timeline.case.doubts, *warnings, *approximations, *timeline.cut_short(), *cautions],
        "approximations": list(approximations),
        "cautions": cautions,
        "blood_volume_policy": policy,
    }


def balance_of(laws: Laws, states: np.ndarray, in_effect: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Where the patient's blood volume went [mL]; `error_ml` is what does not add up.

    Args:
        laws: of the slow states.
        states: at all moments, shape (states, moments).
        in_effect: parameters at these, by key.
    """
    if not states.shape[-1]:
        return dict.fromkeys(BALANCE, 0.0)
    change = dict(zip(laws.names, states[:, -1] - states[:, 0], strict=True))
    doors = {key: float(change.get(name, 0.0)) for key, name in BALANCE_TERMS.items()}
    before, after = (float(in_effect[BLOOD_VOLUME][k] + in_effect[EXTRA_VOLUME][k]) for k in (0, -1))
    moved = doors["given_ml"] - doors["removed_ml"] + doors["refilled_ml"]
    ends = {"blood_volume_start_ml": before, "blood_volume_end_ml": after}
    return doors | ends | {"error_ml": after - before - moved}


def impossible_among(moment_findings: Sequence[Sequence[Finding]]) -> xr.Variable:
    """At which moments a chamber is without blood or a vein sucked shut, as no patient is; `IMPOSSIBLE`."""
    collapses = [any(finding.kind == "collapse" for finding in findings) for findings in moment_findings]
    return variable(TIME, np.array(collapses, dtype=int))


def impossible_moments(result: xr.Dataset) -> np.ndarray:
    """The same of a course; none where limits were not looked at."""
    return result[IMPOSSIBLE].to_numpy() == 1 if IMPOSSIBLE in result else np.zeros(result.sizes[TIME], bool)


def spans_in_words(result: xr.Dataset) -> str:
    """Where every beat was followed; empty where steady beats served all along."""
    spans = json.loads(result.attrs.get("spans", "[]"))
    if not spans:
        return ""
    named = [
        f"{clock_time(s['from_min'], True)} to {clock_time(s['until_min'], True)}" for s in spans[:MOST_SPANS]
    ]
    further = f" and {len(spans) - MOST_SPANS} more" if len(spans) > MOST_SPANS else ""
    return f"followed beat by beat {', '.join(named)}{further}"
