"""Remarks on drugs of a course that leave the body otherwise than here."""

from __future__ import annotations

from collections.abc import Mapping

from eclsim.course.timeline import Timeline
from eclsim.drugs.published import PUBLISHED, combined_effect
from eclsim.parameters.fluid import KIDNEY, SOLUTES_FOLLOWED, VENULES
from eclsim.parameters.regulation import dose, sensitivity

NOTABLE = 0.05
"""Change of the logarithm of the resistance by drugs below which plasma hardly moves in patients either."""
_LEVOSIMENDAN = (
    "levosimendan: its effect ends here with a half-life of an hour; in patients it was largest on the day "
    "after an infusion of 24 h and declined over a week, since a metabolite with a half-life of 75 to 81 h "
    "acts as well (Kivikko 2002, Antila 2004). It is left out: what follows the end of the infusion or a "
    "smaller dose is not a patient's"
)
_MILRINONE = (
    "milrinone leaves through the kidneys, which clear nothing here (solutes.kidney_clearance_ml_min = 0). "
    "At the same rate patients on dialysis had 14 times the concentration (2 against 14 patients, Cox 2013), "
    "and on haemofiltration its half-life was about 20 h (6 patients, Taniguchi 2000), here it is 2.5 h. "
    "State the higher concentration by drugs.milrinone_sensitivity; the longer half-life is left out"
)
_PLASMA = (
    "a dose changes: arterioles alone answer to it here, so that plasma hardly moves, and with a reflex "
    "constricting drugs draw fluid from the tissues. In patients in shock plasma fell by 6.5 and 9.4 % when "
    "noradrenaline raised the mean pressure from 60 to 75 and 90 mmHg (Nygren 2010): blood volume and "
    "haematocrit after the change are not a patient's. fluid.venular_tone = 1 gives about the measured "
    "loss, but output and pressure then rise less than in patients, since the effects of the drugs were "
    "fitted with that loss in them"
)


def remarks_on_drugs(timeline: Timeline) -> list[str]:
    """Sentences about drugs whose effect lasts longer in the patient than in the course.

    Args:
        timeline: timeline of the course.
    """
    start = timeline.start[1]
    settings = [start, *({**start, **change.after} for change in timeline.changes)]
    key = dose("levosimendan")
    falls = any(one.after.get(key, 0.0) < one.before.get(key, 0.0) for one in timeline.changes)
    moved = _changes_resistance(timeline)
    no_kidney = start.get(SOLUTES_FOLLOWED, 0.0) > 0.0 and any(
        one.get(KIDNEY, 0.0) == 0.0 and one.get(dose("milrinone"), 0.0) > 0.0 for one in settings
    )
    said = ((_LEVOSIMENDAN, falls), (_MILRINONE, no_kidney), (_PLASMA, moved))
    return [text for text, applies in said if applies]


def _changes_resistance(timeline: Timeline) -> bool:
    """Whether drugs come to change the resistance notably while fluid crosses the capillary wall."""
    case, start = timeline.case, timeline.start[1]
    if start.get(VENULES, 0.0) > 0.0 or not (case.fluid is None or case.fluid.capillary_refill):
        return False
    tones = [_drug_tone({**start, **change.after}) for change in timeline.changes]
    return any(abs(tone - _drug_tone(start)) > NOTABLE for tone in tones)


def _drug_tone(values: Mapping[str, float]) -> float:
    """Logarithm of the factor by which drugs multiply the systemic resistance."""
    felt = {name: values.get(dose(name), 0.0) * values.get(sensitivity(name), 1.0) for name in PUBLISHED}
    return float(combined_effect("systemic_resistance", felt))
