"""Parameters of a drug that blood carries and dialysis removes, such as an antibiotic: doses and kinetics.

No drug has usual values here: the kinetics of critically ill patients differ by several times, so a case
gives those of its drug and patient.
"""

from __future__ import annotations

from types import MappingProxyType

from eclsim.parameters.parameter import Parameter

SECTION = "dialysed_drug"
SIEVING, AREA_PRODUCT = f"{SECTION}.sieving", f"{SECTION}.koa_ml_min"
DOSE, EVERY, OVER = f"{SECTION}.dose_mg", f"{SECTION}.every_h", f"{SECTION}.over_min"
INFUSION, START, UNBOUND_SHARE = (
    f"{SECTION}.infusion_mg_h", f"{SECTION}.start_mg_l", f"{SECTION}.unbound_fraction",
)  # fmt: skip
CENTRAL, PERIPHERAL = f"{SECTION}.central_volume_l", f"{SECTION}.peripheral_volume_l"
TRANSFER, BODY, TARGET = (
    f"{SECTION}.transfer_ml_min", f"{SECTION}.body_clearance_ml_min", f"{SECTION}.target_mg_l",
)  # fmt: skip
FOLLOWED = f"{SECTION}.followed"
_OF_DRUG = "of the drug and the patient"

# key, value, unit, description, source, minimum, maximum
_TABLE = (
    (DOSE, 0.0, "mg", "Dose that is given again and again, the first at the start of a course", "setting",
     0.0, 20_000.0),
    (EVERY, 8.0, "h", "Time from one dose to the next", "setting", 0.25, 168.0),
    (OVER, 30.0, "min", "Time over which each dose is given", "setting", 1.0, 1440.0),
    (INFUSION, 0.0, "mg/h", "Continuous infusion", "setting", 0.0, 2000.0),
    (START, 0.0, "mg/L", "Concentration in the plasma at the start, bound and unbound", _OF_DRUG, 0.0,
     5000.0),
    (UNBOUND_SHARE, 1.0, "1", "Share of the drug in the plasma that is not bound to protein", _OF_DRUG, 0.001,
     1.0),
    (SIEVING, 1.0, "1", "Sieving coefficient: concentration in the filtrate over that in the plasma",
     "of the drug; left out, the unbound share", 0.001, 1.0),
    (AREA_PRODUCT, 200.0, "mL/min", "Mass transfer area product of the dialyzer for the drug",
     "assumed, between those of creatinine and citrate; large molecules have less: 43 for vancomycin, fitted "
     "to DelDot 2004 (10.1111/j.1365-2125.2004.02143.x)", 5.0, 3000.0),
    (CENTRAL, 15.0, "L", "Central volume of distribution, with the plasma", f"{_OF_DRUG}; default assumed",
     1.0, 2000.0),
    (PERIPHERAL, 0.0, "L", "Peripheral volume of distribution; 0: there is one compartment", _OF_DRUG, 0.0,
     5000.0),
    (TRANSFER, 100.0, "mL/min", "Clearance between the central and the peripheral volume", _OF_DRUG, 0.0,
     10_000.0),
    (BODY, 50.0, "mL/min", "Clearance by kidneys, liver and all else but dialysis",
     f"{_OF_DRUG}; default assumed", 0.0, 3000.0),
    (TARGET, 0.0, "mg/L", "Unbound concentration to be exceeded, such as a minimum inhibitory one; 0: none",
     "setting", 0.0, 1000.0),
    (FOLLOWED, 0.0, "1", "Whether a drug is followed in courses: 1 with [dialysed_drug], else 0", "setting",
     0.0, 1.0),
)  # fmt: skip

PARAMETERS: MappingProxyType[str, Parameter] = MappingProxyType(
    {row[0]: Parameter(*row, SECTION) for row in _TABLE}
)
"""All parameters of [dialysed_drug] of a case file, by key."""

STARTS = frozenset({START, CENTRAL, PERIPHERAL, EVERY})
"""Keys that hold for a whole course."""
