"""Remarks on fluid and blood given and lost in a course, and on differences from measurements."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eclsim.circuit.network import BLOOD_VOLUME
from eclsim.course.alarms import clock_time
from eclsim.course.timeline import Timeline
from eclsim.fluid.law import INTERSTITIAL_PROTEIN, INTERSTITIUM, PLASMA, PROTEIN, REMOVED
from eclsim.parameters.fluid import ACID, KIDNEY, PERICAPILLARY
from eclsim.parameters.regulation import EXTRA_VOLUME, GAIN

_CRYSTALLOID = (
    "of crystalloid given in excess of losses, with the default capillary wall{own} and veins, a fifth is "
    "in the plasma at the end of half an hour of infusion and a twentieth half an hour later; in volunteers, "
    "a half and a sixth (Hahn 2020)"
)
_CRYSTALLOID_STAYS = (
    "of crystalloid given in excess of losses, with a capillary wall of 1 mL/min/mmHg ({own}), three "
    "quarters are in the plasma at the end of half an hour of infusion and more than two fifths half an hour "
    "later; in volunteers, a half and a sixth (Hahn 2020): pressures and output after it look better than "
    "they may be. A wall of 2 keeps about as much as in volunteers (fluid.filtration_ml_min_mmHg = 2)"
)
_CRYSTALLOID_PERICAPILLARY = (
    "of crystalloid given in excess of losses, with a pericapillary share of 0.12 "
    "(fluid.pericapillary_share) and the default wall, a quarter is in the plasma at the end of half an "
    "hour of infusion and a seventh half an hour later; in volunteers, a half and a sixth (Hahn 2020). "
    "When it replaces lost blood, more of it stays than in patients (31 %, against 18 % in surgery), so "
    "that pressures after a loss look better than they may be"
)
_ALBUMIN = (
    "of 5 % albumin given in excess of losses, two fifths are in the plasma after an hour at the default "
    "wall; in patients after heart surgery, a half (Ernest 2001), in healthy men nearly all (Haskell "
    "1998)"
)
_CONSEQUENCE = (
    "pressures and output fall back too soon; of fluid that replaces lost blood, about as much stays as in "
    "patients, but less than in volunteers. A capillary wall of 4 mL/min/mmHg "
    "(fluid.filtration_ml_min_mmHg = 4), veins of 95 mL/mmHg (Csvn = 95) and the reflex of Heldt 2010 "
    '(regulation.model = "heldt2010") keep as much crystalloid as in volunteers'
)
DEFAULT_WALL_ML_MIN_MMHG = 10.0
LARGEST_STIFF_WALL_ML_MIN_MMHG, SMALLEST_WALL_ML_MIN_MMHG = 3.0, 1.5
"""Filtration coefficients between which crystalloid remains in the plasma about as long as in volunteers
even with stiff veins and without a reflex; below the smaller one it remains longer."""
LARGEST_WALL_ML_MIN_MMHG, SMALLEST_COMPLIANCE_ML_MMHG = 4.0, 60.0
"""Largest filtration coefficient and smallest venous compliance for which, with a reflex, fluid remains in
the plasma about as long as measured."""
LOSS_SHARE = 0.05
"""Share of the blood; smaller losses give no remark."""
RETAINED_FLUIDS = ("blood_ml", "red_cells_ml", "albumin_ml")
_WALL_KEY = "fluid.filtration_ml_min_mmHg"
ULTRAFILTRATION_KEY = ".net_ultrafiltration_ml_h"
FLUID_KEYS = (".dialysate_ml_h", ".replacement_pre_ml_h", ".replacement_post_ml_h")
LONG_DIALYSIS_S = 6.0 * 3600.0
"""Duration of a course from which on acid that is left out is named."""
_WITHOUT_ACID = (
    f"bicarbonate rises too far: no acid is produced ({ACID} = 0), although no kidney excretes it "
    "(solutes.kidney_clearance_ml_min = 0). Haemodialysis patients made 1.2 mmol/h (Uribarri 1998); 2.8 "
    "is usual for 70 kg (1 mmol/kg in a day), and patients in acidosis seem to make 10 and more. Each "
    "mmol/h lowers bicarbonate by up to {each:.1f} mmol/L in the end ({litres:.1f} L/h of fluid)"
)
_HAEMORRHAGE = (
    "of blood that is lost, two thirds come back from the tissues within an hour with the default wall "
    "and no reflex, two fifths to a half with the reflex of Heldt 2010; measurements found nothing right "
    "after 500 mL (carbon monoxide, Falz 2014), four fifths within 2 h (haemoglobin of donors), and less "
    "of larger losses (Adamson 1968). If less comes back, pressure and output of these hours are lower "
    "and the haematocrit is higher than shown; a wall of 1 mL/min/mmHg (fluid.filtration_ml_min_mmHg = 1)"
    " with a reflex is the slow end of the range. Over the next day volume and protein come back as in "
    "donors only if lymphatics pump harder, as in sheep (an event that sets fluid.lymph_pump to 2)"
)
_HAEMORRHAGE_WITHOUT_REFLEX = (
    "blood is lost without a reflex: the mean arterial pressure of the published patient falls by 45 mmHg "
    "for a litre in 20 min, that of healthy men by 9 (Johnson 2013); the reflex of Heldt 2010 "
    '(regulation.model = "heldt2010") is nearest to them'
)

LARGEST_DIALYSIS_WALL_ML_MIN_MMHG, LARGEST_DIALYSIS_SHARE = 3.0, 0.2
"""Filtration coefficient and pericapillary share up to which dialysis agrees with measurements."""
_ULTRAFILTRATION = (
    "net ultrafiltration: with the default capillary wall{own} refill is too quick, blood volume falls by "
    "0.9 % in an hour where dialysis patients lost 3.2 % (1.7 L, Keane 2018; in 315 other dialyses, of 2.8 "
    "L, the concentration of plasma protein rose as it does here, HEMO study), so that pressures may fall "
    "too little and rates look tolerated that are not; with a pericapillary share of 0.12 "
    "(fluid.pericapillary_share = 0.12), or with a wall of 1.6 mL/min/mmHg "
    "(fluid.filtration_ml_min_mmHg = 1.6), it falls as measured"
)
_ULTRAFILTRATION_WITHOUT_REFLEX = (
    "fluid is removed without a reflex: with stiff veins and nothing that answers, pressure falls several "
    "times too far for the blood that is lost (in a man on V-A ECMO by 20 mmHg for 170 mL of plasma, "
    "with the reflex of Heldt 2010 by 4 for 270 mL), so that rates look harmful that are not; "
    '[regulation] baroreflex = 1 with model = "heldt2010" answers'
)
NOTABLE_ESCAPE = 0.15
"""Share of the plasma's protein at the start; less that moves into a drier interstitium, about what dry cats
lost (13.5 %, Schultze 1972), gives no remark."""
NOTABLE_LOSS_ML = 100.0
"""Plasma that is lost to the tissues after the last removal; less gives no remark."""
_OWN_BLOOD = (
    "blood_ml is blood of the patient's own composition at that moment, so that it never raises the "
    "haematocrit; donors' blood is red_cells_ml (haematocrit 0.60) with albumin_ml or crystalloid_ml"
)


def remarks_on_fluids(timeline: Timeline) -> list[str]:
    """Sentences about the fluid and blood given and lost in a course.

    Args:
        timeline: timeline of the course.
    """
    given: dict[str, float] = {}
    for event in timeline.case.events:
        for kind, ml in event.give.items():
            given[kind] = given.get(kind, 0.0) + ml
    case, values = timeline.case, timeline.start[1]
    refills = case.fluid is None or case.fluid.capillary_refill
    reflex = case.regulation is not None and bool(case.regulation.baroreflex)
    reflex |= any(change.after.get(GAIN, 0.0) > 0.0 for change in timeline.changes)
    compliant = reflex and values.get("Csvn", 0.0) >= SMALLEST_COMPLIANCE_ML_MMHG
    wall = values[_WALL_KEY]
    retaining = wall <= (LARGEST_WALL_ML_MIN_MMHG if compliant else LARGEST_STIFF_WALL_ML_MIN_MMHG)
    crystalloid, albumin = (given.get(kind, 0.0) > 0.0 for kind in ("crystalloid_ml", "albumin_ml"))
    result = list[str]()
    pericapillary = values[PERICAPILLARY] <= LARGEST_DIALYSIS_SHARE
    leaving = _CRYSTALLOID.format(own=_other_wall(wall))
    escaping = [leaving] * (crystalloid and not retaining and not pericapillary) + [_ALBUMIN] * (
        albumin and not compliant
    )
    if escaping and refills:
        result.append(f"{'; '.join(escaping)}: {_CONSEQUENCE}")
    if crystalloid and refills and not pericapillary and wall < SMALLEST_WALL_ML_MIN_MMHG:
        result.append(_CRYSTALLOID_STAYS.format(own="as here" if wall == 1.0 else f"here {wall:g}"))
    if crystalloid and refills and pericapillary:
        result.append(_CRYSTALLOID_PERICAPILLARY)
    if _loses_blood(timeline):
        result += [_HAEMORRHAGE] if refills else []
        result += [] if reflex else [_HAEMORRHAGE_WITHOUT_REFLEX]
    if refills and _removes_fluid_quickly(timeline):
        result.append(_ULTRAFILTRATION.format(own=_other_wall(wall)))
    if not reflex and _removes_fluid(timeline):
        result.append(_ULTRAFILTRATION_WITHOUT_REFLEX)
    if any(e.give.get("blood_ml", 0.0) > e.give.get("bleed_ml", 0.0) for e in case.events):
        result.append(_OWN_BLOOD)
    if given.get("red_cells_ml", 0.0) > 0.0 and case.solutes is not None:
        result.append(
            "red cells are given without the potassium (20 to 50 mmol/L of the fluid of stored blood) and "
            "the citrate that they bring: potassium falls by dilution where it may rise"
        )
    return [*result, *_without_acid(timeline)]


def remarks_on_protein(minutes: np.ndarray, states: Mapping[str, np.ndarray]) -> list[str]:
    """Sentences on protein that leaves the plasma while the interstitium dries, and on plasma lost with it.

    Args:
        minutes: times of the moments [min].
        states: slow states at the moments, by name.
    """
    if not len(minutes) or not {PROTEIN, INTERSTITIAL_PROTEIN, INTERSTITIUM} <= states.keys():
        return []
    return [*_escaped(minutes, states), *_falling_after_removal(minutes, states)]


def _escaped(minutes: np.ndarray, states: Mapping[str, np.ndarray]) -> list[str]:
    """Sentence on a large share of the plasma's protein that has left; empty if less has."""
    escaped = (states[INTERSTITIAL_PROTEIN] - states[INTERSTITIAL_PROTEIN][0]) / states[PROTEIN][0]
    over = np.flatnonzero((escaped > NOTABLE_ESCAPE) & (states[INTERSTITIUM] < states[INTERSTITIUM][0]))
    if not len(over):
        return []
    worst = 100.0 * float(escaped[over].max())
    return [
        f"from {clock_time(float(minutes[over[0]]))} more than {100.0 * NOTABLE_ESCAPE:.0f} % of the protein "
        f"of the plasma has left it ({worst:.0f} % at worst), as lymph brings less of it back from dry "
        "tissue. Cats had lost 13.5 % after two days without water (Schultze 1972); for more, and for "
        "people, no measurement was found: blood volume and pressures of these hours may be too low"
    ]


def _falling_after_removal(minutes: np.ndarray, states: Mapping[str, np.ndarray]) -> list[str]:
    """Sentence on plasma that is lost to dry tissue after the last removal of fluid; empty if little is."""
    plasma, removed = states.get(PLASMA), states.get(REMOVED)
    if plasma is None or removed is None or removed[-1] <= removed[0]:
        return []
    ended = int(np.flatnonzero(removed >= removed[-1] - 1e-6)[0])
    highest = ended + int(np.argmax(plasma[ended:]))
    lost, gone = plasma[highest] - plasma[-1], states[PROTEIN][highest] - states[PROTEIN][-1]
    if lost < NOTABLE_LOSS_ML or gone <= 0.0 or states[INTERSTITIUM][-1] >= states[INTERSTITIUM][0]:
        return []
    return [
        f"after the last removal of fluid, at {clock_time(float(minutes[ended]))}, the plasma loses another "
        f"{lost:.0f} mL to the tissues, with {gone:.0f} g of protein, and pressures fall with it: dry tissue "
        "gives little lymph, while the capillary wall goes on leaking. In 24 haemodialysis patients blood "
        "pressure fell for 2 to 3 h after the end and then stayed (ambulatory recording, abstract), but "
        "they drink; of patients who take nothing in, no measurement was found"
    ]


def _without_acid(timeline: Timeline) -> list[str]:
    """Sentence on a long dialysis without the acid that no kidney excretes; empty if it is set."""
    start = timeline.start[1]
    settings = [start, *({**start, **change.after} for change in timeline.changes)]
    balanced = any(one.get(key, 0.0) != 0.0 for one in settings for key in (ACID, KIDNEY))
    flows = [sum(v for k, v in one.items() if k.endswith(FLUID_KEYS)) for one in settings]
    if timeline.case.solutes is None or balanced or timeline.end < LONG_DIALYSIS_S or not max(flows) > 0.0:
        return []
    return [_WITHOUT_ACID.format(litres=1e-3 * max(flows), each=1e3 / max(flows))]


def _other_wall(wall: float) -> str:
    """Words on a filtration coefficient [mL/min/mmHg] that is not the default; empty for the default."""
    if wall == DEFAULT_WALL_ML_MIN_MMHG:
        return ""
    return f" of {DEFAULT_WALL_ML_MIN_MMHG:g} mL/min/mmHg (here {wall:g})"


def _loses_blood(timeline: Timeline) -> bool:
    """Whether the blood lost exceeds its simultaneous replacement by a relevant share of the blood volume."""
    gifts = (event.give for event in timeline.case.events)
    lost = sum(
        max(give.get("bleed_ml", 0.0) - sum(give.get(k, 0.0) for k in RETAINED_FLUIDS), 0.0) for give in gifts
    )
    values = timeline.start[1]
    return lost >= LOSS_SHARE * (values[BLOOD_VOLUME] + values[EXTRA_VOLUME])


def _removes_fluid(timeline: Timeline) -> bool:
    """Whether a filter removes fluid at the start or after an event."""
    rates = [timeline.start[1], *(change.after for change in timeline.changes)]
    return any(rate > 0.0 for one in rates for key, rate in one.items() if key.endswith(ULTRAFILTRATION_KEY))


def _removes_fluid_quickly(timeline: Timeline) -> bool:
    """Whether fluid is removed from a patient whose capillary wall refills quickly."""
    values = timeline.start[1]
    return (
        _removes_fluid(timeline)
        and values[_WALL_KEY] > LARGEST_DIALYSIS_WALL_ML_MIN_MMHG
        and values[PERICAPILLARY] > LARGEST_DIALYSIS_SHARE
    )
