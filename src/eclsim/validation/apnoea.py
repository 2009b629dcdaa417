"""Apnoea compared with measurements: duration of the oxygen stores, and rise of carbon dioxide.

Nothing was fitted. The patient is a textbook adult under anaesthesia: oxygen consumption 250 mL/min, 2.2 L of
gas in the lungs, cardiac output 5 L/min at a mean pressure of 85 mmHg.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from eclsim.cases.reading import read_mapping
from eclsim.course.beats import course_beats
from eclsim.paper.comparison import Check, Row, within
from eclsim.validation.reference_cases import compared

SIRIAN = "Sirian and Wills 2009 (10.1093/bjaceaccp/mkp017), review"
BERTHOUD = "Berthoud, Peacock and Reilly 1991 (10.1093/bja/67.4.464), six of normal weight, abstract"
KOBAYASHI = "Kobayashi and Yokoyama 1994 (Masui 43:1130), fifteen adults, abstract"
PATIENT = {
    "format": 1,
    "patient": {"id": "apnoea", "sex": "male", "age_years": 35, "heart_rate_bpm": 70, "height_cm": 175,
                "weight_kg": 70},
    "gas": {"haemoglobin_g_dl": 15.0, "alveolar_ventilation_l_min": 4.2, "shunt_fraction": 0.02,
            "vo2_ml_min": 250.0, "lung_volume_ml": 2200.0},
    "parameters": {"Rmc": 0.9, "Emaxlv": 1.5},
}  # fmt: skip
AIR, OXYGEN = 0.21, 1.0
"""Fraction of oxygen inspired before the apnoea."""
MINUTES, BEGIN = {AIR: 5.0, OXYGEN: 15.0}, 1.0
OUTPUTS = ("SaO2", "PaCO2")


def apnoea_check() -> Check:
    """Rows for an adult who breathed air or oxygen before apnoea with the airway open to air."""
    air, oxygen = (apnoea(fio2) for fio2 in (AIR, OXYGEN))
    rows = (
        within("air: SaO2 of 90 % is reached after (test)", 1.0, time_to(air, 90.0), 0.5, "min",
               source=f"{SIRIAN}; half of it taken as spread"),
        within("air: SaO2 then falls by (test)", 30.0, fall(air), 10.0, "%/min",
               source=f"{SIRIAN}; a third of it taken as spread"),
        within("oxygen: SaO2 of 90 % is reached after (test)", 9.9, time_to(oxygen, 90.0), 2.4, "min",
               source=BERTHOUD),
        *_carbon_dioxide(oxygen),
    )  # fmt: skip
    return compared("apnoea", rows)


def apnoea(fio2: float, **gas: float) -> xr.Dataset:
    """Simulate beats of the patient, without ventilation from minute 0 on.

    Args:
        fio2: fraction of oxygen inspired before the apnoea.
        gas: other keys of the section [gas].
    """
    stop = {"at_min": BEGIN, "set": {"gas.alveolar_ventilation_l_min": 0.0}}
    case = PATIENT | {"gas": PATIENT["gas"] | {"fio2": fio2} | gas, "events": [stop]}
    beats = course_beats(read_mapping(case).case, minutes=MINUTES[fio2], every_min=0.1, outputs=OUTPUTS)
    return beats.assign_coords(time_min=beats["time_min"] - BEGIN)


def time_to(beats: xr.Dataset, saturation: float) -> float:
    """Time until the arterial saturation [%] has fallen to a value [min]; NaN if it has not."""
    time, oxygen_saturation = beats["time_min"].to_numpy(), beats["SaO2"].to_numpy()
    below = np.flatnonzero(oxygen_saturation <= saturation)
    if not len(below):
        return float("nan")
    k = int(below[0])
    return float(np.interp(-saturation, -oxygen_saturation[k - 1 : k + 1], time[k - 1 : k + 1]))


def fall(beats: xr.Dataset) -> float:
    """Rate at which arterial saturation falls from 90 to 60 % [%/min]."""
    return 30.0 / (time_to(beats, 60.0) - time_to(beats, 90.0))


def rises(beats: xr.Dataset) -> tuple[float, float]:
    """Rise of PaCO2 in the first minute [mmHg], and its rate in the following three [mmHg/min]."""
    start, first, fourth = np.interp((0.0, 1.0, 4.0), beats["time_min"], beats["PaCO2"])
    return float(first - start), float((fourth - first) / 3.0)


def _carbon_dioxide(beats: xr.Dataset) -> list[Row]:
    """Rows for the rise of arterial carbon dioxide."""
    first, later = rises(beats)
    return [
        within("oxygen: PaCO2 rises in the first minute by (test)", 9.8, first, 1.9, "mmHg",
               source=KOBAYASHI),
        Row("oxygen: PaCO2 rises in minutes 2 to 4 by (test)", later, 3.4, 4.4, "mmHg/min", source=KOBAYASHI),
    ]  # fmt: skip
