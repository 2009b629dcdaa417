"""What a course says of the fluid that its events give: how much of it stays, and what it does not bring."""

from __future__ import annotations

from eclsim.course.timeline import Timeline

_STAYS = {
    "crystalloid_ml": "crystalloid (a twentieth to a fifth stays, in patients about a quarter)",
    "albumin_ml": "albumin (a third stays, in patients two thirds and more)",
}


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
        result.append(
            f"of what is given too little stays in the blood after 20 minutes: {' and '.join(quick)}; "
            "pressures and output fall back too soon, and albumin is worth too much beside crystalloid"
        )
    if given.get("red_cells_ml", 0.0) > 0.0 and timeline.case.solutes is not None:
        result.append(
            "red cells are given without the potassium (20 to 50 mmol/L of the fluid of stored blood) and "
            "the citrate that they bring: potassium falls by dilution where it may rise"
        )
    return result
