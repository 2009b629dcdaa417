"""Blood loss in healthy people, with each published reflex: circulation, and what refill during it changes.

Rows are steady beats without any refill. As one of the experiments, the blood lost is what a course with the
default capillary wall has lost when the bleeding ends; the abstracts do not state how long it took but once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from eclsim.fluid.law import PLASMA, RED_CELLS
from eclsim.orbit.model import Model
from eclsim.outputs.steady_beat import steady_beat
from eclsim.paper.comparison import Check, Row, within
from eclsim.parameters.regulation import EXTRA_VOLUME
from eclsim.regulation.attach import REFLEXES
from eclsim.regulation.heldt import HELDT_2010
from eclsim.validation.fluid import HELDT, Patient, batch_of, healthy
from eclsim.validation.reference_cases import compared

BLED = "Circulatory and respiratory adaptation in man to acute withdrawal of blood (8 men, 950 g), abstract"
JOHNSON = "Johnson 2014 (10.1152/japplphysiol.00070.2014), 12 men bled 3 x 333 mL, abstract"
FIRST_SIX = "Johnson 2013 (10.1096/fasebj.27.1_supplement.1206.3), 6 men bled 1 L, abstract"
RICKARDS = "PMC4747890, 9 men of the same laboratory bled 3 x 333 mL, abstract"
LEONETTI = "Leonetti 2004 (10.1007/s10286-004-0191-1), 12 patients bled 375 mL, abstract"
SIX = (
    "Johnson 2015 (10.1096/fasebj.29.1_supplement.823.4), 6 men bled up to 1 L, 833 mL in the mean, abstract"
)
BIOIMPEDANCE = (
    "Changes in cardiac output after acute blood loss and position change in man (Crit Care Med 1989, 17:979)"
    ", 27 volunteers, bioimpedance, abstract"
)
LOSSES = {0: 0.0, 333: 15.0, 667: 30.0, 1000: 45.0, 900: 20.0, 375: 6.4, 500: 10.0, 833: 37.5}
"""Blood lost [mL], and the time it takes [min]: printed for 375 mL, assumed for all others."""
MEN = tuple(LOSSES)


def changed_ml(man: Model, refilled: bool) -> np.ndarray:
    """Change of the blood volume [mL] for each of `LOSSES`, without or with refill through the man's wall."""
    if not refilled:
        return np.array([-float(lost) for lost in LOSSES])
    patient, changes = Patient(man), [0.0]
    for lost, minutes in list(LOSSES.items())[1:]:
        _, states = patient.course(minutes / 60.0, {"bleed_ml": lost / (60.0 * minutes)})
        blood = states[PLASMA] + states[RED_CELLS]
        changes.append(float(blood[-1] - blood[0]))
    return np.array(changes)


def bled(man: Model, refilled: bool = False) -> dict[str, float]:
    """Effects of blood loss on a man, by the names of the rows.

    Args:
        man: healthy man before the loss.
        refilled: whether fluid returns from the tissues while he bleeds.
    """
    names = ("MAP", "CO", "heart_rate", "right_atrial_pressure", "SP", "DP", "systemic_resistance_factor",
             "unstressed_volume")  # fmt: skip
    volumes = {EXTRA_VOLUME: man.values[EXTRA_VOLUME] + changed_ml(man, refilled)}
    beats = steady_beat(batch_of(man, volumes), names)
    pressure, flow, rate, venous, systolic, diastolic, resistance, unstressed = map(beats.output, names)

    stroke = flow / rate

    def change(values: np.ndarray, lost: int) -> float:
        return 100.0 * float(values[MEN.index(lost)] / values[0] - 1.0)

    def rise(values: np.ndarray, lost: int) -> float:
        return float(values[MEN.index(lost)] - values[0])

    def slope(values: np.ndarray, over: np.ndarray) -> float:
        return float(np.polyfit(over[:4], values[:4], 1)[0])

    return {
        "0.9 L: cardiac output": change(flow, 900),
        "0.9 L: heart rate": change(rate, 900),
        "0.9 L: resistance": change(resistance, 900),
        "1 L: MAP": float(pressure[3]),
        "1 L: CVP": float(venous[3]),
        "1 L: heart rate": float(rate[3]),
        "1 L: blood that veins give": float(unstressed[0] - unstressed[3]),
        "0 to 1 L: MAP for each mmHg of CVP": slope(pressure, venous),
        "0 to 1 L: heart rate for each mmHg of pulse pressure": slope(rate, systolic - diastolic),
        "1 L: CVP, nine men": float(venous[3]),
        "333 mL to 1 L: stroke volume": 100.0 * float(stroke[3] / stroke[1] - 1.0),
        "375 mL: stroke volume": change(stroke, 375),
        "375 mL: heart rate": change(rate, 375),
        "500 mL: cardiac output": change(flow, 500),
        "500 mL: stroke volume": change(stroke, 500),
        "500 mL: heart rate": change(rate, 500),
        "500 mL: MAP, change": rise(pressure, 500),
        "833 mL: MAP, change": rise(pressure, 833),
        "833 mL: CVP, change": rise(venous, 833),
        "833 mL: heart rate, change": rise(rate, 833),
        "833 mL: stroke volume": change(stroke, 833),
    }


MEASURED = (
    ("0.9 L: cardiac output", -28.0, 14.0, "%", f"{BLED}; half of it taken as spread"),
    ("0.9 L: heart rate", 0.0, 8.0, "%", f"{BLED}; unchanged, 8 % taken as spread"),
    ("1 L: MAP", 80.8, 4.0, "mmHg", FIRST_SIX),
    ("1 L: CVP", 1.1, 1.4, "mmHg", FIRST_SIX),
    ("1 L: heart rate", 66.0, 5.0, "1/min", FIRST_SIX),
    ("1 L: blood that veins give", 500.0, 250.0, "mL", f"{HELDT}; half of it taken as spread"),
    ("0 to 1 L: MAP for each mmHg of CVP", 0.13, 0.52, "1", JOHNSON),
    ("0 to 1 L: heart rate for each mmHg of pulse pressure", -0.46, 0.54, "1/min/mmHg", JOHNSON),
    ("1 L: CVP, nine men", 2.1, 1.8, "mmHg", f"{RICKARDS}; two standard errors"),
    ("333 mL to 1 L: stroke volume", -15.0, 7.5, "%", f"{RICKARDS}, 80 to 68 mL; half of it taken as spread"),
    ("375 mL: stroke volume", -14.1, 7.1, "%", f"{LEONETTI}; half of it taken as spread"),
    ("375 mL: heart rate", 4.1, 8.0, "%", f"{LEONETTI}; not significant, 8 % taken as spread"),
    ("500 mL: cardiac output", -18.0, 9.0, "%", f"{BIOIMPEDANCE}; half of it taken as spread"),
    ("500 mL: stroke volume", -22.0, 11.0, "%", f"{BIOIMPEDANCE}; half of it taken as spread"),
    ("500 mL: heart rate", 0.0, 8.0, "%", f"{BIOIMPEDANCE}; not significant, 8 % taken as spread"),
    ("500 mL: MAP, change", 0.0, 7.0, "mmHg", f"{BIOIMPEDANCE}; not significant, 8 % taken as spread"),
    ("833 mL: MAP, change", -7.0, 8.0, "mmHg", f"{SIX}; 93 +- 10 to 86 +- 8, not significant"),
    ("833 mL: CVP, change", -4.5, 1.5, "mmHg", f"{SIX}; 6.4 +- 1.7 to 1.9 +- 1.8; two standard errors"),
    ("833 mL: heart rate, change", 8.0, 9.0, "1/min", f"{SIX}; 60 +- 11 to 68 +- 8, two standard errors"),
    ("833 mL: stroke volume", -11.1, 5.6, "%", f"{SIX}; 108 to 96 mL; half of it taken as spread"),
)
"""Measurements in healthy people: name, value, spread, unit, source."""


_FLOOR = "an empty right ventricle of the published patient has 2.5 mmHg (RV_Pd_beta)"
_LATE = "this reflex hardly constricts before arterial pressure falls"
_PATHWAYS = "the cardiopulmonary pathways of CVSim"
_RETURNS = "fluid that returns while people bleed is missing in steady beats"
_DEFAULT = "that of the default wall, in the time assumed"


class Experiment(NamedTuple):
    """Possible reason for differences from measurements of bleeding, and the changes that remove them.

    Attributes:
        text: the reason.
        refilled: whether fluid returns while people bleed.
        changes: arguments of `healthy`.
        joined: whether it gives a reflex other pathways, which `heldt2010` has.
    """

    text: str
    refilled: bool
    changes: Mapping[str, float]
    joined: bool = False


EXPERIMENTS = (
    Experiment(f"{_RETURNS}; with {_DEFAULT}, the row holds", True, {}),
    Experiment(f"{_FLOOR}; with 0 the row holds", False, {"RV_Pd_beta": 0.0}),
    Experiment(f"{_LATE}; with {_PATHWAYS} the row holds", False, {"cardiopulmonary": True}, True),
    Experiment(
        f"{_FLOOR}, and {_LATE}; the row holds with 0 and {_PATHWAYS} together, not with one of them alone",
        False, {"RV_Pd_beta": 0.0, "cardiopulmonary": True}, True,
    ),
    Experiment(
        f"{_FLOOR}, and {_RETURNS}; the row holds with 0 and {_DEFAULT}, not with one of them alone",
        True, {"RV_Pd_beta": 0.0},
    ),
    Experiment(
        f"{_FLOOR}, {_LATE}, and {_RETURNS}; the row holds with 0, {_PATHWAYS} and {_DEFAULT}, together",
        True, {"RV_Pd_beta": 0.0, "cardiopulmonary": True}, True,
    ),
)  # fmt: skip


def bleeding_check() -> Check:
    """Compare men who lose blood, with each reflex."""
    return compared("bleeding", (row for reflex in REFLEXES for row in _bled(reflex)))


def _bled(reflex: str) -> list[Row]:
    """Rows of all studies with a reflex; a miss has the first experiment that explains it."""
    own = [one for one in EXPERIMENTS if not (one.joined and reflex == HELDT_2010.name)]
    tried = [(one.text, bled(healthy(reflex, **one.changes), one.refilled)) for one in own]
    got, rows = bled(healthy(reflex)), []
    for name, expected, spread, unit, source in MEASURED:
        label = f"{name}, {reflex} (test)"
        row = within(label, expected, got[name], spread, unit, source=source)
        explained = [row.explained_by(words, one[name], f"{label}, experiment") for words, one in tried]
        rows.append(next((one for one in explained if one.evidence[0].holds), explained[-1]))
    return rows
