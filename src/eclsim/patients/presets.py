"""Patients to start from: a case for each usual situation at the bedside.

What each one is meant to show, and how far the simulated beat meets it, stands in `aim`; `tests/patients`
holds the simulated numbers against it. Only the paper's patient was fitted to anybody. The others are the
published parameters (Tables S-1 to S-3 of Thiel et al. 2025) with those changed that the situation is about:
contractility, resistances, compliance and filling, sizes chosen by hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from eclsim.parameters.thiel2025 import TABLE_S4

if TYPE_CHECKING:
    from eclsim.patients.case import Case


@dataclass(frozen=True)
class Preset:
    """A case to start from.

    Args:
        key: short name, also in links.
        name: in words.
        aim: what the beat shows, with the usual criteria.
        sections: the case, as a case file holds it.
    """

    key: str
    name: str
    aim: str
    sections: Mapping[str, Any]

    def case(self) -> Case:
        """The checked case."""
        from eclsim.patients.case import Case

        return Case.model_validate({"format": 1, **self.sections})


def _person(name: str, sex: str, age: float, height: float, weight: float, rate: float) -> dict[str, Any]:
    return {
        "id": name, "sex": sex, "age_years": age, "height_cm": height, "weight_kg": weight,
        "heart_rate_bpm": rate,
    }  # fmt: skip


def _rotaflow(mode: str, speed_rpm: float, drainage_fr: float, return_fr: float) -> dict[str, Any]:
    return {
        "pump": "Rotaflow", "speed_rpm": speed_rpm, "oxygenator": "Quadrox-i Adult", "mode": mode,
        "drainage_fr": drainage_fr, "return_fr": return_fr,
    }  # fmt: skip


_PRESETS = (
    Preset(
        "healthy",
        "Healthy adult",
        "Pressures, cardiac index and volumes within the norms of adults (right heart catheter, imaging).",
        {
            "patient": _person("Healthy adult", "male", 40, 178, 75, 70),
            "parameters": {"Rmc": 0.75, "Emaxlv": 2.5, "Csart": 1.3, "P0svn": 5.0},
        },
    ),
    Preset(
        "cardiogenic-shock",
        "Cardiogenic shock",
        "Systolic pressure below 90 mmHg, cardiac index below 2.2 L/min/m2, wedge pressure above 15 mmHg "
        "(criteria of the SHOCK trial, Hochman et al. 1999).",
        {
            "patient": _person("Cardiogenic shock", "male", 62, 176, 84, 105),
            "parameters": {"Emaxlv": 0.48, "Emaxrv": 0.4, "Rmc": 1.15, "Rpmc": 0.07, "P0svn": 18.0},
        },
    ),
    Preset(
        "right-heart-failure",
        "Right heart failure",
        "Cardiac index below 2.2 L/min/m2, right atrial pressure above 10 mmHg and above 0.63 of the wedge "
        "pressure, with a raised pulmonary resistance.",
        {
            "patient": _person("Right heart failure", "female", 58, 166, 70, 105),
            "parameters": {"Emaxrv": 0.12, "RV_Pd_kappa": 0.03, "Rpmc": 0.2, "Rmc": 0.9, "P0svn": 14.0},
        },
    ),
    Preset(
        "paper",
        "V-A ECMO + CRRT (Thiel 2025)",
        "The patient of section 3.3 of Thiel et al. 2025 with the fitted parameters of Table S-4, CRRT in "
        "scheme g. Height, weight and heart rate are not printed there and are assumed.",
        {
            "patient": _person("Thiel 2025, section 3.3", "female", 70, 165, 60, 120),
            "ecmo": _rotaflow("VA", 3425.0, 21.0, 17.0),
            "crrt": {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy"},
            "parameters": dict(TABLE_S4),
        },
    ),
    Preset(
        "vv-ecmo",
        "V-V ECMO",
        "Lung failure: mean pulmonary artery pressure above 25 mmHg with a normal wedge pressure, and a pump "
        "flow of 4 to 5 L/min.",
        {
            "patient": _person("V-V ECMO", "male", 45, 180, 85, 100),
            "ecmo": _rotaflow("VV", 2900.0, 25.0, 21.0),
            "parameters": {
                "Rpmc": 0.17, "Rmc": 0.6, "Emaxlv": 2.2, "Emaxrv": 0.45, "Csart": 1.1, "P0svn": 7.0,
            },
        },
    ),
    Preset(
        "lvad",
        "LVAD",
        "End-stage heart failure on a HeartMate 3: mean arterial pressure 70 to 90 mmHg, pump flow of 4 to 5 "
        "L/min, the aortic valve still opening.",
        {
            "patient": _person("LVAD", "male", 58, 178, 82, 80),
            "lvad": {"pump": "HM3", "speed_rpm": 4900.0, "inlet_site": "lv", "outlet_site": "ao"},
            "parameters": {"Emaxlv": 0.7, "Emaxrv": 0.4, "Rmc": 0.85, "Csart": 1.1, "P0svn": 11.0},
        },
    ),
)  # fmt: skip

PRESETS: Mapping[str, Preset] = MappingProxyType({preset.key: preset for preset in _PRESETS})
"""Cases to start from, by key."""
