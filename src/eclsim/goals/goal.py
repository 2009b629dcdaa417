"""Goals for outputs and the settings that may be varied to reach them, parsed from the user's text."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from eclsim.arguments import number_of, written
from eclsim.cases.case import Case
from eclsim.cases.quantities import quantity
from eclsim.cases.sections import Measurements, section_of
from eclsim.cases.settings import apply_settings
from eclsim.devices.description import GASES, Knob, Limit
from eclsim.devices.ecmo_parts import is_closed
from eclsim.devices.products import LABEL_FLOWS
from eclsim.devices.registry import named_output, parameter_of
from eclsim.inputs.mistakes import CaseError, ListedError
from eclsim.inputs.numbers import suspected_unit
from eclsim.outputs.limits import backward_flow_bounds, impossible_bounds, limits_of
from eclsim.outputs.registry import all_outputs, output, unavailable
from eclsim.spelling import spelling_hint
from eclsim.units import convert, known_unit, quantity_of, unit_in_words

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_ONE_SIDE = re.compile(rf"(\S+?)\s*(>=|<=|>|<|≥|≤)\s*({_NUMBER})")
_TWO_SIDES = re.compile(rf"(\S+?)\s*(?:=|:|in|\s)\s*({_NUMBER})\s*(?:\.\.|to)\s*({_NUMBER})")
_WITH_UNIT = re.compile(r"(.*[\d.])\s*([A-Za-zµ%][\w/µ%.²]*)")
_BETWEEN_GOALS = re.compile(r"(?<!\d),|,(?!\d)")
ALLOWED_FORMS = (
    "goals such as MAP > 65, PCWP < 18 or PaCO2 35..45, in the outputs' units, with commas between"
)
MET_TOLERANCE = 1e-4
"""Largest miss of a goal that counts as reached, in scales of the goal."""
VENTILATION = ("sweep_l_min", "alveolar_ventilation_l_min")
"""Settings, without their section, that remove carbon dioxide."""
VENTILATED = ("PaCO2", "PaCO2_lower", "pHa")
"""Outputs that these settings change most, and that are kept within warning limits if one may be varied."""
LARGEST_FLOW_L_MIN = 30.0
SMALLEST_OXYGEN_FLOW_ML_MIN = 10.0


class GoalError(ListedError):
    """Raised for impossible goals or settings; the message has one line for each mistake."""


@dataclass(frozen=True)
class Goal:
    """Bounds of an output.

    Args:
        output: name of the output.
        low: smallest value, in the output's unit; minus infinity for none.
        high: largest value; infinity for none.
        because: for an implicit goal, the meaning of a value beyond the bound; empty for a user's goal.
        gives_way: whether the goal is dropped, and only reported, if no varied setting can keep it.
    """

    output: str
    low: float = -math.inf
    high: float = math.inf
    because: str = ""
    gives_way: bool = False

    def __post_init__(self) -> None:
        _make_numbers(self, f"goal {self.output}")

    def __str__(self) -> str:
        if math.isinf(self.high):
            return f"{self.output} > {self.low:g}"
        if math.isinf(self.low):
            return f"{self.output} < {self.high:g}"
        return f"{self.output} {self.low:g}..{self.high:g}"

    @property
    def scale(self) -> float:
        """Unit in which a miss is measured: a hundredth of the bound, at least 0.01 of the output's unit."""
        bounds = [abs(bound) for bound in (self.low, self.high) if math.isfinite(bound)]
        return max(0.01 * max(bounds), 0.01)

    def excess(self, value: float) -> float:
        """Distance of a value beyond the nearer bound, in the output's unit; negative within the bounds."""
        return max(self.low - value, value - self.high)

    def is_met(self, value: float) -> bool:
        """Whether a value is within the bounds, or beyond by no more than `MET_TOLERANCE`; not for NaN."""
        return self.excess(value) <= MET_TOLERANCE * self.scale

    def at_bound(self, value: float) -> bool:
        """Whether a value is at or beyond a bound, within the accuracy of a search."""
        return self.excess(value) >= -1e-3 * self.scale

    def inside(self) -> Goal:
        """Return the goal with slightly narrower bounds, so that rounding does not break a limit."""
        margin = min(1e-5 * self.scale, 0.25 * (self.high - self.low))
        return replace(self, low=self.low + margin, high=self.high - margin)


@dataclass(frozen=True)
class Setting:
    """A parameter that may be varied, with its range.

    Args:
        name: name of the parameter, such as "ecmo.speed_rpm" or "Rmc".
        low: smallest value, in the parameter's unit.
        high: largest value.
        unit: unit of the value.
    """

    name: str
    low: float
    high: float
    unit: str = ""

    def __post_init__(self) -> None:
        _make_numbers(self, f"setting {self.name}")


def _make_numbers(given: Goal | Setting, name: str) -> None:
    """Convert both bounds of a frozen object to `float`."""
    for what in ("low", "high"):
        object.__setattr__(given, what, number_of(f"{name}: {what}", getattr(given, what)))


def read_goals(text: str | Sequence[str | Goal], outputs: Sequence[str]) -> tuple[Goal, ...]:
    """Parse goals from a user's text.

    Args:
        text: goals such as "MAP > 65, PaCO2 35..45"; strict and non-strict signs mean the same.
        outputs: names of the outputs that the case has.

    Raises:
        GoalError: There are mistakes; the message names all of them.
    """
    goals, wrong = [], []
    parts = (
        _BETWEEN_GOALS.split(text) if isinstance(text, str) else _listed(text, Goal, "goal", ALLOWED_FORMS)
    )
    for part in parts:
        try:
            goal = _read(part.strip()) if isinstance(part, str) else part
        except GoalError as error:
            wrong += error.mistakes
            continue
        if goal.output not in outputs:
            wrong.append(f"{goal.output}: this case has no such output{unavailable(goal.output, outputs)}")
        elif not math.isfinite(goal.low) and not math.isfinite(goal.high):
            wrong.append(f"{goal.output}: a goal without a finite bound; allowed: low, high, or both")
        elif not goal.low <= goal.high:
            wrong.append(f"{goal.output}: from {goal.low:g} to {goal.high:g}; the first must not be larger")
        else:
            wrong += _mistakes_in_units(goal)
        goals.append(goal)
    names = [goal.output for goal in goals]
    wrong += [f"{name}: two goals; write both bounds as {name} LOW..HIGH" for name in _repeated(names)]
    if not goals and not wrong:
        wrong.append(f"no goals; allowed: {ALLOWED_FORMS}")
    if wrong:
        raise GoalError(wrong)
    return tuple(goals)


def implicit_goals(
    outputs: Sequence[str],
    asked: Sequence[Goal],
    present: Mapping[str, float],
    values: Mapping[str, float],
    settings: Sequence[Setting] = (),
) -> tuple[Goal, ...]:
    """Goals that hold without being stated, for veins, ejecting chambers, flows and gases.

    No vein may be below the pressure of its surroundings, no chamber may eject more than it holds, no device
    may carry blood backwards, no oxygenator may have less flow than its label requires, and no alarm of gases
    may be raised that the case does not raise already. If sweep or ventilation may be varied, arterial PCO2
    and pH that the case keeps within their warning limits stay within these: no search should hyperventilate
    a patient to spare pump speed. Goals of flows and gases give way if no varied setting can keep them.

    Args:
        outputs: names of the outputs that the case has.
        asked: goals of the user, which replace implicit goals on the same side of an output.
        present: outputs at the case's own settings, as far as known.
        values: parameters of the case.
        settings: settings that may be varied.
    """
    taken = {(goal.output, "below") for goal in asked if math.isfinite(goal.low)}
    taken |= {(goal.output, "above") for goal in asked if math.isfinite(goal.high)}
    goals: dict[tuple[str, str, str], Goal] = {}  # the meaning may differ between sides
    ventilated = VENTILATED if varies_ventilation(settings) else ()
    backward = [_least_flow(limit, values) for limit in backward_flow_bounds(outputs)]
    gases = [
        limit for name in outputs if requires_gases(name) for limit in limits_of(name, outputs, values)
        if (limit.kind == "alarm" and not limit.broken_by(present.get(name, math.nan)))
        or (name in ventilated and name in present and not limit.broken_by(present[name]))
    ]  # fmt: skip
    alarms = (*backward, *gases)
    for limit in (*impossible_bounds(outputs), *alarms):
        if (limit.quantity, limit.side) not in taken:
            key = limit.quantity, limit.kind, limit.meaning
            unbound = Goal(limit.quantity, because=limit.meaning, gives_way=limit in alarms)
            known = goals.get(key, unbound)
            side = {"low": limit.value} if limit.side == "below" else {"high": limit.value}
            goals[key] = replace(known, **side)
    return tuple(goals.values())


def least_flow_goals(
    outputs: Sequence[str], asked: Sequence[Goal], values: Mapping[str, float]
) -> tuple[Goal, ...]:
    """Unstated goals for the flows of devices: forward, and not below the label of an oxygenator.

    Args:
        outputs: names of the outputs that the case has.
        asked: goals of the user; one with a lower bound of a flow replaces the implicit one.
        values: parameters of the case.
    """
    taken = {goal.output for goal in asked if math.isfinite(goal.low)}
    bounds = (_least_flow(limit, values) for limit in backward_flow_bounds(outputs))
    return tuple(
        Goal(bound.quantity, low=bound.value, because=bound.meaning, gives_way=True)
        for bound in bounds
        if bound.quantity not in taken
    )


def varies_ventilation(settings: Iterable[Setting]) -> bool:
    """Whether a setting may be varied that removes carbon dioxide: a sweep, or the lungs' ventilation."""
    return any(setting.name.rpartition(".")[2] in VENTILATION for setting in settings)


def is_kept_by_settings(goal: Goal, settings: Sequence[Setting]) -> bool:
    """Whether settings can keep a bound; for a device's flow, only settings of that device can."""
    known = named_output(goal.output)
    if not goal.gives_way or known is None:
        return True
    return known[0].key in {setting.name.rpartition(".")[0] for setting in settings}


def requires_gases(name: str) -> bool:
    """Whether an output exists only where gases are computed."""
    return GASES in output(name).parameters


def _least_flow(limit: Limit, values: Mapping[str, float]) -> Limit:
    """The limit with a value of 0, or with the least flow of an oxygenator's label unless it is clamped."""
    known = named_output(limit.quantity)
    if known is not None and known[1].name == "PF":
        names = known[0]
        least = values.get(names.parameter(LABEL_FLOWS[0]), 0.0)
        if math.isfinite(least) and not is_closed(names, values):
            meaning = "blood clots in the oxygenator at lower flows; the lowest flow on its label"
            return replace(limit, value=least, meaning=meaning)
    return replace(limit, value=0.0)


def _read(text: str) -> Goal:
    if match := _ONE_SIDE.fullmatch(text):
        output, sign, bound = match[1], match[2], float(match[3])
        return Goal(output, low=bound) if sign in (">", ">=", "≥") else Goal(output, high=bound)
    if match := _TWO_SIDES.fullmatch(text):
        output, low, high = match.groups()
        return Goal(output, float(low), float(high))
    if (match := _WITH_UNIT.fullmatch(text)) and not _WITH_UNIT.fullmatch(match[1]):
        return _without_unit(_read(match[1]), match[2], text)
    decimal = f"; did you mean {text.replace(',', '.')}?" if "," in text else ""
    raise GoalError([f"'{text}' is not a goal; allowed: {ALLOWED_FORMS}{decimal}"])


def _without_unit(goal: Goal, written: str, text: str) -> Goal:
    """Parse a goal whose bound has a unit; raises an error unless it is the unit of the output."""
    if goal.output not in all_outputs():
        return goal
    unit = output(goal.output).unit
    if (known_unit(written) or written).lower() == unit.lower():
        return goal
    wrong = f"{text}: {goal.output} is in {unit_in_words(unit)}"
    bound = goal.low if math.isfinite(goal.low) else goal.high
    if quantity_of(unit) is not None and quantity_of(written) == quantity_of(unit):
        wrong += f"; did you mean {convert(bound, known_unit(written) or written, unit):.4g} {unit}?"
    raise GoalError([wrong])


def _mistakes_in_units(goal: Goal) -> list[str]:
    """Mistakes about bounds that no patient could have, such as 0.9 for a saturation in percent."""
    unit = output(goal.output).unit
    field = Measurements.fields().get(goal.output.removesuffix("_lower"))
    wrong = []
    for bound in (goal.low, goal.high):
        if not math.isfinite(bound):
            continue
        if field is not None and not field.minimum <= bound <= field.maximum:
            meant = suspected_unit(bound, unit, field.typical, (field.minimum, field.maximum))
            wrong.append(f"{goal}: {field.minimum:g} to {field.maximum:g} {unit} is the measurable range")
        else:
            meant = _probable_value(goal.output, unit, bound)
            wrong += [f"{goal}: {goal.output} is in {unit_in_words(unit)}"] * bool(meant)
        if meant:
            wrong[-1] += f"; did you mean {meant}?"
    return wrong


def _probable_value(name: str, unit: str, bound: float) -> str:
    """The bound converted to the output's unit if it probably has another unit, else empty."""
    size = abs(bound)
    if unit == "%" and 0.0 < size <= 1.0:
        return f"{100.0 * bound:g} %"
    if unit == "1" and (name.endswith("fraction") or name == "O2ER") and size > 1.0:
        return f"{0.01 * bound:g}"
    if unit == "L/min" and size > LARGEST_FLOW_L_MIN:
        return f"{0.001 * bound:g} L/min"
    if name.startswith(("DO2", "VO2")) and 0.0 < size < SMALLEST_OXYGEN_FLOW_ML_MIN:
        return f"{1000.0 * bound:g} {unit}"
    return ""


def _repeated(names: Sequence[str]) -> list[str]:
    return [name for name in dict.fromkeys(names) if names.count(name) > 1]


def default_settings(case: Case, known: Sequence[str]) -> tuple[Setting, ...]:
    """Default settings of the devices of a case, over the ranges of the page, the costliest first."""
    settings: list[Setting | None] = []
    for instance in case.instances():
        names = (f"{instance.key}.{key}" for key in instance.device.adjusted)
        settings += [_with_usual_bounds(case, name) for name in names if name in known]
    return tuple(setting for setting in settings if setting is not None)


def _hint_for_missing_setting(case: Case, name: str, known: Sequence[str]) -> str:
    """Hint on adding a setting whose section the case lacks, else the nearest spelling."""
    section, _, key = name.rpartition(".")
    kind = section_of(section)
    if kind is None or key not in kind.fields() or section in case.as_mapping():
        return spelling_hint(name, known)
    return f", as it has no section [{section}]: add it with a start value, or use --set {name}=VALUE"


def read_settings(
    text: str | Sequence[Setting] | None, case: Case, known: Sequence[str]
) -> tuple[Setting, ...]:
    """Parse settings from a user's text: names, with or without bounds ("ecmo.speed_rpm=2000..4000, Rmc").

    Args:
        text: settings; None for the default ones of the devices of the case.
        case: case whose ranges apply if no bounds are written.
        known: names of all parameters that may be varied.

    Raises:
        GoalError: There are mistakes; the message names all of them.
    """
    if text is None:
        settings = default_settings(case, known)
        if not settings:
            raise GoalError(["no setting to vary: no device with a speed; name parameters and bounds"])
        return settings
    if not isinstance(text, str):
        return _checked_settings(text, known)
    settings, wrong = [], []
    for part in text.split(","):
        name, _, bounds = (piece.strip() for piece in part.partition("="))
        if not name:
            wrong.append(f"'{text}' lacks a name; allowed: names with commas between, with or without bounds")
            continue
        if name not in known:
            wrong.append(
                f"{name}: this case has no such parameter{_hint_for_missing_setting(case, name, known)}"
            )
            continue
        setting = _with_usual_bounds(case, name)
        if bounds:
            match = re.fullmatch(rf"({_NUMBER})\s*(?:\.\.|:)\s*({_NUMBER})", bounds)
            if match is None or float(match[1]) >= float(match[2]):
                wrong.append(f"{name} = '{bounds}'; allowed: LOW..HIGH, such as 2000..4000")
                continue
            if refused := _reason_out_of_range(case, name, float(match[1]), float(match[2])):
                wrong.append(f"{name} = {bounds}: {refused}")
                continue
            setting = Setting(name, float(match[1]), float(match[2]), setting.unit if setting else "")
        if setting is None:
            wrong.append(f"{name}: no usual range; write bounds, {name}=LOW..HIGH")
            continue
        settings.append(setting)
    wrong += [f"{name}: given twice" for name in _repeated([setting.name for setting in settings])]
    if wrong:
        raise GoalError(wrong)
    return tuple(settings)


def _listed(given: object, kind: type, what: str, allowed: str) -> list[Any]:
    """Check and return goals or settings given as a list of texts or of objects of their kind.

    Raises:
        GoalError: They are something else.
    """
    parts = [given] if isinstance(given, Mapping) or not isinstance(given, Iterable) else list(given)
    if wrong := [part for part in parts if not isinstance(part, (str, kind))]:
        raise GoalError([f"{written(part)} is not a {what}; allowed: {allowed}" for part in wrong])
    return parts


def _checked_settings(given: Sequence[Setting], known: Sequence[str]) -> tuple[Setting, ...]:
    """Check and return settings given as objects."""
    allowed = "ecmo.speed_rpm=2000..4000, or eclsim.Setting(name, low, high)"
    settings, wrong = _listed(given, Setting, "setting", allowed), []
    for setting in settings:
        if isinstance(setting, str):
            wrong.append(f"'{setting}' in a list; allowed: one text with commas, or eclsim.Setting objects")
        elif setting.name not in known:
            hint = spelling_hint(setting.name, known)
            wrong.append(f"{setting.name}: this case has no such parameter{hint}")
        elif not -math.inf < setting.low < setting.high < math.inf:
            bounds = f"from {setting.low:g} to {setting.high:g}"
            wrong.append(f"{setting.name}: {bounds}; the first must be smaller, and both finite")
    if not settings:
        wrong.append(f"no setting to vary; allowed: {allowed}")
    if wrong:
        raise GoalError(wrong)
    return tuple(replace(s, unit=s.unit or getattr(quantity(s.name), "unit", "")) for s in settings)


def _with_usual_bounds(case: Case, name: str) -> Setting | None:
    """A setting with the range of its pump, of its control on the page, or of the parameter table."""
    section, _, key = name.rpartition(".")
    knob, instance = _knobs(case, section).get(key), case.instance(section)
    swept = None if instance is None else instance.device.sweep(instance.section)
    if swept is not None and swept.key == key and knob is not None:
        return Setting(name, swept.low, swept.high, knob.unit)
    if knob is not None:
        return Setting(name, knob.low, knob.high, knob.unit)
    entry = parameter_of(name, [instance.key for instance in case.instances()])
    return None if entry is None else Setting(name, entry.minimum, entry.maximum, entry.unit)


def _reason_out_of_range(case: Case, name: str, low: float, high: float) -> str:
    """Explain why bounds are outside a parameter's allowed range; empty if they are not."""
    entry = parameter_of(name, [instance.key for instance in case.instances()])
    if entry is not None and not (entry.accepts(low) and entry.accepts(high)):
        return f"outside the allowed range; allowed: {entry.allowed.removesuffix(' 1')}"
    for bound in (low, high):
        try:
            apply_settings(case, [f"{name}={bound!r}"])
        except CaseError as error:
            return f"{bound:g}: {error.mistakes[0].message}; allowed: {error.mistakes[0].allowed}"
    return ""


def _knobs(case: Case, section: str) -> dict[str, Knob]:
    instance = case.instance(section)
    if instance is None:
        return {}
    controls = instance.device.controls(instance.section, case.sites())
    return {control.key: control for control in controls if isinstance(control, Knob)}
