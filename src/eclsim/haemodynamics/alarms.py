"""Limits of machine and patient: which of them a steady beat breaks, in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from eclsim.parameters.devices import CRRT_ALARMS_MMHG

SANSOM_ACCESS_MMHG = 190.0
"""Access pressure above which early circuit failure is more likely (Sansom 2023, cited by Thiel et al.)."""
SUCTION_MMHG = -100.0
"""Drainage pressure below which cavitation and haemolysis are commonly feared (a convention)."""
COLLAPSE_MMHG = -300.0
"""Pressure that no vein withstands: the vessel has collapsed and the computed flow is not to be had."""

CLOSED_L_MIN = 0.02
"""Mean flow below which a valve counts as closed all beat."""


@dataclass(frozen=True)
class Finding:
    """A limit that is broken: `kind` is alarm, warning or collapse."""

    kind: str
    quantity: str
    value: float
    limit: float
    sentence: str


def findings(outputs: Mapping[str, float], extremes: Mapping[str, tuple[float, float]]) -> list[Finding]:
    """Limits that a beat breaks.

    Args:
        outputs: scalar outputs by name.
        extremes: smallest and largest value of each waveform.
    """
    found = _crrt(outputs)
    low = outputs.get("lowest_drainage_pressure")
    if low is not None and low < SUCTION_MMHG:
        kind = "collapse" if low < COLLAPSE_MMHG else "warning"
        limit = COLLAPSE_MMHG if kind == "collapse" else SUCTION_MMHG
        found.append(
            _below(kind, "pressure in the drainage cannula", low, limit, "suction: lower the pump speed")
        )
    for name, (smallest, _) in extremes.items():
        if name in ("Vra", "Vrv", "Vla", "Vlv") and smallest <= 0.0:
            text = f"volume of {name[1:]} falls to {smallest:.1f} mL: the chamber collapses"
            found.append(Finding("collapse", name, smallest, 0.0, text))
        if name[0] == "P" and name[1:] in ("ra", "svn", "rv", "pvn", "la") and smallest < COLLAPSE_MMHG:
            found.append(
                _below("collapse", f"pressure in {name[1:]}", smallest, COLLAPSE_MMHG, "the vessel collapses")
            )
    return found + _aortic_valve(outputs)


def _aortic_valve(outputs: Mapping[str, float]) -> list[Finding]:
    """A valve that stays closed: the heart's failure, or an assist pump at work."""
    aortic, pump = outputs.get("aortic_valve_flow"), outputs.get("lvad_flow", 0.0)
    if aortic is None or aortic >= CLOSED_L_MIN:
        return []
    text = f"aortic valve flow {aortic:.3f} L/min: "
    if pump >= CLOSED_L_MIN:
        text += f"the valve stays closed, the LVAD carries the left ventricle's output ({pump:.2f} L/min)"
    else:
        text += "the left ventricle does not eject"
    return [Finding("warning", "aortic_valve_flow", aortic, CLOSED_L_MIN, text)]


def _crrt(outputs: Mapping[str, float]) -> list[Finding]:
    found = []
    for line in ("access", "return"):
        value = outputs.get(f"crrt_{line}_pressure")
        if value is None:
            continue
        low, high = CRRT_ALARMS_MMHG[line]
        words = f"CRRT {line} pressure"
        if value < low:
            found.append(_below("alarm", words, value, low, "machine alarm"))
        elif value > high:
            found.append(_above("alarm", words, value, high, "machine alarm"))
        elif line == "access" and value > SANSOM_ACCESS_MMHG:
            found.append(
                _above("warning", words, value, SANSOM_ACCESS_MMHG, "early circuit failure is more likely")
            )
    return found


def _below(kind: str, words: str, value: float, limit: float, why: str) -> Finding:
    return Finding(kind, words, value, limit, f"{words} {value:.1f} mmHg is below {limit:g} mmHg: {why}")


def _above(kind: str, words: str, value: float, limit: float, why: str) -> Finding:
    return Finding(kind, words, value, limit, f"{words} {value:.1f} mmHg is above {limit:g} mmHg: {why}")
