"""Apnoea against measurements: how long the oxygen of lungs and blood lasts, and how carbon dioxide rises.

Nothing was fitted. The patient is an adult under anaesthesia as textbooks have him: 250 mL/min of oxygen
consumed, 2.2 L of gas in the lungs, 5 L/min of cardiac output at a mean pressure of 85 mmHg.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from eclsim.cases.reading import read_mapping
from eclsim.course.beats import course_beats
from eclsim.paper.comparison import Check, Row, within

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
"""Fraction of oxygen breathed before."""
MINUTES, BEGIN = {AIR: 5.0, OXYGEN: 15.0}, 1.0
OUTPUTS = ("SaO2", "PaCO2")


def apnoea_check() -> Check:
    """An adult who breathed air or oxygen, and then not at all with the airway open to air."""
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
    bar = "spreads of the measurements; compared, not required"
    return Check("apnoea", "Apnoea against measurements", bar, rows, required=False)


def apnoea(fio2: float, **gas: float) -> xr.Dataset:
    """Beats of the patient, whom nothing ventilates from minute 0 on.

    Args:
        fio2: fraction of oxygen breathed before.
        gas: other keys of [gas].
    """
    stop = {"at_min": BEGIN, "set": {"gas.alveolar_ventilation_l_min": 0.0}}
    case = PATIENT | {"gas": PATIENT["gas"] | {"fio2": fio2} | gas, "events": [stop]}
    beats = course_beats(read_mapping(case).case, minutes=MINUTES[fio2], every_min=0.1, outputs=OUTPUTS)
    return beats.assign_coords(time_min=beats["time_min"] - BEGIN)


def time_to(beats: xr.Dataset, saturation: float) -> float:
    """Minutes until the arterial saturation [%] has fallen to a value; NaN where it has not."""
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
    """Rises of PaCO2 in the first minute [mmHg], and in the three that follow [mmHg/min]."""
    start, first, fourth = np.interp((0.0, 1.0, 4.0), beats["time_min"], beats["PaCO2"])
    return float(first - start), float((fourth - first) / 3.0)


def _carbon_dioxide(beats: xr.Dataset) -> list[Row]:
    """How fast arterial carbon dioxide rises."""
    first, later = rises(beats)
    return [
        within("oxygen: PaCO2 rises in the first minute by (test)", 9.8, first, 1.9, "mmHg",
               source=KOBAYASHI),
        Row("oxygen: PaCO2 rises in minutes 2 to 4 by (test)", later, 3.4, 4.4, "mmHg/min", source=KOBAYASHI),
    ]  # fmt: skip
