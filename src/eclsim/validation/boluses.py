"""What is given as a bolus against what stays of it in people: a course with the published wall."""

from __future__ import annotations

from collections.abc import Iterator

from eclsim.cases.reading import read_mapping
from eclsim.course.course import course
from eclsim.fluid.law import PLASMA
from eclsim.paper.comparison import Check, Row, within
from eclsim.validation.reference_cases import compared

SAFE = (
    "SAFE 2004 (N Engl J Med 350:2247), 6997 patients, 4 % albumin; the ratio of the volumes given in four "
    "days is not verified"
)
TEXTBOOK = "textbook: plasma is a fifth to a quarter of the water outside of cells"
GIVEN_ML, OVER_MIN, AFTER_MIN = 1000.0, 30.0, 240.0


def boluses_check() -> Check:
    """A litre of crystalloid and of albumin, four hours later."""
    return compared("boluses", bolus_rows())


def bolus_rows() -> Iterator[Row]:
    """Shares that stay in the plasma, and the ratio of both fluids."""
    stays = {kind: _stays(kind) for kind in ("crystalloid_ml", "albumin_ml")}
    share = 100.0 * stays["crystalloid_ml"] / GIVEN_ML
    yield within("crystalloid in the plasma after 4 h (test)", 22.5, share, 5.0, "%", source=TEXTBOOK)
    ratio = stays["albumin_ml"] / stays["crystalloid_ml"]
    yield within("crystalloid for the effect of albumin (test)", 1.4, ratio, 0.4, "mL/mL", source=SAFE)


def _stays(kind: str) -> float:
    """Plasma gained [mL] after a bolus, in the published patient with the wall as it is."""
    event = {"at_min": 10.0, "give": {kind: GIVEN_ML}, "over_min": OVER_MIN}
    body = {"sex": "male", "age_years": 60, "height_cm": 178, "weight_kg": 80}
    raw = {"format": 1, "patient": {"id": "bolus", **body, "heart_rate_bpm": 90}, "fluid": {}}
    case = read_mapping(raw | {"events": [event]}).case
    end = event["at_min"] + OVER_MIN + AFTER_MIN
    plasma = course(case, minutes=end, every_min=20.0, outputs=["MAP"])[PLASMA]
    return float(plasma[-1] - plasma[0])
