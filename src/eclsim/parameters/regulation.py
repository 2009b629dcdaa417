"""Parameters of regulation, drugs and fluid.

All are settings of a patient's regulation and treatment, not properties of the published model. At these
values a circuit is the published one, except for the reflex, which then responds to any deviation from its
set point.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import MappingProxyType
from typing import NamedTuple

from eclsim.parameters.parameter import Bounds, Parameter, read_parameters

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
NORADRENALINE_SPREAD, OTHER_SPREAD = 1.64, 0.5
"""Standard deviation of the logarithm of a patient's sensitivity: for noradrenaline that of the half dose in
Beloeil 2005 (Br J Anaesth 95:782), read in a public program; for other drugs not verified."""


def _of_drugs() -> Iterator[Parameter]:
    for name, doses in DRUG_DOSES.items():
        yield Parameter(
            dose(name), 0.0, doses.unit, f"Steady infusion of {name}", "0: not given", 0.0, doses.most, DRUGS,
            clipped=True,
        )  # fmt: skip
    for name in DRUG_DOSES:
        spread = NORADRENALINE_SPREAD if name == "noradrenaline" else OTHER_SPREAD
        # Two standard deviations to either side, as a log-normal prior interprets bounds.
        bounds = Bounds(1.0, math.exp(-2.0 * spread), math.exp(2.0 * spread))
        yield Parameter(
            sensitivity(name), 1.0, "1", f"What the patient's dose of {name} is multiplied by",
            "1: the mean of the patients the drug was studied in", 0.02, 50.0, DRUGS, bounds, clipped=True,
        )  # fmt: skip


PARAMETERS: MappingProxyType[str, Parameter] = MappingProxyType(
    {**read_parameters(__file__), **{parameter.key: parameter for parameter in _of_drugs()}}
)
"""All parameters by key; each has an effect only if the section of a case file enables it."""
