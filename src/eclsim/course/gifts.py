"""What a course says of the fluid that its events give: how much of it stays, and what it does not bring."""

from __future__ import annotations

from eclsim.course.timeline import Timeline

_STAYS = {
    "crystalloid_ml": (
        "of crystalloid given beyond what was lost, with the default wall and veins, a fifth is in the "
        "plasma as half an hour of it ends and a twentieth half an hour later, in volunteers a half and a "
        "sixth (Hahn 2020)"
    ),
    "albumin_ml": (
        "of 5 % albumin given beyond what was lost a third stays, in patients after heart surgery a half "
        "(Ernest 2001)"
    ),
}
_INSTEAD = (
    "pressures and output fall back too soon; what takes the place of lost blood stays about as measured. "
    "fluid.filtration_ml_min_mmHg = 4, Csvn = 95 and the reflex heldt2010 keep crystalloid as in volunteers"
)


def said_of_gifts(timeline: Timeline) -> list[str]:
    """Sentences about the fluids that a course gives.

    Args:
        timeline: of the course.
    """
    given: dict[str, float] = {}
    for event in timeline.case.events:
        for kind, ml in event.give.items():
            given[kind] = given.get(kind, 0.0) + ml
    fluid = timeline.case.fluid
    result = []
    quick = [words for kind, words in _STAYS.items() if given.get(kind, 0.0) > 0.0]
    if quick and (fluid is None or fluid.capillary_refill):
        result.append(f"{'; '.join(quick)}: {_INSTEAD}")
    if given.get("red_cells_ml", 0.0) > 0.0 and timeline.case.solutes is not None:
        result.append(
            "red cells are given without the potassium (20 to 50 mmol/L of the fluid of stored blood) and "
            "the citrate that they bring: potassium falls by dilution where it may rise"
        )
    return result
