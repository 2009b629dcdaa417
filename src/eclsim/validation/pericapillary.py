"""Fluid exchange through a pericapillary layer next to the capillary wall.

The share of the layer was fitted to two dialyses with the published wall; everything else is a test. Spreads
are those of the rows without the layer, in `fluid`, `boluses` and `refill`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from eclsim.paper.comparison import Check, Row, within
from eclsim.parameters.fluid import PERICAPILLARY, SECTION
from eclsim.validation import boluses, fluid, refill
from eclsim.validation.boluses import Given, Sections
from eclsim.validation.fluid import Patient
from eclsim.validation.reference_cases import compared

NEAR_SHARE = 0.12
SECTIONS: Sections = ((SECTION, ((PERICAPILLARY.split(".")[1], NEAR_SHARE),)),)
THINNED = (
    "fluid that leaves dilutes the protein next to the capillaries, which then draws less; with a share of 1 "
    "the row holds"
)


def pericapillary_check() -> Check:
    """Compare dialyses, standing men, lost blood and infused fluid."""
    return compared("pericapillary", (*_dialyses(), *_standing(), *_lost(), *_given()))


def _dialyses() -> Iterator[Row]:
    """Rows for the fall of blood volume, and the forces of refill."""
    patient = fluid.dialysed(fluid.PUBLISHED, NEAR_SHARE)
    hour = fluid.fall_of_blood(patient, 1700.0) / fluid.SESSION_H
    yield within("fall of blood volume, 1.7 L filtered (fit)", 3.2, hour, 1.6, "%/h", source=fluid.KEANE)
    for litres, expected, spread, words in ((1.5, 4.9, 1.3, "fit"), (2.7, 2.4, 0.8, "test")):
        fall = fluid.fall_of_blood(patient, 1000.0 * litres) / litres
        yield within(f"the same for each L, {litres:g} L filtered ({words})", expected, fall, spread, "%/L",
                     source=fluid.DASSELAAR)  # fmt: skip
    yield from fluid.force_rows(fluid.driven(patient, 1700.0))


def _standing() -> Iterator[Row]:
    """Rows for plasma lost on standing up, and regained on lying down."""
    man = fluid.healthy(fluid.STANDING_REFLEX)
    whole, _, _ = fluid.stood(Patient(man))
    lost, tau, back = fluid.stood(Patient(replace(man, values={**man.values, PERICAPILLARY: NEAR_SHARE})))
    for (minute, expected, spread), got, one in zip(fluid.PLASMA_LOST, lost, whole, strict=True):
        label = f"plasma lost on standing, {minute} min"
        row = within(f"{label} (test)", expected, float(got), spread, "%", source=fluid.LUNDVALL)
        yield row.explained_by(THINNED, float(one), f"{label}, experiment")
    yield within("time constant of that loss (test)", 4.6, float(tau), 0.8, "min", source=fluid.HELDT)
    yield Row("half of it back after lying down, 15 min stood (test)", back, 0.0, 6.0, "min", 6.0,
              source=fluid.LYING_DOWN)  # fmt: skip


def _lost() -> Iterator[Row]:
    """Rows for lost blood and its replacement by fluid."""
    yield within("400 mL bled in 10 min: refilled as it ends (test)", 188.0,
                 refill.refilled(400.0, 0.0, SECTIONS), 80.0, "mL", source=refill.SAITO)  # fmt: skip
    yield refill.saline_row(SECTIONS)
    stays = 0.05 * (500.0 + boluses.gained(refill.LOSS_AND_INFUSION, SECTIONS)[1])
    yield within("500 mL bled and 2 L of crystalloid: share that stays (test)", refill.INFUSION_STAYS, stays,
                 10.0, "%", source=refill.TWO_LITRES)  # fmt: skip
    yield within("1.1 L bled and Ringer's lactate: blood volume (test)", -459.0,
                 boluses.gained(boluses.LACTATE, SECTIONS)[1], 185.0, "mL", source=boluses.JACOB)  # fmt: skip
    yield boluses.surgery_row(SECTIONS)


def _given() -> Iterator[Row]:
    """Rows for crystalloid given to people who lost nothing."""
    for after, expected, spread, words in ((0.0, 55.0, 5.0, "as it ends"), (30.0, 17.5, 2.5, "30 min later")):
        stays = boluses.share(boluses.VOLUNTEER._replace(after_min=after), SECTIONS)
        yield within(f"a litre of Ringer's in 30 min, {words} (test)", expected, stays, spread, "%",
                     source=boluses.HAHN)  # fmt: skip
    saline = Given(boluses.HEART, boluses.USUAL, (("crystalloid_ml", 1000.0),))
    yield boluses.saline_row(saline, SECTIONS)
