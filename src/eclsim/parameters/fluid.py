"""Parameters of fluid and solutes in time: blood, interstitium and capillary wall.

At the start they change nothing in a circuit: the haematocrit is the one at which resistances were measured
or fitted, and filtration, refill and lymph are in balance.
"""

from __future__ import annotations

from eclsim.parameters import dialysed_drug
from eclsim.parameters.parameter import read_parameters

SECTION, SOLUTES = "fluid", "solutes"
HAEMATOCRIT, REFERENCE = f"{SECTION}.haematocrit", f"{SECTION}.reference_haematocrit"
FCELLS = 0.9
"""Whole-body to large-vessel haematocrit, 0.9 +- 0.05 (Hemodial Int, PMC4937455, abstract)."""
INTERSTITIUM_TO_BLOOD = (1.0 - FCELLS * 0.45) / 0.230
"""Ratio of normal interstitial to blood volume: plasma over interstitium is 0.230 in 10 healthy men (Moore
1966, bromide, abstract), here at a haematocrit of 0.45."""
PERICAPILLARY, LYMPH_PUMP = f"{SECTION}.pericapillary_share", f"{SECTION}.lymph_pump"
VENULES = f"{SECTION}.venular_tone"
SOLUTES_FOLLOWED, CARBON_DIOXIDE_STORES_HOLD = f"{SOLUTES}.followed", f"{SOLUTES}.stores_hold"
ACID, KIDNEY = f"{SOLUTES}.acid_generation_mmol_h", f"{SOLUTES}.kidney_clearance_ml_min"
PARAMETERS = read_parameters(__file__)
"""All parameters of [fluid] and [solutes] of a case file, by key."""
USUAL_HAEMATOCRIT = PARAMETERS[HAEMATOCRIT].value

STARTS = frozenset(
    f"{SECTION}.{name}"
    for name in (
        "extra_volume_ml", "haematocrit", "reference_haematocrit", "plasma_protein_g_dl",
        "interstitial_protein_g_dl", "interstitial_volume_ml", "filtration_ml_min_mmHg", "reflection",
        "lymph_ml_min", "pericapillary_share", "venular_tone",
    )
) | frozenset(
    f"{SOLUTES}.{name}"
    for name in (
        "urea_mmol_l", "creatinine_umol_l", "potassium_mmol_l", "bicarbonate_mmol_l", "body_water_ml",
        "bicarbonate_space_ml",
    )
) | {"gas.haemoglobin_g_dl"}  # fmt: skip
"""Keys of a case file that set the start of a course, besides the haematocrit at a filter. Exchange across
the capillary wall is in balance at the start, with the constants of the wall at the start."""


def sets_initial_value(key: str) -> bool:
    """Whether a key of a case file sets only the initial value of a quantity that a course follows."""
    return key in STARTS | dialysed_drug.STARTS or key.endswith(".haematocrit_in")
