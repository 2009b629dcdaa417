"""Remarks on drugs of a course that leave the body otherwise than here."""

from __future__ import annotations

from eclsim.course.timeline import Timeline
from eclsim.parameters.fluid import KIDNEY, SOLUTES_FOLLOWED
from eclsim.parameters.regulation import dose

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


def remarks_on_drugs(timeline: Timeline) -> list[str]:
    """Sentences about drugs whose effect lasts longer in the patient than in the course.

    Args:
        timeline: timeline of the course.
    """
    start = timeline.start[1]
    settings = [start, *({**start, **change.after} for change in timeline.changes)]
    key = dose("levosimendan")
    falls = any(one.after.get(key, 0.0) < one.before.get(key, 0.0) for one in timeline.changes)
    no_kidney = start.get(SOLUTES_FOLLOWED, 0.0) > 0.0 and any(
        one.get(KIDNEY, 0.0) == 0.0 and one.get(dose("milrinone"), 0.0) > 0.0 for one in settings
    )
    return [*([_LEVOSIMENDAN] if falls else []), *([_MILRINONE] if no_kidney else [])]
