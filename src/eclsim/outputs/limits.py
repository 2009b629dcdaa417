"""Limits of patient and circuit with their sources, for command line, figures and bedside page.

A limit belongs to an output of `eclsim.outputs.registry`. Limits do not judge a patient: they mark simulated
numbers for which a clinician would be called, or which are impossible.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from eclsim.devices.description import GRAVEST_FIRST, Limit
from eclsim.devices.registry import cached_by_devices, devices, named_output
from eclsim.files import grouped_by, read_table
from eclsim.outputs.registry import listed_as
from eclsim.patient.anthropometry import AGE, SIZE, body_surface, delivery_limits, greatest_heart_rate

NO_VALUES: Mapping[str, float] = MappingProxyType({})
CLOSED_L_MIN = 0.02
"""Mean flow below which a valve counts as closed during the whole beat."""
STOPPED_L_MIN = 1e-6
"""Mean flow up to which a roller pump counts as stopped."""
_GREATEST_RATE_SPREAD = 10.0
"""Standard deviation of the greatest heart rate of one age [bpm] (9 and 11, Christou and Seals 2008)."""
HEART_RATE, SAME_RATE = "heart_rate_bpm", 1e-6
"""The patient's own heart rate, and relative change up to which it counts as unchanged."""
_RANUCCI = "280 mL/min/m2 (Ranucci et al. 2005)"
_RONCO = "4.5 mL/min/kg at 67 kg and 1.8 m2 (Ronco et al. 1993)"
_TOO_FAST = "faster than a sinus node of this age: the curves of reflex and drugs have no upper limit"


def _limit(row: Mapping[str, Any]) -> Limit:
    return Limit(
        row["quantity"], row["kind"], row["side"], float(row["value"]), row["meaning"], row["source"],
        row["unassisted"] == "yes", tuple(row["without"].split()),
    )  # fmt: skip


_TABLE = {
    part: tuple(map(_limit, rows))
    for part, rows in grouped_by("part", read_table(Path(__file__).with_suffix(".csv"))).items()
}
_IMPOSSIBLE, _REGULATED = _TABLE["impossible"], _TABLE["regulated"]
_OF_PATIENT = (*_IMPOSSIBLE, *_TABLE["patient"], *_REGULATED)
COURSE_LIMITS = _TABLE["course"]
"""Limits of quantities that exist only in courses and are no outputs of a beat."""

_EQUIVALENT_OUTPUTS = (
    ("right_atrial_pressure", "venous_pressure", "superior_caval_pressure", "inferior_caval_pressure"),
    ("PCWP", "left_atrial_pressure", "end_diastolic_pressure_lv"),
    ("caval_filling", "superior_caval_filling", "inferior_caval_filling"),
    ("SaO2", "SaO2_lower"),
    ("PaO2", "PaO2_lower"),
    ("PaCO2", "PaCO2_lower"),
)
"""Groups of equivalent outputs; only the most severe of their violated limits is reported."""
_PLACES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "ao": ("MAP", "pulse_pressure"),
        "sart": ("MAP",),
        "svn": ("venous_pressure", "caval_filling"),
        "svc": ("superior_caval_pressure", "superior_caval_filling"),
        "ivc": ("inferior_caval_pressure", "inferior_caval_filling"),
        "ra": ("right_atrial_pressure",),
        "pas": ("MPAP",),
        "part": ("MPAP",),
        "pvn": ("PCWP",),
        "la": ("left_atrial_pressure",),
        "lv": ("end_diastolic_pressure_lv", "ejection_fraction_lv"),
        "rv": ("ejection_fraction_rv",),
    }
)
"""By compartment, the outputs whose limits apply to it, for pictures of the circuit."""


def all_limits() -> tuple[Limit, ...]:
    """All limits of the patient, and of each device as the only instance of its kind."""
    return (*_OF_PATIENT, *(limit for device in devices().values() for limit in device.limits))


def limits_of(
    quantity: str, outputs: Collection[str] = (), values: Mapping[str, float] = NO_VALUES
) -> tuple[Limit, ...]:
    """Limits of an output, the most severe first.

    Args:
        quantity: name of the output.
        outputs: names of all outputs of the circuit; some limits apply only without an assist pump, others
            only without a more specific output.
        values: parameters of the patient; limits of oxygen delivery depend on body size, those of the heart
            rate on age.
    """
    known, listed = named_output(quantity), listed_as(quantity)
    limits = _OF_PATIENT if known is None else known[0].device.limits
    result = [replace(limit, quantity=quantity) for limit in limits if limit.quantity == listed]
    if any(limit.unassisted for limit in result) and _assisted(outputs):
        result = [limit for limit in result if not limit.unassisted]
    result = [limit for limit in result if not set(limit.without) & set(outputs)]
    return tuple(of_patient(sorted(result, key=lambda limit: GRAVEST_FIRST.index(limit.kind)), values))


def of_patient(limits: Iterable[Limit], values: Mapping[str, float]) -> list[Limit]:
    """Return limits adapted to the patient: oxygen delivery to body size, heart rate to age.

    Args:
        limits: limits of any outputs.
        values: parameters of the patient.
    """
    own = _of_size(values) | _of_age(values)
    keys = ((limit, (limit.quantity, limit.kind)) for limit in limits)
    return [replace(limit, **own[key]) if key in own else limit for limit, key in keys]


def _of_size(values: Mapping[str, float]) -> dict[tuple[str, str], dict[str, Any]]:
    """Limits of oxygen delivery for a patient who is not as large as that of the table."""
    height, weight = (values.get(name) for name in SIZE)
    own = None if height is None or weight is None else delivery_limits(height, weight)
    if own is None:
        return {}
    assert height is not None
    assert weight is not None
    size = f"with the {body_surface(height, weight):.2f} m2 of this patient"
    sources = {"warning": f"{_RANUCCI}, {size}", "alarm": f"{_RONCO}, {size}"}
    return {
        ("DO2", kind): {"value": value, "source": source}
        for value, (kind, source) in zip(own, sources.items(), strict=True)
    }


def _of_age(values: Mapping[str, float]) -> dict[tuple[str, str], dict[str, Any]]:
    """Limits of the heart rate for a patient whose greatest rate is below that of the table."""
    age = values.get(AGE)
    usual = {limit.kind: limit.value for limit in _REGULATED if limit.quantity == "heart_rate"}
    if age is None or (greatest := greatest_heart_rate(age)) >= usual["alarm"]:
        return {}
    source = f"greatest heart rate at {age:g} years: 208 - 0.7 age, Tanaka et al. 2001"
    alarm = {"value": greatest, "meaning": _TOO_FAST, "source": source}
    below = greatest - _GREATEST_RATE_SPREAD
    warned = {"value": below, "source": f"{_GREATEST_RATE_SPREAD:g} bpm below the {source}"}
    return {("heart_rate", "alarm"): alarm} | (
        {("heart_rate", "warning"): warned} if below < usual["warning"] else {}
    )


def _assisted(outputs: Collection[str]) -> bool:
    known = (named_output(name) for name in outputs)
    return any(result and result[1].name == result[0].device.assist_flow for result in known)


def impossible_bounds(outputs: Collection[str]) -> tuple[Limit, ...]:
    """Bounds beyond which no patient can be, of vein filling and of ejecting chambers.

    Args:
        outputs: names of all outputs of the circuit.
    """
    return tuple(limit for name in outputs for limit in limits_of(name, outputs) if limit in _IMPOSSIBLE)


def backward_flow_bounds(outputs: Collection[str]) -> tuple[Limit, ...]:
    """Alarms for backward flow through a device [L/min].

    Args:
        outputs: names of all outputs of the circuit.
    """
    flows = [name for name in outputs if (known := named_output(name)) and known[1].unit == "L/min"]
    bounds = (limit for name in flows for limit in limits_of(name, outputs) if limit.side == "below")
    return tuple(limit for limit in bounds if limit.kind == "alarm" and -0.1 < limit.value <= 0.0)


def level(quantity: str, value: float) -> str:
    """Level of a value with respect to the limits of its output: "ok", "warning", "alarm" or "collapse".

    Args:
        quantity: name of the output.
        value: value in the output's unit.
    """
    return next((limit.kind for limit in limits_of(quantity) if limit.broken_by(value)), "ok")


def levels(outputs: Mapping[str, float], values: Mapping[str, float] = NO_VALUES) -> dict[str, str]:
    """Level of each output of a beat; see `level`.

    Args:
        outputs: values by name.
        values: parameters of the patient.
    """
    result = dict.fromkeys(outputs, "ok")
    for limit in reversed(applied_limits(outputs, values)):
        if limit.broken_by(outputs[limit.quantity]):
            result[limit.quantity] = limit.kind
    return result


def gravest(levels: Iterable[str]) -> str:
    """The most severe of several levels; "ok" if there are none."""
    result = set(levels)
    return next((kind for kind in GRAVEST_FIRST if kind in result), "ok")


@cached_by_devices(256)
def places_with_limits(outputs: Collection[str]) -> Mapping[str, tuple[str, ...]]:
    """Outputs whose limits apply to a compartment, by compartment.

    For devices, these are outputs with limits that depend only on the pressure of the compartment.

    Args:
        outputs: names of all outputs of the circuit.
    """
    result = dict(_PLACES)
    for name in outputs:
        known = named_output(name)
        if known is None:
            continue
        names, entry = known
        limited = any(limit.quantity == entry.name for limit in names.device.limits)
        if limited and len(entry.needs) == 1 and entry.needs[0][0] == "P":
            place = names.signal(entry.needs[0])[1:]
            result[place] = (*result.get(place, ()), name)
    return result


def place_levels(levels: Mapping[str, str]) -> dict[str, str]:
    """The most severe level of the outputs of each compartment.

    Args:
        levels: level of each output of the circuit by name.
    """
    return {
        place: gravest(levels[name] for name in names if name in levels)
        for place, names in places_with_limits(levels).items()
    }


def broken_limits(outputs: Mapping[str, float], values: Mapping[str, float] = NO_VALUES) -> list[Limit]:
    """Limits that a beat violates, the most severe first; only one of equivalent outputs.

    Args:
        outputs: values by name.
        values: parameters of the patient.
    """
    result: dict[tuple[str, str], Limit] = {}
    for limit in applied_limits(outputs, values):
        if limit.broken_by(outputs[limit.quantity]):
            result.setdefault((group_of(limit.quantity), limit.side), limit)
    return list(result.values())


def consecutive_runs(places: Sequence[int]) -> list[list[int]]:
    """Split the indices of moments or values at which a limit is violated into runs of consecutive ones."""
    runs: list[list[int]] = []
    for place in places:
        if not runs or place != runs[-1][-1] + 1:
            runs.append([])
        runs[-1].append(place)
    return runs


def applied_limits(outputs: Mapping[str, float], values: Mapping[str, float]) -> list[Limit]:
    """Limits of a beat's outputs by severity; the heart rate is included if it is not the patient's own."""
    limits = [limit for limit in of_patient(_in_order(outputs), values) if _runs(limit, outputs)]
    rate, own = outputs.get("heart_rate"), values.get(HEART_RATE)
    if rate is None or own is None or abs(rate - own) > SAME_RATE * own:
        return limits
    return [limit for limit in limits if limit.quantity != "heart_rate"]


def _runs(limit: Limit, outputs: Mapping[str, float]) -> bool:
    """Whether the pump on which a limit depends runs; nobody sees alarms of a machine that is stopped."""
    known = named_output(limit.quantity) if limit.running else None
    return known is None or abs(outputs.get(known[0].output(limit.running), 1.0)) > STOPPED_L_MIN


@cached_by_devices(256)
def _in_order(outputs: Collection[str]) -> tuple[Limit, ...]:
    """Limits of outputs by severity and, if equally severe, in the order of `all_limits`."""
    order = {_published(limit): position for position, limit in enumerate(all_limits())}
    limits = [limit for name in outputs for limit in limits_of(name, outputs)]
    return tuple(
        sorted(limits, key=lambda limit: (GRAVEST_FIRST.index(limit.kind), order[_published(limit)]))
    )


def _published(limit: Limit) -> tuple[str, str, str]:
    """Quantity (as listed), kind and side of a limit."""
    return listed_as(limit.quantity), limit.kind, limit.side


def group_of(quantity: str) -> str:
    """First of a group of equivalent outputs; the output itself if it is in no group."""
    known = named_output(quantity)
    if known is None:
        listed = listed_as(quantity)
        return next((names[0] for names in _EQUIVALENT_OUTPUTS if listed in names), listed)
    names, entry = known
    return next((names.output(alike[0]) for alike in names.device.alike if entry.name in alike), quantity)
