"""Drainage of a patient short of blood, with veins that collapse."""

from __future__ import annotations

import numpy as np

from eclsim.cases.reading import read_mapping
from eclsim.devices.ecmo import ECMO
from eclsim.orbit.model import PATIENT_HELD, Model, model_of
from eclsim.outputs.results import simulate, simulate_many
from eclsim.paper.comparison import Check, Row, within
from eclsim.parameters.regulation import EXTRA_VOLUME
from eclsim.validation.matching import with_outputs

SIMONS = (
    "Simons, Lindelauf, Ganushchak, Maessen and Weerwind, Perfusion: strategies to preserve stable "
    "extracorporeal life support flow during simulated hypovolaemia (abstract)"
)
COLLAPSED = "Molegraaf and others, venous collapse in a mock circulation and in animals (abstract)"
NORMAL_L_MIN, SHORT_L_MIN = 3.1, 2.3
SHORT_MMHG, SPREAD_MMHG = -114.0, 52.0
"""Flow with and without enough blood at one speed, and the pressure of the venous line then [mmHg]."""
SPEED = f"{ECMO.key}.speed_rpm"
LOST_ML = -740.0
"""Where the search for the blood that is missing begins."""
UNLIKE = (
    "suction: the abstract names neither cannulae nor pump; here 25 and 19 Fr, a Rotaflow, and a patient in "
    "place of a mock circulation"
)


def patient(collapsible: bool = True, volume_ml: float = 0.0) -> Model:
    """On central V-A ECMO, the left ventricle failing; circuits are primed.

    Bronchial return and a leaking tricuspid valve keep valves that stay shut from parting the circulation.
    """
    case = {
        "format": 1,
        "blood_volume_policy": PATIENT_HELD,
        "patient": {
            "id": "P", "sex": "male", "age_years": 60, "height_cm": 175, "weight_kg": 75,
            "heart_rate_bpm": 90,
        },
        "physiology": {
            "bronchial_fraction": 0.015, "tricuspid_regurgitation_cm2": 0.05,
            "collapsible_veins": collapsible,
        },
        "fluid": {"extra_volume_ml": volume_ml},
        ECMO.key: {
            "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult", "mode": "VA",
            "drainage_fr": 25, "return_fr": 19,
        },
        "parameters": {"Emaxlv": 0.7},
    }  # fmt: skip
    return model_of(read_mapping(case).case)


def suction_check() -> Check:
    """Suction at a lowered flow, and what more speed gives then."""
    filled = with_outputs(patient(), (SPEED,), {"PF": NORMAL_L_MIN})
    short = with_outputs(filled.with_values({EXTRA_VOLUME: LOST_ML}), (EXTRA_VOLUME,), {"PF": SHORT_L_MIN})
    pressure = float(simulate(short)["drainage_pressure"])
    words = f"as much blood lost as lowers {NORMAL_L_MIN} to {SHORT_L_MIN} L/min: drainage pressure"
    gains = [_gain(one) for one in (filled, short)]
    rows: list[Row] = [
        within(words, SHORT_MMHG, pressure, SPREAD_MMHG, "mmHg", source=SIMONS),
        within("a step of speed changes the flow less in collapse: sign", -1.0,
               float(np.sign(gains[1] - gains[0])), 0.5, source=COLLAPSED),
    ]  # fmt: skip
    bar = "1 standard deviation, sign; compared, not required"
    return Check(
        "suction", "Suction, a patient short of blood", bar, tuple(rows), required=False, remarks=(UNLIKE,)
    )


def _gain(model: Model) -> float:
    """Flow that 1000 rpm more give [L/min]."""
    speed = model.values[SPEED]
    flows = simulate_many(model, {SPEED: [speed - 100.0, speed + 100.0]}, ["PF"])["PF"].values
    return 5.0 * float(flows[1] - flows[0])
