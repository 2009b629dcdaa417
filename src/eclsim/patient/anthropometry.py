"""Height, weight and blood volume of an adult.

Height and weight by sex and age are means of Germany in 2021, as published with the code of Thiel et al.
(2025); they are used if a patient's own are not known. Blood volume is the regression on age, sex, body mass
index and weight that the same code uses.
"""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from eclsim.files import read_table
from eclsim.parameters.adult_ranges import Sex

SIZE: tuple[str, str] = ("patient.height_cm", "patient.weight_kg")
"""Names of the patient's height and weight among the values of a case, if gases are computed."""
AGE = "patient.age_years"
"""Name of the patient's age among the values of a case, if reflexes or drugs change the heart rate."""

_MEAN_HEIGHT_WEIGHT = read_table(Path(__file__).with_suffix(".csv"))
"""Height [cm] and weight [kg] by sex and range of age [years]."""

TABLE_SURFACE_M2 = 1.8
"""Body surface of the patient for whom the table of limits states those of oxygen delivery."""
MINIMUM_AGE_YEARS = 18.0
MAXIMUM_AGE_YEARS = 100.0


def mean_height_weight(sex: Sex, age_years: float) -> tuple[float, float]:
    """Mean height [cm] and weight [kg] of adults of a sex and age.

    Raises:
        ValueError: For a sex other than female or male, or an age outside 18 to 100 years.
    """
    if sex not in get_args(Sex):
        raise ValueError(f"sex {sex!r}: allowed are female and male")
    for row in _MEAN_HEIGHT_WEIGHT:
        age_to = float(row["age_to"])
        within = float(row["age_from"]) <= age_years < age_to or age_years == age_to == MAXIMUM_AGE_YEARS
        if row["sex"] == sex and within:
            return float(row["height_cm"]), float(row["weight_kg"])
    raise ValueError(
        f"age {age_years:g} years: the table covers {MINIMUM_AGE_YEARS:g} to {MAXIMUM_AGE_YEARS:g}"
    )


def body_mass_index(height_cm: float, weight_kg: float) -> float:
    """Body mass index [kg/m^2] from height [cm] and weight [kg]."""
    return weight_kg / (height_cm / 100.0) ** 2


def body_surface(height_cm: float, weight_kg: float) -> float:
    """Body surface [m^2] from height [cm] and weight [kg], sqrt(height weight / 3600) (Mosteller 1987)."""
    return (height_cm * weight_kg / 3600.0) ** 0.5


def total_blood_volume_ml(sex: Sex, age_years: float, height_cm: float, weight_kg: float) -> float:
    """Total blood volume [mL], ((90 - 5 [female]) - 0.4 age) / sqrt(BMI / 22) * weight.

    Source: published code of Thiel et al. (2025). The result scales the initial volumes of the
    heart chambers and is used for absolute volumes in plots.
    """
    per_kg = (85.0 if sex == "female" else 90.0) - 0.4 * age_years
    return per_kg / (body_mass_index(height_cm, weight_kg) / 22.0) ** 0.5 * weight_kg


def oxygen_consumption(height_cm: float, weight_kg: float) -> float:
    """Oxygen consumption at rest [mL/min STPD], 126 mL/min per m2 of body surface.

    Source: Dehmer, Firth and Hillis 1982 (doi 10.1002/clc.4960050803), 126 +- 26 in 108 adults, independent
        of age and sex; 121 +- 22 in those who were mildly sedated.
    """
    return 126.0 * body_surface(height_cm, weight_kg)


def delivery_limits(height_cm: float, weight_kg: float) -> tuple[float, float] | None:
    """Limits of low and of critical oxygen delivery for a patient's size [mL/min STPD].

    Both go with body surface, as oxygen consumption does: in the obese 4.5 mL/min per kg of actual weight
    would lie above the limit of low delivery, and in thin patients hardly above what they consume.

    Sources: 280 mL/min/m2 (Ranucci et al. 2005), and 4.5 mL/min/kg (Ronco et al. 1993) for a patient of 67 kg
        and 1.8 m2, as in the table of limits.

    Returns:
        Both, rounded to whole numbers; None if the surface is within 5 % of that of the table.
    """
    surface = body_surface(height_cm, weight_kg)
    if abs(surface / TABLE_SURFACE_M2 - 1.0) <= 0.05:
        return None
    return float(round(280.0 * surface)), float(round(4.5 * 67.0 / TABLE_SURFACE_M2 * surface))


def greatest_heart_rate(age_years: float) -> float:
    """Greatest heart rate of healthy people of an age [bpm], 208 - 0.7 age, rounded to whole numbers.

    Source: Tanaka, Monahan and Seals 2001 (doi 10.1016/S0735-1097(00)01054-8). Measured, in men of 25 and 65
        years: 191 +- 11 and 162 +- 9 bpm; most of the difference between them is that of the sinus node's
        own rate and of its response to isoprenaline (Christou and Seals 2008, PMC2494835).
    """
    return float(round(208.0 - 0.7 * age_years))


def body_water_ml(sex: Sex, age_years: float, height_cm: float, weight_kg: float) -> float:
    """Total body water [mL] (Watson, Watson and Batt 1980, Am J Clin Nutr 33:27)."""
    if sex == "female":
        return 1000.0 * (-2.097 + 0.1069 * height_cm + 0.2466 * weight_kg)
    return 1000.0 * (2.447 - 0.09516 * age_years + 0.1074 * height_cm + 0.3362 * weight_kg)
