"""What is usual and what is not: reference ranges of outputs, and limits that colour the schematic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from eclsim.haemodynamics.alarms import COLLAPSE_MMHG, SANSOM_ACCESS_MMHG, SUCTION_MMHG
from eclsim.haemodynamics.outputs import REGISTRY
from eclsim.parameters.devices import CRRT_ALARMS_MMHG

_CATHETER = "practical table of right heart catheterisation, European Respiratory Society"
_NURSING = "nursing reference of haemodynamic norms"
_HUDSMITH = "Hudsmith et al. 2005, 63 men, mean ± 2 SD"
_KAWEL = "Kawel-Boehm et al. 2015, men, mean ± 2 SD"

REFERENCE: dict[str, tuple[float, float, str]] = {
    "SP": (90.0, 140.0, _NURSING),
    "DP": (60.0, 90.0, _NURSING),
    "MAP": (70.0, 100.0, _NURSING),
    "MPAP": (8.0, 20.0, _CATHETER),
    "PCWP": (4.0, 12.0, _CATHETER),
    "CO": (4.0, 8.0, _CATHETER),
    "SPAP": (15.0, 25.0, _CATHETER),
    "DPAP": (4.0, 12.0, _CATHETER),
    "right_atrial_pressure": (1.0, 6.0, _CATHETER),
    "end_diastolic_pressure_rv": (1.0, 8.0, _CATHETER),
    "peak_pressure_rv": (15.0, 25.0, _CATHETER),
    "EDVLV": (102.0, 218.0, _HUDSMITH),
    "ESVLV": (18.0, 82.0, _HUDSMITH),
    "EDVRV": (124.0, 256.0, _HUDSMITH),
    "ESVRV": (38.0, 118.0, _HUDSMITH),
    "stroke_volume_lv": (50.0, 100.0, _NURSING),
    "ejection_fraction_lv": (57.0, 77.0, _KAWEL),
    "crrt_access_pressure": (*CRRT_ALARMS_MMHG["access"], "alarm limits of CRRT machines"),
    "crrt_return_pressure": (*CRRT_ALARMS_MMHG["return"], "alarm limits of CRRT machines"),
    "lowest_drainage_pressure": (SUCTION_MMHG, 0.0, "convention: below, suction and haemolysis are feared"),
}
"""Adult range of an output, in its unit, and where it comes from."""


@dataclass(frozen=True)
class Limits:
    """Where a mean pressure [mmHg] is looked at (warning) and where it breaks a limit (alarm)."""

    alarm_low: float = float("-inf")
    warning_low: float = float("-inf")
    warning_high: float = float("inf")
    alarm_high: float = float("inf")

    def level(self, value: float) -> str:
        """How a mean pressure [mmHg] stands to them: "ok", "warning" or "alarm"."""
        if not self.alarm_low <= value <= self.alarm_high:
            return "alarm"
        return "ok" if self.warning_low <= value <= self.warning_high else "warning"


_VENOUS = Limits(warning_high=12.0, alarm_high=20.0)
_LEFT = Limits(warning_high=15.0, alarm_high=25.0)
_ARTERIAL = Limits(50.0, 65.0, 110.0, 130.0)
_SUCTION = Limits(COLLAPSE_MMHG, SUCTION_MMHG)
_POSITIVE = Limits(warning_high=300.0, alarm_high=400.0)
_ACCESS = Limits(CRRT_ALARMS_MMHG["access"][0], -200.0, SANSOM_ACCESS_MMHG, CRRT_ALARMS_MMHG["access"][1])
_RETURN = Limits(CRRT_ALARMS_MMHG["return"][0], 0.0, 300.0, CRRT_ALARMS_MMHG["return"][1])

NODE_LIMITS: dict[str, Limits] = {
    "ao": _ARTERIAL, "sart": _ARTERIAL, "svn": _VENOUS, "ra": _VENOUS,
    "pas": Limits(warning_high=25.0, alarm_high=40.0), "part": Limits(warning_high=25.0, alarm_high=40.0),
    "pvn": _LEFT, "la": _LEFT,
    "ecmodrain": _SUCTION, "ecmotudp": _SUCTION,
    "ecmotupo": _POSITIVE, "ecmooxy": _POSITIVE, "ecmotuor": _POSITIVE, "ecmoreturn": _POSITIVE,
    "crrttuin": _ACCESS, "crrttuout": _RETURN,
}  # fmt: skip
"""Limits of mean pressures by compartment.

Mean arterial pressure 65 mmHg is the usual target in shock; 300 mmHg after the pump is the usual limit of
ECMO circuits; those of CRRT lines are machine alarms and Sansom et al. 2023.
"""


def levels(means: dict[str, float]) -> dict[str, str]:
    """How the pressure of each compartment stands to its limits."""
    return {
        name: limits.level(means["P" + name]) for name, limits in NODE_LIMITS.items() if "P" + name in means
    }


def output_specs() -> dict[str, dict[str, Any]]:
    """Words, unit, definition and reference range of every output, as plain data."""
    found: dict[str, dict[str, Any]] = {}
    for name, entry in REGISTRY.items():
        found[name] = {"words": entry.long_name, "unit": entry.unit, "definition": entry.definition}
        if name in REFERENCE:
            found[name]["range"] = list(REFERENCE[name])
    found["crrt_recirculated_fraction"] = {
        "words": "recirculated share of the CRRT flow", "unit": "1", "definition": "steady mixing",
    }  # fmt: skip
    return found
