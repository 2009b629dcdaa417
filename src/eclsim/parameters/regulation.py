"""Parameters of regulation, drugs and fluid.

All are settings of a patient's regulation and treatment, not properties of the published model. At these
values a circuit is the published one, except for the reflex, which then responds to any deviation from its
set point.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import NamedTuple

from eclsim.parameters.parameter import Bounds, Parameter

REGULATION, FLUID, DRUGS = "regulation", "fluid", "drugs"
GAIN = f"{REGULATION}.baroreflex"
SET_POINT, VENOUS_SET_POINT = f"{REGULATION}.set_point_mmHg", f"{REGULATION}.venous_set_point_mmHg"
HYPOXIA = f"{REGULATION}.hypoxic_vasoconstriction"
CHEMOREFLEX, DILATION = f"{REGULATION}.chemoreflex", f"{REGULATION}.hypoxic_vasodilation"
HEART_RATE_RESPONSE = f"{REGULATION}.heart_rate_response"
CARBON_DIOXIDE = f"{REGULATION}.carbon_dioxide_response"
GAS_RESPONSES = (CHEMOREFLEX, DILATION, HYPOXIA, CARBON_DIOXIDE)
"""Responses to dissolved gases."""
PAO2_SET_POINT = f"{REGULATION}.set_point_pao2_mmHg"
PACO2_SET_POINT = f"{REGULATION}.set_point_paco2_mmHg"
VENOUS_O2_SET_POINT = f"{REGULATION}.set_point_venous_o2_ml_dl"
BEDS = ("sart", "upper", "lower")
"""Vascular beds of organs: of the whole body, or of its regions."""
SENSED_PAO2, SENSED_PACO2 = f"{REGULATION}.sensed_pao2_mmHg", f"{REGULATION}.sensed_paco2_mmHg"
LUNG_RESISTANCE = f"{REGULATION}.hypoxic_resistance"
LUNG_AT_REST = f"{REGULATION}.hypoxic_resistance_at_rest"
UNSTRESSED = "unstressed_volume_ml"
EXTRA_VOLUME = f"{FLUID}.extra_volume_ml"
MODELS = ("ursino1998", "heldt2004", "heldt2010")
"""Names of the published reflexes in case files."""


class DoseRange(NamedTuple):
    """Range of doses of an infused drug.

    Attributes:
        most: largest dose that a case may set.
        usual: largest usual dose.
        unit: unit of both.
    """

    most: float
    usual: float
    unit: str = "ug/kg/min"


DRUG_DOSES = {
    "noradrenaline": DoseRange(3.0, 1.0),
    "adrenaline": DoseRange(2.0, 0.5),
    "vasopressin": DoseRange(0.4, 0.1, "U/min"),
    "dobutamine": DoseRange(40.0, 20.0),
    "milrinone": DoseRange(2.0, 0.75),
    "levosimendan": DoseRange(0.6, 0.2),
    "nitroprusside": DoseRange(10.0, 3.0),
}
"""Infused drugs and their doses, by name."""


def of_bed(key: str, bed: str) -> str:
    """Key of a bed's own parameter; the bed of all organs ("sart") uses the key unchanged."""
    return key if bed == "sart" else key.replace(".", f".{bed}_", 1)


def paco2_set_point(bed: str) -> str:
    """Key of the set point of a bed's arterial PCO2; chemoreceptors have that of the upper body."""
    return of_bed(PACO2_SET_POINT, "lower") if bed == "lower" else PACO2_SET_POINT


CHEMOREFLEX_SET_POINTS = (PAO2_SET_POINT, PACO2_SET_POINT)
DILATION_SET_POINTS = tuple(
    dict.fromkeys(key for bed in BEDS for key in (paco2_set_point(bed), of_bed(VENOUS_O2_SET_POINT, bed)))
)
"""Set points (values at rest) of the responses to gases; that of the lung is `LUNG_AT_REST`."""


def local_resistance(bed: str) -> str:
    """Key of the factor by which oxygen and carbon dioxide change a bed's resistance."""
    return of_bed(f"{REGULATION}.local_resistance", bed)


def local_factor(resistance: str) -> str:
    """Name of the output that holds such a factor's value in the beat."""
    return resistance.partition(".")[2] + "_factor"


def dose(drug: str) -> str:
    """Key of a drug's infusion rate (`DRUG_DOSES` has its unit)."""
    return f"{DRUGS}.{drug}"


def sensitivity(drug: str) -> str:
    """Key of the factor of a patient's dose: 2 for a patient who needs half of the usual dose."""
    return f"{DRUGS}.{drug}_sensitivity"


SOLVED_FOR = (SENSED_PAO2, SENSED_PACO2, *map(local_resistance, BEDS), LUNG_RESISTANCE)
"""Parameters that respond to gases: NaN in a case, solved for together with its beat."""
_BED_WORDS = {"sart": "", "upper": ", upper body", "lower": ", lower body"}
# key, value, unit, description, source, minimum, maximum, group
_TABLE = (
    (GAIN, 1.0, "1", "Gain of all reflexes: 1 as published, 0 none",
     "1: the published reflex of healthy adults", 0.0, 1.2, REGULATION),
    (SET_POINT, 92.0, "mmHg", "Mean arterial pressure at which reflexes do nothing",
     "Ursino 1998; of a patient their own pressure at rest", 20.0, 160.0, REGULATION),
    (VENOUS_SET_POINT, 5.0, "mmHg", "Mean right atrial pressure at which reflexes do nothing",
     "Heldt 2004; of a patient their own pressure at rest", -10.0, 40.0, REGULATION),
    (HEART_RATE_RESPONSE, 1.0, "1", "Share of the change of heart rate by reflexes and drugs that occurs",
     "1: a healthy sinus node; 0: a pacemaker, heart block, arrhythmia", 0.0, 1.0, REGULATION),
    (HYPOXIA, 0.0, "1", "Strength of hypoxic pulmonary vasoconstriction: 1 as published, 0 none",
     "Marshall 1994, dogs; 0: the published patient", 0.0, 1.5, REGULATION),
    (CHEMOREFLEX, 0.0, "1", "Strength of the chemoreflex: 1 as published, 0 none",
     "Magosso and Ursino 2001; 0: the published patient", 0.0, 1.2, REGULATION),
    (DILATION, 0.0, "1", "Strength of organs' answer to oxygen and carbon dioxide: 1 as published, 0 none",
     "Magosso and Ursino 2001; 0: the published patient", 0.0, 1.5, REGULATION),
    (CARBON_DIOXIDE, 0.0, "1", "Share of the answer to carbon dioxide that is the one measured in ventilated "
     "patients", "1: fitted to Thorens 1996 (PMID 8727430); 0: the published patient", 0.0, 1.0, REGULATION),
    (PAO2_SET_POINT, 95.0, "mmHg", "Arterial PO2 at which the chemoreflex does nothing",
     "healthy adults; of a patient their own at rest", 20.0, 600.0, REGULATION),
    *((of_bed(PACO2_SET_POINT, bed), 40.0, "mmHg",
       f"Arterial PCO2 at which chemoreflex and organs do nothing{words}",
       "Magosso and Ursino 2001; of a patient their own at rest", 10.0, 120.0, REGULATION)
      for bed, words in (("sart", ""), ("lower", ", lower body"))),
    *((of_bed(VENOUS_O2_SET_POINT, bed), 15.0, "mL/dL",
       f"Oxygen content of the blood that leaves the organs at which they do nothing{_BED_WORDS[bed]}",
       "Magosso and Ursino 2001: brain 14, muscle 15.5; of a patient their own at rest", 1.0, 25.0,
       REGULATION)
      for bed in BEDS),
    (SENSED_PAO2, 95.0, "mmHg", "PO2 at the chemoreceptors; solved for with the beat", "PaO2 of the beat",
     0.1, 1000.0, REGULATION),
    (SENSED_PACO2, 40.0, "mmHg", "PCO2 at the chemoreceptors; solved for with the beat", "PaCO2 of the beat",
     0.1, 1000.0, REGULATION),
    *((local_resistance(bed), 1.0, "1",
       f"Factor of the organs' resistance by dissolved gases{_BED_WORDS[bed]}; solved for with the beat",
       "local_resistance_factor of the beat", 0.01, 100.0, REGULATION) for bed in BEDS),
    (LUNG_RESISTANCE, 1.0, "1", "Factor of the lung's resistance by hypoxia; solved for with the beat",
     "hypoxic_resistance_wanted of the beat", 0.01, 100.0, REGULATION),
    (LUNG_AT_REST, 1.0, "1", "Resistance of the lung at rest relative to that without hypoxia",
     "of a patient at rest, Marshall 1994", 1.0, 3.2, REGULATION),
    (UNSTRESSED, 0.0, "mL", "Systemic veins' unstressed volume beyond that of the published patient",
     "0: the published patient", -3000.0, 3000.0, REGULATION),
    (EXTRA_VOLUME, 0.0, "mL", "Blood given or, negative, lost before the steady beat",
     "0: the published patient", -3000.0, 5000.0, FLUID),
    *((dose(name), 0.0, doses.unit, f"Steady infusion of {name}", "0: not given", 0.0, doses.most, DRUGS)
      for name, doses in DRUG_DOSES.items()),
    *((sensitivity(name), 1.0, "1", f"What the patient's dose of {name} is multiplied by",
       "1: the mean of the patients the drug was studied in", 0.02, 50.0, DRUGS) for name in DRUG_DOSES),
)  # fmt: skip

NORADRENALINE_SPREAD, OTHER_SPREAD = 1.64, 0.5
"""Standard deviation of the logarithm of a patient's sensitivity: for noradrenaline that of the half dose in
Beloeil 2005 (Br J Anaesth 95:782), read in a public program; for other drugs not verified."""
_BOUNDS = {GAIN: Bounds(0.5, 0.0, 1.2)} | {
    sensitivity(drug): Bounds(1.0, math.exp(-2.0 * spread), math.exp(2.0 * spread))
    for drug in DRUG_DOSES
    for spread in (NORADRENALINE_SPREAD if drug == "noradrenaline" else OTHER_SPREAD,)
}
"""Bounds at two standard deviations to either side, as a log-normal prior interprets them."""
PARAMETERS: MappingProxyType[str, Parameter] = MappingProxyType(
    {row[0]: Parameter(*row, bounds=_BOUNDS.get(row[0]), clipped=True) for row in _TABLE}
)
"""All parameters by key; each has an effect only if the section of a case file enables it."""
