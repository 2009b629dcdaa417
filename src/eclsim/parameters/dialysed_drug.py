"""Parameters of a drug that blood carries and dialysis removes, such as an antibiotic: doses and kinetics.

No drug has usual values here: the kinetics of critically ill patients differ by several times, so a case
gives those of its drug and patient.
"""

from __future__ import annotations

from eclsim.parameters.parameter import read_parameters

SECTION = "dialysed_drug"
SIEVING, AREA_PRODUCT = f"{SECTION}.sieving", f"{SECTION}.koa_ml_min"
DOSE, EVERY, OVER = f"{SECTION}.dose_mg", f"{SECTION}.every_h", f"{SECTION}.over_min"
INFUSION, START, UNBOUND_SHARE = (
    f"{SECTION}.infusion_mg_h", f"{SECTION}.start_mg_l", f"{SECTION}.unbound_fraction",
)  # fmt: skip
CENTRAL, PERIPHERAL = f"{SECTION}.central_volume_l", f"{SECTION}.peripheral_volume_l"
TRANSFER, BODY = f"{SECTION}.transfer_ml_min", f"{SECTION}.body_clearance_ml_min"
FOLLOWED = f"{SECTION}.followed"
PARAMETERS = read_parameters(__file__)
"""All parameters of [dialysed_drug] of a case file, by key."""

STARTS = frozenset({START, CENTRAL, PERIPHERAL, EVERY})
"""Keys that hold for a whole course."""
