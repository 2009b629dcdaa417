"""Events of a course, `[[events]]` in a case file: changes of settings, and fluid and blood given or lost."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from pydantic import BaseModel, ConfigDict
from pydantic import Field as Default

from eclsim.cases.quantities import quantity, section_and_key
from eclsim.cases.sections import RISE
from eclsim.cases.settings import keys_replaced_by, put_in, unknown_key
from eclsim.devices.registry import example_setting
from eclsim.inputs.fields import number, setting
from eclsim.inputs.mistakes import Mistake, Remarks, shown
from eclsim.inputs.numbers import is_number
from eclsim.inputs.sections import Raw, check_field, short
from eclsim.parameters import dialysed_drug as drug
from eclsim.parameters.fluid import sets_initial_value
from eclsim.slow import DOSE, INFLOWS, kind_and_unit
from eclsim.spelling import did_you_mean
from eclsim.units import with_micro_sign

LONGEST_MIN = 31 * 1440.0
"""Longest course [min]."""
QUICKEST_MIN = 1.0
"""Time in which volumes given without `over_min` are infused [min]: a bolus takes a minute."""
LARGEST_ML = 20_000.0
CLASS_IV = 0.4
"""Share of the blood whose loss is class IV of Advanced Trauma Life Support (10th edition, 2018)."""
OPPOSITE = {"blood_ml": "bleed_ml", "bleed_ml": "blood_ml"}
_TIMES = {
    "at_min": number("When it begins, in minutes from the start", "min", 0, LONGEST_MIN, 60),
    "ramp_min": number("Time over which the settings change linearly; 0: at once", "min", 0, LONGEST_MIN, 5),
    "over_min": number("Time over which it is given", "min", 0.1, LONGEST_MIN, 30),
}
_AMOUNT = number("Volume", "mL", 0, LARGEST_ML, 500)
_DOSE = replace(setting(drug.PARAMETERS[drug.DOSE]), name=DOSE)
KEYS = ("at_min", "set", "ramp_min", "give", "over_min")
Path = tuple[str, str]
"""Section and key of a setting."""
BODY_KEYS = {("patient", name) for name in ("sex", "age_years", "height_cm", "weight_kg")}
"""Settings that determine a patient's blood volume at the start."""
FILLING = "P0"
"""Prefix of the start pressures' names; these set the blood in each compartment at the start."""
Check = Callable[[Raw], Remarks]
_NEEDS_DRUG = f"a section [{drug.SECTION}], which says how the body handles it"


class Event(BaseModel):
    """One event of a course.

    Attributes:
        at_min: time at which the event begins [min from the start].
        set: new values of settings, by any key that `--set` takes.
        ramp_min: duration of the linear change of these settings [min]; 0 for an immediate change.
        give: volumes [mL] by kind, of which `bleed_ml` is lost; `drug_mg` of the drug of [dialysed_drug].
        over_min: duration over which it is given [min].
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    at_min: float
    set: dict[str, Any] = Default(default_factory=dict)
    ramp_min: float = 0.0
    give: dict[str, float] = Default(default_factory=dict)
    over_min: float = QUICKEST_MIN

    @property
    def summary(self) -> str:
        """Short description of the event, with units."""
        words = [f"{k} = {shown(value)[:40]} {_unit_of(k, value)}".strip() for k, value in self.set.items()]
        for name, amount in self.give.items():
            kind, unit = kind_and_unit(name)
            words.append(f"{kind} {amount:g} {unit}")
        return ", ".join(words)

    def as_object(self) -> dict[str, Any]:
        """Return the event as in a case file."""
        content = {"at_min": self.at_min}
        content |= {"set": dict(self.set), "ramp_min": self.ramp_min} if self.set else {}
        return content | ({"give": dict(self.give), "over_min": self.over_min} if self.give else {})


def _unit_of(key: str, value: object) -> str:
    """Return the unit of a setting as it is written; empty for a choice or a number without one."""
    known = quantity(key) if is_number(value) else None
    return "" if known is None or known.unit == "1" else with_micro_sign(known.unit)


def check_events(raw: object, case: Raw, blood_ml: float | None, check: Check, remarks: Remarks) -> list[Raw]:
    """Check the events of a case; nothing is raised.

    Args:
        raw: events of the case file, a list of tables.
        case: the case without events, as mappings.
        blood_ml: the patient's blood volume before the first event [mL]; None if unknown.
        check: function that checks a case given as mappings.
        remarks: collects errors, warnings and notes.

    Returns:
        The valid parts of the events.
    """
    if not isinstance(raw, Sequence) or isinstance(raw, str):
        remarks.error("events", "a list of events belongs here", shown(raw), "[[events]], in double brackets")
        return []
    checks = _EventChecker(case, check, remarks)
    events = [checks.event(f"events[{n}]", table) for n, table in enumerate(raw, start=1)]
    right = [event for event in events if event]
    _check_order(raw, remarks)
    _check_overlap(right, remarks)
    if blood_ml is not None:
        _check_blood(right, blood_ml, remarks)
    return [{k: v for k, v in event.items() if k != "place"} for event in right]


_TEMPERATURE = "gas.temperature_c"


class _EventChecker:
    """Checks events one after another, each against the case as the earlier events left it."""

    def __init__(self, case: Raw, check: Check, remarks: Remarks):
        self.case, self.check, self.remarks = dict(case), check, remarks
        checked = check(case)
        self.known = set(map(_key_and_message, checked.mistakes))
        self.doubted = set(map(_key_and_message, checked.warnings))

    def event(self, place: str, raw: object) -> dict[str, Any]:
        """Return the valid parts of an event; empty if its time is missing."""
        if not isinstance(raw, Mapping):
            self.remarks.error(place, "an event is a table", shown(raw), ", ".join(KEYS))
            return {}
        for key in raw:
            if key not in KEYS:
                hint = did_you_mean(str(key), KEYS)
                self.remarks.error(
                    f"{place}.{short(key)}", "unknown key", shown(raw[key]), ", ".join(KEYS), hint
                )
        values: dict[str, Any] = {"place": place}
        for key, field in _TIMES.items():
            if key in raw:
                check_field(f"{place}.{key}", raw[key], replace(field, name=key), values, self.remarks)
        self._whole(place, raw)
        if "set" in raw:
            values["set"] = self._settings(f"{place}.set", raw["set"], bool(values.get("ramp_min")))
        if "give" in raw:
            values["give"] = self._given(f"{place}.give", raw["give"])
        return values if "at_min" in values else {}

    def _whole(self, place: str, raw: Raw) -> None:
        if "at_min" not in raw:
            self.remarks.error(f"{place}.at_min", "missing", allowed=_TIMES["at_min"].allowed)
        if not {"set", "give"} & raw.keys():
            self.remarks.error(place, "nothing happens", allowed="set = { ... } or give = { ... }")
        for key, owner in (("ramp_min", "set"), ("over_min", "give")):
            if key in raw and owner not in raw:
                self.remarks.error(
                    f"{place}.{key}", f"is allowed only with {owner} = {{ ... }}", shown(raw[key])
                )

    def _given(self, place: str, raw: object) -> dict[str, float]:
        values: dict[str, float] = {}
        if not isinstance(raw, Mapping) or not raw:
            self.remarks.error(place, "volumes by kind belong here", shown(raw), "{ crystalloid_ml = 500 }")
            return values
        for kind, value in raw.items():
            if kind in OPPOSITE and is_number(value) and value < 0:
                allowed, instead = f"0 to {LARGEST_ML:g} mL", f"{OPPOSITE[kind]} = {-value:g}"
                self.remarks.error(f"{place}.{kind}", "is negative", shown(value), allowed, instead)
            elif kind in INFLOWS:
                check_field(f"{place}.{kind}", value, replace(_AMOUNT, name=kind), values, self.remarks)
            elif kind == DOSE and drug.SECTION in self.case:
                check_field(f"{place}.{kind}", value, _DOSE, values, self.remarks)
            elif kind == DOSE:
                self.remarks.error(f"{place}.{kind}", "the case has no drug", shown(value), _NEEDS_DRUG)
            else:
                known = (*INFLOWS, DOSE)
                hint = did_you_mean(str(kind), known)
                self.remarks.error(f"{place}.{short(kind)}", "unknown", shown(value), ", ".join(known), hint)
        return values

    def _settings(self, place: str, raw: object, ramped: bool) -> dict[str, Any]:
        values: dict[str, Any] = {}
        if not isinstance(raw, Mapping) or not raw:
            allowed = f'{{ "{example_setting()}" = 3600 }}'
            self.remarks.error(place, "values by key belong here", shown(raw), allowed)
            return values
        # The temperature is checked last, when it is known whether the oxygen consumption is set as well.
        for written, value in sorted(_flat(raw), key=lambda pair: pair[0] == _TEMPERATURE):
            path, key = section_and_key(written), f"{place}.{short(written)}"
            if path is None:
                self.remarks.mistakes.append(replace(unknown_key(written, value), key=key, file=""))
            elif path[0] == "measurements" or path == ("patient", "id"):
                self.remarks.error(key, "has no effect on a course", shown(value))
            elif sets_initial_value(".".join(path)) or path in BODY_KEYS or path[1].startswith(FILLING):
                message = "is a value at the start of the course, which computes its later values"
                self.remarks.error(key, message, shown(value), "give = { ... } changes blood and fluid")
            elif path[0] == drug.SECTION not in self.case:
                self.remarks.error(key, "the case has no drug", shown(value), _NEEDS_DRUG)
            elif path[1] == "flow_l_min" and "speed_rpm" in keys_replaced_by(*path):
                self.remarks.error(
                    key, "a course keeps the pump's speed, not its flow; set the speed", shown(value)
                )
            elif ramped and not is_number(value):
                self.remarks.error(key, "only numbers change over ramp_min", shown(value))
            elif self._allowed(key, path, value):
                values[path[1] if path[0] == "parameters" else ".".join(path)] = value
        self._check_temperature(place, values)
        return values

    def _check_temperature(self, place: str, values: Mapping[str, Any]) -> None:
        """Warn of a changed temperature where the oxygen consumption is given and so does not follow it."""
        gas = self.case.get("gas", {})
        follows = gas.get("vo2_ml_min") is None or gas.get(RISE)
        if _TEMPERATURE in values and not follows and "gas.vo2_ml_min" not in values:
            message = (
                f"consumption does not follow the temperature: set gas.vo2_ml_min too, or give gas.{RISE}; "
                "heart rate, contractility, vessels and drugs do not follow it in any case"
            )
            self.remarks.warning(f"{place}.{_TEMPERATURE}", message, shown(values[_TEMPERATURE]))

    def _allowed(self, key: str, path: Path, value: object) -> bool:
        """Whether the case with the value is valid; if so, later events are checked against this case."""
        own = (".".join(path), path[1])
        merged, remarks = put_in(self.case, {path: value})
        checked = self.check(merged)
        new = [mistake for mistake in checked.mistakes if _key_and_message(mistake) not in self.known]
        new += remarks.mistakes
        if new and all(one.message == "missing" and one.key.startswith(f"{path[0]}.") for one in new):
            message = f"the case has no [{path[0]}]; events change devices, and connect none"
            self.remarks.error(key, message, shown(value), f"[{path[0]}] in the case, or leave this key out")
            return False
        for refused in new:
            same_key = refused.key in own
            message = refused.message if same_key else f"{refused.key}: {refused.message}"
            self.remarks.error(key, message, shown(value), refused.allowed, refused.suggestion)
        for doubt in checked.warnings:
            if doubt.key in own and _key_and_message(doubt) not in self.doubted:
                self.doubted.add(_key_and_message(doubt))
                self.remarks.warning(key, doubt.message, shown(value), doubt.suggestion)
        if not new:
            self.case = merged
        return not new


def _key_and_message(mistake: Mistake) -> tuple[str, str]:
    return mistake.key, mistake.message


def _flat(raw: Raw, before: str = "") -> list[tuple[str, object]]:
    """Return keys and values, also where `ecmo.speed_rpm` was written without quotes."""
    result: list[tuple[str, object]] = []
    for key, value in raw.items():
        inner = isinstance(value, Mapping) and section_and_key(f"{before}{key}") is None
        result += _flat(value, f"{before}{key}.") if inner else [(f"{before}{key}", value)]
    return result


def _check_order(raw: Sequence[object], remarks: Remarks) -> None:
    last = -math.inf
    for n, event in enumerate(raw, start=1):
        at = event.get("at_min") if isinstance(event, Mapping) else None
        if not is_number(at):
            continue
        if at < last:
            message = f"out of order: the event before is at {last:g} min"
            remarks.error(f"events[{n}].at_min", message, shown(at), "events in the order of their times")
        last = max(last, float(at))


def _check_overlap(events: Sequence[Raw], remarks: Remarks) -> None:
    """Check that no two events change one key at the same time."""
    last: dict[Path, tuple[float, float]] = {}
    for event in events:
        begin = event["at_min"]
        for key in event.get("set", {}):
            path = section_and_key(key)
            assert path is not None
            start, end = last.get(path, (-1.0, -1.0))
            if begin == start or start < begin < end:
                until = f"overlaps the change of {key} from {start:g} to {end:g} min"
                message = until if end > start else f"sets {key}, which another event sets at the same minute"
                remarks.error(
                    f"{event['place']}.at_min", message, shown(begin), "one change of a key at a time"
                )
            last[path] = (begin, begin + event.get("ramp_min", 0.0))


def _check_blood(events: Sequence[Raw], blood_ml: float, remarks: Remarks) -> None:
    """Check that no more blood is taken than the patient has, and warn of losses that are soon fatal."""
    available = blood_ml
    for event in events:
        gifts, key = event.get("give", {}), f"{event['place']}.give.bleed_ml"
        bled = gifts.get("bleed_ml", 0.0)
        available += sum(gifts.get(kind, 0.0) for kind in INFLOWS if kind != "bleed_ml")
        if bled >= available:
            allowed = f"below {available:.0f} mL, the blood volume at that time"
            remarks.error(key, "more blood than the patient has", shown(bled), allowed)
            continue  # a refused bleeding is not subtracted: later events are checked without it
        available -= bled
        if bled and available < (1.0 - CLASS_IV) * blood_ml:
            message = (
                f"leaves {available:.0f} of {blood_ml:.0f} mL of blood: a loss above {100 * CLASS_IV:.0f} % "
                "is soon fatal (class IV, ATLS 2018), and beats may be computed that no patient can have"
            )
            remarks.warning(key, message, shown(bled))
