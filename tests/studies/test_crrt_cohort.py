from dataclasses import replace

import pytest

from eclsim.studies.cohort_cases import as_they_are, with_fitted
from eclsim.studies.crrt_cohort import CohortStudy, answer, crrt_cohort, summaries
from eclsim.studies.crrt_ranking import Ranked
from eclsim.studies.crrt_settings import StudyError
from eclsim.studies.paper_patient import paper_case


def case(name: str, **changes):
    made = paper_case()
    return made.model_copy(
        update={
            "patient": made.patient.model_copy(update={"id": name}),
            "ecmo": made.ecmo.model_copy(update=changes),
        }
    )


@pytest.fixture(scope="module")
def cohort() -> CohortStudy:
    """The paper's patient at three speeds, two of them so fast that d breaks limits; one roller pump."""
    cases = [case("slow"), case("fast", speed_rpm=4600.0), case("faster", speed_rpm=4900.0)]
    alone = case("roller").model_copy(update={"ecmo": None})
    return crrt_cohort(
        as_they_are([*cases, alone], "tests"),
        schemes="a,d,h",
        speeds="2000:5000:1000",
        volume_policy="as_published",
    )


def test_a_case_that_cannot_be_studied_is_named_and_the_others_are_studied(cohort):
    assert [point.name for point in cohort.points] == ["slow", "fast", "faster"]
    assert "[ecmo]" in cohort.lost["roller"]
    with pytest.raises(StudyError, match="no data point can be studied"):
        crrt_cohort(as_they_are([case("x").model_copy(update={"ecmo": None})], "tests"))


def test_every_point_is_ranked_at_its_own_speed(cohort):
    slow, fast, faster = cohort.points
    assert (slow.speed, fast.speed) == (3425.0, 4600.0)
    assert slow.flow < fast.flow < faster.flow
    assert slow.rank_of("as_published", "d") == 1
    assert fast.rank_of("as_published", "h") == 1
    assert slow.variation["as_published"] > 1.0
    assert slow.taken_up > 50.0


def test_the_answer_says_who_wins_where_and_why_not_everywhere(cohort):
    assert cohort.winners("as_published") == {"h": 2, "d": 1, "a": 0}
    said = answer(cohort, "as_published")
    assert said.startswith("No: scheme h is first in 2 of 3 data points, d in 1.")
    assert "Elsewhere h stands behind for other reasons in 1" in said
    alone = replace(cohort, points=cohort.points[:1])
    assert answer(alone, "as_published") == "Yes: scheme d is first in all 1 data points."


def test_a_broken_alarm_is_named_as_the_reason(cohort):
    def ranked(letter: str, rank: int, kept: bool) -> Ranked:
        return Ranked(letter, rank, kept, kept, 10.0, 4.0, False, 0.0, 1.0, ())

    one, two = (ranked("d", 1, True), ranked("h", 2, True)), (ranked("h", 1, True), ranked("d", 2, False))
    points = [replace(cohort.points[0], ranking={"as_published": r}) for r in (one, one, two)]
    schemes = tuple(s for s in cohort.schemes if s.letter in "dh")
    said = answer(replace(cohort, points=tuple(points), schemes=schemes), "as_published")
    assert said.endswith("h in 1. Elsewhere d breaks an alarm in 1, and is placed 2 at worst.")


def test_summaries_count_over_the_points(cohort):
    found = {one.letter: one for one in summaries(cohort, "as_published")}
    assert found["h"].first == 2
    assert found["d"].alarms_kept < 3
    assert found["h"].above_atmosphere == 0
    assert found["a"].above_atmosphere == 3
    assert found["a"].smallest_flow <= found["a"].median_flow


def test_fitted_parameters_win_over_those_of_the_case():
    result = {"parameters": {"Rmc": {"value": 0.4}, "Emaxlv": {"value": 2.0}}}
    changed = with_fitted(paper_case(), result)
    assert changed.parameters["Rmc"] == 0.4
    assert changed.parameters["Csart"] == paper_case().parameters["Csart"]


def test_page_tables_and_json_of_a_cohort(cohort, tmp_path):
    import csv
    import json

    from eclsim.report.crrt_cohort import cohort_json, write_cohort
    from eclsim.report.crrt_cohort_names import FILES

    hostile = replace(cohort, points=(replace(cohort.points[0], name="<b>=1+1</b>"), *cohort.points[1:]))
    written = write_cohort(hostile, tmp_path / "out")
    assert [path.name for path in written] == list(FILES)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "<b>" not in page
    assert "Does one scheme win for all? No: scheme h" in page
    assert "roller" in page
    with (tmp_path / "out" / "points.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert rows[1]["first_as_published"] == "h"
    found = json.loads(cohort_json(cohort))
    assert found["policies"]["as_published"]["schemes"][0]["letter"] == "h"
    assert found["points"][0]["relative_misfit"] is None
