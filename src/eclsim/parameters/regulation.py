"""Parameters of regulation, drugs and fluid.

All are settings of a patient's regulation and of their treatment, none is a property of the published model:
at the values here a circuit that has them is the published one, but for the reflex, which then answers to
every departure from its set point.
"""

from __future__ import annotations

import math
from types import MappingProxyType

from eclsim.parameters.parameter import Bounds, Parameter

REGULATION, FLUID, DRUGS = "regulation", "fluid", "drugs"
GAIN = f"{REGULATION}.baroreflex"
SET_POINT, VENOUS_SET_POINT = f"{REGULATION}.set_point_mmHg", f"{REGULATION}.venous_set_point_mmHg"
HYPOXIA = f"{REGULATION}.hypoxic_vasoconstriction"
UNSTRESSED = "unstressed_volume_ml"
EXTRA_VOLUME = f"{FLUID}.extra_volume_ml"
MODELS = ("ursino1998", "heldt2004")
"""Published reflexes, by the name in a case file."""

DRUG_DOSES = {
    "noradrenaline": (3.0, 1.0),
    "dobutamine": (40.0, 20.0),
    "milrinone": (2.0, 0.75),
    "nitroprusside": (10.0, 3.0),
}
"""Drugs that are infused: the largest dose that a case may give, and the largest usual one [ug/kg/min]."""


def dose(drug: str) -> str:
    """Key of a drug's infusion rate [ug/kg/min]."""
    return f"{DRUGS}.{drug}"


def sensitivity(drug: str) -> str:
    """Key of what a patient's dose is multiplied by: 2 for one who needs half of it."""
    return f"{DRUGS}.{drug}_sensitivity"


# key, value, unit, description, source, minimum, maximum, group
_TABLE = (
    (GAIN, 1.0, "1", "Gain of all reflexes: 1 as published, 0 none",
     "1: the published reflex of healthy adults", 0.0, 1.2, REGULATION),
    (SET_POINT, 92.0, "mmHg", "Mean arterial pressure at which reflexes do nothing",
     "Ursino 1998; of a patient their own pressure at rest", 20.0, 160.0, REGULATION),
    (VENOUS_SET_POINT, 5.0, "mmHg", "Mean right atrial pressure at which reflexes do nothing",
     "Heldt 2004; of a patient their own pressure at rest", -10.0, 40.0, REGULATION),
    (HYPOXIA, 0.0, "1", "Strength of hypoxic pulmonary vasoconstriction in courses: 1 as published, 0 none",
     "Marshall 1994, dogs; 0: the published patient", 0.0, 1.5, REGULATION),
    (UNSTRESSED, 0.0, "mL", "Systemic veins' unstressed volume beyond that of the published patient",
     "0: the published patient", -3000.0, 3000.0, REGULATION),
    (EXTRA_VOLUME, 0.0, "mL", "Blood given or, negative, lost before the steady beat",
     "0: the published patient", -3000.0, 5000.0, FLUID),
    *((dose(name), 0.0, "ug/kg/min", f"Steady infusion of {name}", "0: not given", 0.0, most, DRUGS)
      for name, (most, _) in DRUG_DOSES.items()),
    *((sensitivity(name), 1.0, "1", f"What the patient's dose of {name} is multiplied by",
       "1: the mean of the patients the drug was studied in", 0.02, 50.0, DRUGS) for name in DRUG_DOSES),
)  # fmt: skip

NORADRENALINE_SPREAD, OTHER_SPREAD = 1.64, 0.5
"""Standard deviation of the logarithm of a patient's sensitivity: of noradrenaline that of the half dose in
Beloeil 2005 (Br J Anaesth 95:782), read in a public program; of other drugs not verified."""
_BOUNDS = {GAIN: Bounds(0.5, 0.0, 1.2)} | {
    sensitivity(drug): Bounds(1.0, math.exp(-2.0 * spread), math.exp(2.0 * spread))
    for drug in DRUG_DOSES
    for spread in (NORADRENALINE_SPREAD if drug == "noradrenaline" else OTHER_SPREAD,)
}
"""Two standard deviations to either side, which a log-normal prior takes them for."""
PARAMETERS: MappingProxyType[str, Parameter] = MappingProxyType(
    {row[0]: Parameter(*row, bounds=_BOUNDS.get(row[0]), clipped=True) for row in _TABLE}
)
"""All parameters by key; each has its effect only where the section of a case file asks for it."""
