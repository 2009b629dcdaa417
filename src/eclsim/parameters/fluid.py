"""Parameters of fluid and solutes in time: blood, interstitium and capillary wall.

At the start they change nothing in a circuit: the haematocrit is the one at which resistances were measured
or fitted, and filtration, refill and lymph are in balance.
"""

from __future__ import annotations

from types import MappingProxyType

from eclsim.parameters import dialysed_drug
from eclsim.parameters.parameter import Parameter

SECTION, SOLUTES = "fluid", "solutes"
HAEMATOCRIT, REFERENCE = f"{SECTION}.haematocrit", f"{SECTION}.reference_haematocrit"
USUAL_HAEMATOCRIT = 0.30
FCELLS = 0.9
"""Whole-body to large-vessel haematocrit, 0.9 +- 0.05 (Hemodial Int, PMC4937455, abstract)."""
INTERSTITIUM_TO_BLOOD = (1.0 - FCELLS * 0.45) / 0.230
"""Ratio of normal interstitial to blood volume: plasma over interstitium is 0.230 in 10 healthy men (Moore
1966, bromide, abstract), here at a haematocrit of 0.45."""
TISSUES = ("tissue", "upper_tissue", "lower_tissue")
"""Names of the exchanges of tissues that a circuit may have."""
PERICAPILLARY, LYMPH_PUMP = f"{SECTION}.pericapillary_share", f"{SECTION}.lymph_pump"
SOLUTES_FOLLOWED, CARBON_DIOXIDE_STORES_HOLD = f"{SOLUTES}.followed", f"{SOLUTES}.stores_hold"
_PATIENT = "of the patient; default assumed (intensive care)"
_NOT_VERIFIED = "textbook value, not verified"
_VOLUME = "of the patient; left out, 2.59 times the blood volume: Moore 1966 (bromide space, 10 healthy men)"

# section, key, value, unit, description, source, minimum, maximum
_TABLE = (
    (SECTION, "haematocrit", USUAL_HAEMATOCRIT, "1", "Haematocrit of the blood",
     "of the patient; left out, from haemoglobin or haematocrit_in, else 0.30", 0.05, 0.7),
    (SECTION, "reference_haematocrit", USUAL_HAEMATOCRIT, "1",
     "Haematocrit at which resistances are those of the tables", "left out, that of the blood", 0.05, 0.7),
    (SECTION, "capillary_refill", 1.0, "1", "Whether fluid crosses the capillary wall: 1 or 0", "setting",
     0.0, 1.0),
    (SECTION, "plasma_protein_g_dl", 6.0, "g/dL", "Protein of the plasma", _PATIENT, 2.0, 10.0),
    (SECTION, "interstitial_protein_g_dl", 2.4, "g/dL", "Protein of the interstitial fluid it can be in",
     "of the patient; left out, 0.4 of that of the plasma; textbook value, not verified", 0.2, 8.0),
    (SECTION, "interstitial_volume_ml", 13000.0, "mL", "Volume of the interstitial fluid", _VOLUME, 3000.0,
     60000.0),
    (SECTION, "filtration_ml_min_mmHg", 10.0, "mL/min/mmHg", "Filtration coefficient of all capillaries, LpS",
     "fitted to haemodialysis, 10.0 +- 8.4: Pietribiasi 2016 (PMID 27483369), abstract", 0.2, 60.0),
    (SECTION, "reflection", 0.9, "1", "Reflection coefficient of the capillary wall for protein",
     _NOT_VERIFIED, 0.45, 1.0),
    (SECTION, "lymph_ml_min", 5.6, "mL/min", "Flow of lymph at the start, before lymph nodes",
     "8 L in a day: Levick and Michel 2010 (10.1093/cvr/cvq062), not verified; protein then leaves at rest "
     "as measured (Rossing 1978, Lymphology 11:138, abstract)", 0.1, 20.0),
    (SECTION, "lymph_pump", 1.0, "1",
     "Pumping of the lymphatics, relative to that at which lymph and leak are in balance",
     "1: in balance; 2 measured in awake sheep 3 h after a quarter of the blood was lost (Boulanger 1994, "
     "Circ Shock, abstract)", 0.0, 6.0),
    (SECTION, "pericapillary_share", 1.0, "1",
     "Share of the interstitium, next to capillaries, that what crosses their wall passes first",
     "1, the interstitium is one; 0.12 was fitted to the fall of blood volume in two dialyses (Keane 2018, "
     "Dasselaar 2006)", 0.05, 1.0),
    (SOLUTES, "followed", 0.0, "1", "Whether solutes are followed in courses: 1 with [solutes], else 0",
     "setting", 0.0, 1.0),
    (SOLUTES, "urea_mmol_l", 25.0, "mmol/L", "Urea at the start", _PATIENT, 0.5, 120.0),
    (SOLUTES, "creatinine_umol_l", 300.0, "umol/L", "Creatinine at the start", _PATIENT, 10.0, 3000.0),
    (SOLUTES, "potassium_mmol_l", 4.5, "mmol/L", "Potassium at the start", _PATIENT, 1.5, 10.0),
    (SOLUTES, "bicarbonate_mmol_l", 24.0, "mmol/L", "Bicarbonate of the plasma at the start",
     "of the patient; left out, that of the base excess at 40 mmHg, else 24", 3.0, 60.0),
    (SOLUTES, "urea_generation_mmol_h", 15.0, "mmol/h", "Urea that the body makes",
     "10 g of nitrogen a day; assumed", 0.0, 200.0),
    (SOLUTES, "creatinine_generation_umol_h", 400.0, "umol/h", "Creatinine that the body makes",
     "about 1 g a day; assumed", 0.0, 3000.0),
    (SOLUTES, "potassium_generation_mmol_h", 0.0, "mmol/h", "Potassium that is given or set free", "setting",
     -50.0, 200.0),
    (SOLUTES, "acid_generation_mmol_h", 0.0, "mmol/h", "Acid that takes bicarbonate away, as lactic acid",
     "setting; 0, metabolism and kidney are in balance", -100.0, 500.0),
    (SOLUTES, "potassium_store_l", 150.0, "L",
     "Potassium that cells give or take, mmol for each mmol/L of the plasma's",
     "assumed: about 75 mmol in a haemodialysis lower it by about 0.5 mmol/L after the rebound; 370 in "
     "deficits of long standing (Sterns 1981, by its usual citation)", 10.0, 2000.0),
    (SOLUTES, "fluid_potassium_mmol_l", 4.0, "mmol/L", "Potassium of all fluids of the dialysis", "setting",
     0.0, 6.0),
    (SOLUTES, "kidney_clearance_ml_min", 0.0, "mL/min", "What the kidneys still clear", "setting", 0.0,
     200.0),
    (SOLUTES, "body_water_ml", 35000.0, "mL", "Water of the body, in which urea and creatinine are",
     "of the patient; left out, by sex, age, height and weight: Watson 1980 (Am J Clin Nutr 33:27)", 10000.0,
     90000.0),
    (SOLUTES, "bicarbonate_space_ml", 35000.0, "mL", "Apparent space of bicarbonate, buffers included",
     "left out, half the weight: the usual assumption, cited by Garella 1973 (N Engl J Med 289:121)", 5000.0,
     150000.0),
    (SOLUTES, "carbon_dioxide_store_ml_mmHg", 105.0, "mL/mmHg",
     "Carbon dioxide that the tissues store for each mmHg (STPD)",
     "left out, 1.5 mL/mmHg for each kg, blood included: Farhi and Rahn 1955 (dogs), abstract", 5.0, 600.0),
    (SOLUTES, "stores_hold", 0.0, "1", "Whether stores hold the PCO2 of tissues, 1, or it is steady, 0",
     "0; in courses 1", 0.0, 1.0),
    *(
        (SOLUTES, f"{tissue}_pco2_mmHg", 45.0, "mmHg", f"PCO2 that stores hold: {tissue}",
         "state of a course", 1.0, 300.0)
        for tissue in TISSUES
    ),
)  # fmt: skip

PARAMETERS: MappingProxyType[str, Parameter] = MappingProxyType(
    {f"{row[0]}.{row[1]}": Parameter(f"{row[0]}.{row[1]}", *row[2:], row[0]) for row in _TABLE}
)
"""All parameters of [fluid] and [solutes] of a case file, by key."""

STARTS = frozenset(
    f"{SECTION}.{name}"
    for name in (
        "extra_volume_ml", "haematocrit", "reference_haematocrit", "plasma_protein_g_dl",
        "interstitial_protein_g_dl", "interstitial_volume_ml", "filtration_ml_min_mmHg", "reflection",
        "lymph_ml_min", "pericapillary_share",
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
