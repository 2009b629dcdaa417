"""Ranges of outputs of an adult's beat: healthy ones from the literature, and those of severest illness.

The healthy range is that of the source, or mean +- 2 standard deviations. The wider, plausible range is a
convention of this program that detects only gross errors: end-diastolic ventricular volumes are between a
third of the smallest and twice the largest healthy one; pressures extend to those of the worst shock and of
the worst congestion or pulmonary hypertension. Atria are omitted: those of the model have no volume at zero
pressure, so they cannot be compared with imaging.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Sex = Literal["female", "male"]

_HUDSMITH = "Hudsmith 2005, magnetic resonance, 63 men and 45 women, mean ± 2 SD"
_CATHETER = "right heart catheterisation, practical table, European Respiratory Society"
_KAWEL_BOEHM = "Kawel-Boehm 2015, magnetic resonance, mean ± 2 SD"
_EXTRACTION = "McLellan and Walsh 2004; the critical one is 0.60 +- 0.13 (Ronco 1993)"
_NURSING = "rnceus.com/hemo/term.htm, nursing reference"


@dataclass(frozen=True, slots=True)
class AdultRange:
    """Range of one output.

    Args:
        output: name in the registry of outputs.
        description: description of the output.
        unit: unit of the numbers.
        healthy: smallest and largest value in health.
        plausible: smallest and largest value possible in an ill adult; infinite if not limited.
        source: source of the healthy range.
    """

    output: str
    description: str
    unit: str
    healthy: tuple[float, float]
    plausible: tuple[float, float]
    source: str


_DIASTOLIC = {
    "EDVLV": ("end-diastolic volume of the left ventricle", {"male": (160.0, 29.0), "female": (135.0, 26.0)}),
    "EDVRV": (
        "end-diastolic volume of the right ventricle",
        {"male": (190.0, 33.0), "female": (148.0, 35.0)},
    ),
}
_SYSTOLIC = {
    "ESVLV": ("end-systolic volume of the left ventricle", {"male": (50.0, 16.0), "female": (42.0, 12.0)}),
    "ESVRV": ("end-systolic volume of the right ventricle", {"male": (78.0, 20.0), "female": (56.0, 18.0)}),
}
_OTHERS = (
    AdultRange(
        "ejection_fraction_lv", "ejection fraction of the left ventricle", "%",
        (57.0, 77.0), (2.0, 90.0), _KAWEL_BOEHM,
    ),
    AdultRange("MAP", "mean arterial pressure", "mmHg", (70.0, 100.0), (20.0, 200.0), _NURSING),
    AdultRange("CO", "flow through the lungs", "L/min", (4.0, 6.0), (0.0, 15.0), _CATHETER),
    AdultRange("O2ER", "oxygen extraction ratio", "", (0.2, 0.3), (0.02, 0.8), _EXTRACTION),
    AdultRange(
        "right_atrial_pressure", "mean right atrial pressure", "mmHg", (1.0, 6.0), (-5.0, 30.0), _CATHETER
    ),
    AdultRange("SPAP", "systolic pulmonary artery pressure", "mmHg", (15.0, 25.0), (4.0, 120.0), _CATHETER),
    AdultRange("MPAP", "mean pulmonary artery pressure", "mmHg", (8.0, 20.0), (2.0, 90.0), _CATHETER),
    AdultRange("PCWP", "pulmonary capillary wedge pressure", "mmHg", (4.0, 12.0), (0.0, 45.0), _CATHETER),
    AdultRange(
        "end_diastolic_pressure_lv", "end-diastolic pressure of the left ventricle", "mmHg",
        (4.0, 12.0), (0.0, 50.0), f"that of the wedge pressure: {_CATHETER}",
    ),
    AdultRange(
        "end_diastolic_pressure_rv", "end-diastolic pressure of the right ventricle", "mmHg",
        (1.0, 8.0), (-3.0, 35.0), _CATHETER,
    ),
)  # fmt: skip


def adult_ranges(sex: Sex) -> dict[str, AdultRange]:
    """Ranges for a woman or a man, by output."""
    result = []
    for output, (description, by_sex) in _DIASTOLIC.items():
        low, high = _two_deviations(by_sex[sex])
        result.append(AdultRange(output, description, "mL", (low, high), (low / 3.0, 2.0 * high), _HUDSMITH))
    for output, (description, by_sex) in _SYSTOLIC.items():
        low, high = _two_deviations(by_sex[sex])
        result.append(AdultRange(output, description, "mL", (low, high), (0.0, 2.0 * high), _HUDSMITH))
    return {r.output: r for r in (*result, *_OTHERS)}


def _two_deviations(mean_and_deviation: tuple[float, float]) -> tuple[float, float]:
    mean, deviation = mean_and_deviation
    return mean - 2.0 * deviation, mean + 2.0 * deviation
