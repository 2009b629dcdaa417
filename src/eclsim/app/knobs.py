"""What can be turned on the page, and turning it: every turn is a change of the case, checked like a file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from eclsim.app.texts import text
from eclsim.cases.reading import read_mapping
from eclsim.devices import lvad
from eclsim.devices.ecmo import CANNULAE, OXYGENATORS, POSITIONS, PUMPS
from eclsim.inputs.fields import Field
from eclsim.inputs.mistakes import CaseError, Mistake, NumberAsWritten, shown
from eclsim.inputs.numbers import RefusedValueError, read_number
from eclsim.parameters import thiel2025
from eclsim.patient.sites import ARTERIAL_SITES, PATIENT_SITES, VENOUS_SITES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eclsim.cases.case import Case
    from eclsim.devices.products import PumpCurve

ROLLER = "Roller pump"
OTHER_MODE = "other_mode"
VOLUME = "volume_ml"
_DIGITS = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_COMMA = re.compile(r"[+-]?\d+,\d+", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)
_FILLED = ("svn", "pvn")
"""Vessels whose start pressure takes up blood that is given, in this order where blood is taken."""
VOLUME_FIELD = Field("Blood given or taken", "number", "mL", -200.0, 3000.0, 500.0, name=VOLUME)
USUAL_ECMO: Mapping[str, Any] = {
    "pump": "Rotaflow", "speed_rpm": 3000.0, "oxygenator": "Quadrox-i Adult", "mode": "VA",
}  # fmt: skip
USUAL_CRRT: Mapping[str, Any] = {"flow_ml_min": 200.0, "access_site": "post_oxy", "return_site": "pre_oxy"}
USUAL_LVAD: Mapping[str, Any] = {
    "pump": "HM3", "speed_rpm": 5000.0, "inlet_site": "lv", "outlet_site": "ao",
}  # fmt: skip
ON_THE_PATIENT = {"access_site": "svn", "return_site": "ra"}
DEVICES = {"ecmo": USUAL_ECMO, "crrt": USUAL_CRRT, "lvad": USUAL_LVAD}


@dataclass(frozen=True)
class Knob:
    """A number that can be turned.

    Args:
        key: key of a case file ("ecmo.speed_rpm", "parameters.Rmc"), or `VOLUME`.
        group: section of the panel.
        unit: unit of the number.
        low: left end of the slider; typed values may lie beyond, as far as a case file allows.
        high: right end.
        step: of the slider and of the arrow keys.
        logarithmic: whether equal ways on the slider are equal factors.
    """

    key: str
    group: str
    unit: str
    low: float
    high: float
    step: float
    logarithmic: bool = False


@dataclass(frozen=True)
class Picker:
    """A choice among names."""

    key: str
    group: str
    options: tuple[str, ...]


def controls(case: Case) -> list[Knob | Picker]:
    """What can be turned for a case, in the order of the panel."""
    found: list[Knob | Picker] = [
        Knob("patient.heart_rate_bpm", "heart", "bpm", 40, 180, 1),
        Knob("parameters.Emaxlv", "heart", "mmHg/mL", 0.2, 6.0, 0.01, True),
        Knob("parameters.Emaxrv", "heart", "mmHg/mL", 0.05, 2.0, 0.005, True),
        Knob("parameters.Rmc", "vessels", "mmHg s/mL", 0.1, 4.0, 0.01, True),
        Knob("parameters.Rpmc", "vessels", "mmHg s/mL", 0.01, 0.6, 0.002, True),
        Knob("parameters.Csart", "vessels", "mL/mmHg", 0.3, 6.0, 0.01, True),
        Knob(VOLUME, "vessels", "mL", VOLUME_FIELD.minimum, 1200, 10),
    ]
    return found + _ecmo(case) + _crrt(case) + _lvad(case)


def _ecmo(case: Case) -> list[Knob | Picker]:
    if case.ecmo is None:
        return []
    ecmo = case.ecmo
    found: list[Knob | Picker] = [Picker("ecmo.pump", "ecmo", (*PUMPS, ROLLER))]
    if isinstance(ecmo.pump, str):
        low, high = PUMPS[ecmo.pump].speed_range_rpm
        found.append(Knob("ecmo.speed_rpm", "ecmo", "rpm", 0 if low < 2000 else low / 2, high, 25))
    else:
        found.append(Knob("ecmo.roller_l_min", "ecmo", "L/min", 0.0, 7.0, 0.05))
    for line, kind in (("drainage", ecmo.drainage_cannula), ("return", ecmo.return_cannula)):
        sizes = CANNULAE[kind].sizes_fr
        found.append(Knob(f"ecmo.{line}_fr", "ecmo", "Fr", sizes[0], sizes[-1], 1))
    found.append(Picker("ecmo.oxygenator", "ecmo", tuple(OXYGENATORS)))
    other = (OTHER_MODE,) if _mode(ecmo) == OTHER_MODE else ()
    found.append(Picker("ecmo.mode", "ecmo", ("VA", "VV", *other)))
    for line, taken in (("drainage", ecmo.return_site), ("return", ecmo.drainage_site)):
        found.append(Picker(f"ecmo.{line}_site", "ecmo", tuple(s for s in PATIENT_SITES if s != taken)))
    return found


def _mode(ecmo: Any) -> str:
    """The usual name of an ECMO circuit's sites."""
    if ecmo.drainage_site not in VENOUS_SITES:
        return OTHER_MODE
    if ecmo.return_site in ARTERIAL_SITES:
        return "VA"
    return "VV" if ecmo.return_site in VENOUS_SITES else OTHER_MODE


def _crrt(case: Case) -> list[Knob | Picker]:
    if case.crrt is None:
        return []
    sites = (*(POSITIONS if case.ecmo is not None else ()), *PATIENT_SITES)
    return [
        Knob("crrt.flow_ml_min", "crrt", "mL/min", 50, 400, 5),
        Picker("crrt.access_site", "crrt", sites),
        Picker("crrt.return_site", "crrt", sites),
    ]


def _lvad(case: Case) -> list[Knob | Picker]:
    if case.lvad is None:
        return []
    low, high = lvad.PUMPS[case.lvad.pump].speed_range_rpm
    return [
        Picker("lvad.pump", "lvad", tuple(lvad.PUMPS)),
        Knob("lvad.speed_rpm", "lvad", "rpm", low, high, 25 if high < 5000 else 50),
    ]


def value_of(case: Case, key: str) -> float | str:
    """Where a knob or picker stands."""
    if key == VOLUME:
        return _given_volume(case)
    section, _, name = key.partition(".")
    if section == "parameters":
        return case.parameters.get(name, thiel2025.PARAMETERS[name].value)
    device: Any = getattr(case, section)
    if key == "ecmo.pump":
        return device.pump if isinstance(device.pump, str) else ROLLER
    if key == "ecmo.roller_l_min":
        return device.pump.roller_l_min
    if key == "ecmo.mode":
        return _mode(device)
    return getattr(device, name)


def turn(case: Case, key: str, value: Any) -> Case:
    """The case with one knob turned, or one picker set.

    Args:
        case: as it is.
        key: of a knob or picker of this case.
        value: a number, a name, or what somebody typed.

    Raises:
        CaseError: With what is wrong with the value, as for a case file.
    """
    if key not in {control.key for control in controls(case)}:
        raise CaseError([Mistake(str(key)[:64], "cannot be turned here")])
    raw = case.as_mapping()
    raw["parameters"] = dict(raw.get("parameters", {}))
    if meant := ambiguous_comma(value):
        raise CaseError([Mistake(key, meant)])
    value = as_written(value)
    if key == VOLUME:
        raw["parameters"] |= _start_pressures(case, _volume(value))
    elif key == "ecmo.pump":
        raw["ecmo"] = _with_pump(raw["ecmo"], value)
    elif key == "ecmo.roller_l_min":
        raw["ecmo"]["pump"] = {"roller_l_min": value}
    elif key == "ecmo.mode" and value == OTHER_MODE:
        return case
    elif key == "ecmo.mode":
        raw["ecmo"] = {k: raw["ecmo"][k] for k in ("pump", "speed_rpm", "oxygenator") if k in raw["ecmo"]}
        raw["ecmo"]["mode"] = value
    else:
        section, _, name = key.partition(".")
        raw[section][name] = value
    if key in ("ecmo.drainage_site", "ecmo.return_site"):
        raw["ecmo"].pop("mode", None)  # the sites count
    if key == "ecmo.oxygenator":
        raw["parameters"].pop("Recmooxy", None)
    if key == "lvad.pump" and value in lvad.PUMPS:
        raw["lvad"]["speed_rpm"] = _usual_speed(lvad.PUMPS[value])
    return read_mapping(raw).case


def connect(case: Case, device: str) -> Case:
    """The case with a device connected in the usual way, or disconnected if it is there."""
    if device not in DEVICES:
        raise CaseError([Mistake(str(device)[:64], "no device", allowed=", ".join(DEVICES))])
    raw = case.as_mapping()
    if device in raw:
        del raw[device]
    else:
        raw[device] = dict(DEVICES[device])
    if "crrt" in raw and "ecmo" not in raw and raw["crrt"]["access_site"] not in PATIENT_SITES:
        raw["crrt"] |= ON_THE_PATIENT
    elif "crrt" in raw and "ecmo" not in raw and raw["crrt"]["return_site"] not in PATIENT_SITES:
        raw["crrt"]["return_site"] = ON_THE_PATIENT["return_site"]
    return read_mapping(raw).case


def as_written(value: Any) -> Any:
    """A number that was typed, with its digits; any other text as it is, so that the check can say why.

    A decimal comma is read as a point where it can be nothing else: "3,425" may be meant as thousands.
    """
    typed = value.strip() if isinstance(value, str) else ""
    if _COMMA.fullmatch(typed) and not _THOUSANDS.fullmatch(typed):
        typed = typed.replace(",", ".")
    return NumberAsWritten(typed) if _DIGITS.fullmatch(typed) else value


def ambiguous_comma(value: Any) -> str:
    """What to type in place of a number whose comma may be a decimal or a thousands comma; else empty."""
    typed = value.strip() if isinstance(value, str) else ""
    if not _THOUSANDS.fullmatch(typed):
        return ""
    return text("ambiguous_comma", typed=typed, point=typed.replace(",", "."), whole=typed.replace(",", ""))


def _volume(value: Any) -> float:
    try:
        return read_number(value, VOLUME_FIELD)
    except RefusedValueError as error:
        found = error.mistake
        raise CaseError(
            [Mistake(VOLUME, found.message, shown(value), found.allowed, found.suggestion)]
        ) from None


def _parameter(case: Case, name: str) -> float:
    return case.parameters.get(name, thiel2025.PARAMETERS[name].value)


def _given_volume(case: Case) -> float:
    """Blood [mL] in the veins at the start above that of the published start pressures."""
    return sum(
        (_parameter(case, "P0" + at) - thiel2025.PARAMETERS["P0" + at].value) * _parameter(case, "C" + at)
        for at in _FILLED
    )


def _start_pressures(case: Case, volume_ml: float) -> dict[str, float]:
    """Start pressures that hold so much more blood than the published ones."""
    found, left = {}, volume_ml
    for at in _FILLED:
        usual, compliance = thiel2025.PARAMETERS["P0" + at].value, _parameter(case, "C" + at)
        found["P0" + at] = round(max(usual + left / compliance, 0.0), 6)
        left -= (found["P0" + at] - usual) * compliance
    return found


def _with_pump(ecmo: dict[str, Any], pump: Any) -> dict[str, Any]:
    changed = {**ecmo, "pump": pump}
    if pump == ROLLER:
        changed.pop("speed_rpm", None)
        return changed | {"pump": {"roller_l_min": 4.0}}
    if pump in PUMPS and pump != ecmo["pump"]:
        changed["speed_rpm"] = _usual_speed(PUMPS[pump])
    return changed


def _usual_speed(pump: PumpCurve) -> float:
    low, high = pump.speed_range_rpm
    return float(round((low + 0.5 * (high - low)) / 50.0) * 50)
