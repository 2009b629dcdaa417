"""Preset patients: a case for each common situation at the bedside.

`aim` describes what a preset shows, `aims` gives the criteria as ranges, and `source` names their sources;
the tests check the simulated numbers against the ranges. Only the paper's patient was fitted to a real
patient. The others use the published parameters (Tables S-1 to S-3 of Thiel et al. 2025), except those that
characterise the situation (contractility, resistances, compliance and filling), chosen in November 2026 to
meet the ranges.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from eclsim.cases.case import Case
from eclsim.parameters.thiel2025 import TABLE_S4

CARDIAC_INDEX = "cardiac_index"
"""Cardiac output per body surface area after Mosteller [L/min/m2]."""


@dataclass(frozen=True)
class Aim:
    """A range in which an output of a preset's beat lies.

    Args:
        output: name in the registry of outputs, or `CARDIAC_INDEX`.
        lowest: lower bound, in the output's unit.
        highest: upper bound, in the output's unit.
    """

    output: str
    lowest: float
    highest: float


@dataclass(frozen=True)
class Preset:
    """A case to start from.

    Args:
        key: short name, also used in links.
        name: displayed name.
        aim: description of what the beat shows, with the usual criteria.
        source: sources of the criteria.
        aims: the criteria as ranges.
        sections: the case, as in a case file.
        often: devices often connected or disconnected with this preset; the page prepares them.
    """

    key: str
    name: str
    aim: str
    source: str
    aims: tuple[Aim, ...]
    sections: Mapping[str, Any]
    often: tuple[str, ...] = ()

    def case(self) -> Case:
        """Return the checked case."""
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
        "Pressures, cardiac output and ejection fraction within the norms of adults.",
        "Right heart catheter: right atrium 1 to 6, pulmonary artery 14 +- 3 (mean), wedge 4 to "
        "12 mmHg, cardiac output 4 to 6 L/min, index 2.4 to 4 L/min/m2 (European Respiratory "
        "Society, practical table); ejection fraction 57 to 77 % (Kawel-Boehm et al. 2015, "
        "PMC7758747)",
        (
            Aim("SP", 90, 140), Aim("MAP", 70, 100), Aim("CO", 4, 6), Aim(CARDIAC_INDEX, 2.4, 4),
            Aim("PCWP", 4, 12), Aim("right_atrial_pressure", 1, 6), Aim("MPAP", 11, 17),
            Aim("ejection_fraction_lv", 57, 77),
        ),
        {
            "patient": _person("Healthy adult", "male", 40, 178, 75, 70),
            "parameters": {"Rmc": 0.88, "Emaxlv": 1.95, "Emaxrv": 0.5, "Csart": 1.3, "P0svn": 3.3},
        },
    ),
    Preset(
        "cardiogenic-shock",
        "Cardiogenic shock",
        "Failure of both ventricles with congestion: systolic pressure below 90 and mean below 60"
        " mmHg, cardiac index below 2, wedge pressure above 20 and central venous pressure of 12 "
        "to 18 mmHg.",
        "Systolic pressure below 90 mmHg, index below 2.2 L/min/m2, wedge above 15 mmHg: SHOCK "
        "trial (Hochman et al. 1999, doi:10.1056/NEJM199908263410901); hypotension as a mean "
        "below 60 mmHg: doi:10.1161/CIRCHEARTFAILURE.120.007678 (2020). The filling of both sides"
        " is chosen within these",
        (
            Aim("SP", 60, 90), Aim("MAP", 55, 60), Aim(CARDIAC_INDEX, 1.5, 2.0), Aim("PCWP", 20, 28),
            Aim("right_atrial_pressure", 12, 18), Aim("ejection_fraction_lv", 10, 30),
        ),
        {
            "patient": _person("Cardiogenic shock", "male", 62, 176, 84, 105),
            "parameters": {"Emaxlv": 0.466, "Emaxrv": 0.206, "Rmc": 0.645, "Rpmc": 0.138, "P0svn": 46.0},
        },
    ),
    Preset(
        "right-heart-failure",
        "Right heart failure",
        "Cardiac index below 2.2 L/min/m2, central venous pressure above 10 mmHg and above 0.63 of the wedge "
        "pressure, with a raised pulmonary resistance and a left ventricle that is poorly filled.",
        "Konstam et al. 2018, statement of the American Heart Association, doi:10.1161/CIR.0000000000000560: "
        "central venous pressure, its ratio to the wedge pressure, index. The values within are chosen",
        (
            Aim(CARDIAC_INDEX, 1.5, 2.2), Aim("right_atrial_pressure", 12, 20), Aim("PCWP", 3, 15),
            Aim("MPAP", 25, 40), Aim("MAP", 60, 80),
        ),
        {
            "patient": _person("Right heart failure", "female", 58, 166, 70, 105),
            "parameters": {
                "Emaxlv": 1.2, "Emaxrv": 0.155, "RV_Pd_kappa": 0.025, "Rpmc": 0.408, "Rmc": 0.872,
                "P0svn": 23.6,
            },
        },
    ),
    Preset(
        "paper",
        "V-A ECMO + CRRT (Thiel 2025)",
        "The patient of section 3.3 of Thiel et al. 2025 with the fitted parameters of Table S-4, CRRT in "
        "scheme g. Height, weight and heart rate are not printed there and are assumed.",
        "Thiel et al. 2025, arXiv:2407.08871, section 3.3 and Table S-4; a patient's fitted parameters",
        (Aim("MAP", 69, 72), Aim("PF", 3.5, 3.9)),
        {
            "patient": _person("Thiel 2025, section 3.3", "female", 70, 165, 60, 120),
            "ecmo": _rotaflow("VA", 3425.0, 21.0, 17.0),
            "crrt": {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy"},
            "parameters": dict(TABLE_S4),
        },
        ("crrt",),
    ),
    Preset(
        "vv-ecmo",
        "V-V ECMO",
        "Lung failure: mean pulmonary artery pressure above 25 mmHg with a normal wedge pressure,"
        " a high cardiac output, and a pump flow of 4 to 5 L/min.",
        "Raised pulmonary artery pressure in lung failure on V-V ECMO: Hong et al. 2022, "
        "doi:10.4266/acc.2021.00927; flow of 60 to 80 mL/kg/min is full support (textbooks). The "
        "values within are chosen",
        (
            Aim("MPAP", 25, 40), Aim("PCWP", 4, 15), Aim("PF", 4, 5), Aim("right_atrial_pressure", 5, 15),
            Aim("MAP", 65, 90), Aim(CARDIAC_INDEX, 2.8, 4.5),
        ),
        {
            "patient": _person("V-V ECMO", "male", 45, 180, 85, 100),
            "ecmo": _rotaflow("VV", 2900.0, 25.0, 21.0),
            "parameters": {
                "Rpmc": 0.168, "Rmc": 0.56, "Emaxlv": 1.4, "Emaxrv": 0.32, "Csart": 1.1, "P0svn": 17.0,
            },
        },
        ("crrt",),
    ),
    Preset(
        "lvad",
        "LVAD",
        "End-stage heart failure on a HeartMate 3: mean arterial pressure 70 to 90 mmHg, central "
        "venous pressure below 12 and wedge below 18 mmHg, pump flow of 4 to 5 L/min, the aortic "
        "valve still opening.",
        "Central venous pressure and wedge that count as normal at the set speed: Uriel et al. 2016, "
        "doi:10.1016/j.jchf.2015.10.001. The values within are chosen",
        (
            Aim("MAP", 70, 90), Aim("lvad_flow", 4, 5), Aim("aortic_valve_flow", 0.1, 2),
            Aim("right_atrial_pressure", 4, 12), Aim("PCWP", 8, 18),
        ),
        {
            "patient": _person("LVAD", "male", 58, 178, 82, 80),
            "lvad": {"pump": "HM3", "speed_rpm": 4900.0, "inlet_site": "lv", "outlet_site": "ao"},
            "parameters": {"Emaxlv": 0.632, "Emaxrv": 0.21, "Rmc": 0.82, "Csart": 1.1, "P0svn": 20.5},
        },
        ("ecmo",),
    ),
)  # fmt: skip

PRESETS: Mapping[str, Preset] = MappingProxyType({preset.key: preset for preset in _PRESETS})
"""Preset cases, by key."""
