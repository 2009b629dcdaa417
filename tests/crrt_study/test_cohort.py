import json
from dataclasses import replace

import numpy as np
import pytest

from eclsim.cases import read_case
from eclsim.cases.fit_mark import with_mark
from eclsim.cases.fluid import Fluid
from eclsim.cases.reading import case_text
from eclsim.crrt_study.cohort import CohortStudy, StudyOptions, conclusion, crrt_cohort, summaries
from eclsim.crrt_study.cohort_report import _doubts, cohort_json, impossible_points, show
from eclsim.crrt_study.ranking import Ranked
from eclsim.crrt_study.schemes import StudyError
from eclsim.identification.cohort import cases_as_given, with_fitted_parameters
from eclsim.paper.crrt import paper_case


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
    single = case("roller").model_copy(update={"ecmo": None})
    return crrt_cohort(
        cases_as_given([*cases, single], "tests"),
        StudyOptions(schemes="a,d,h", speeds="2000:5000:1000", volume_policy="as_published"),
    )


@pytest.mark.slow
def test_a_case_that_cannot_be_studied_is_named_and_the_others_are_studied(cohort):
    assert [point.name for point in cohort.points] == ["slow", "fast", "faster"]
    assert "[ecmo]" in cohort.lost["roller"]
    unreachable = case("flow", speed_rpm=None, flow_l_min=9.5)
    with pytest.raises(StudyError, match=r"can be studied: flow: ecmo\.flow_l_min = 9\.5 cannot be"):
        crrt_cohort(cases_as_given([unreachable], "tests"))
    with pytest.raises(StudyError, match="no data point can be studied"):
        crrt_cohort(cases_as_given([case("x").model_copy(update={"ecmo": None})], "tests"))


def test_poor_fits_among_case_files_are_left_out_and_named(tmp_path, capsys):
    """A folder of fitted cases was studied, poor fits and all."""
    files = [tmp_path / f"{name}.toml" for name in ("doubtful", "poor")]
    for file in files:
        file.write_text(with_mark(case_text(case(file.stem)), file.stem, "as it says"))
    fitted = cases_as_given([read_case(file) for file in files], "case files")
    assert list(fitted.cases) == ["doubtful"]
    assert "POOR fit" in fitted.not_fitted["poor"]
    study = crrt_cohort(fitted, StudyOptions(schemes="d", speeds="3425", volume_policy="as_published"))
    assert [point.name for point in study.points] == ["doubtful"]
    assert "studies leave such a fit out" in study.lost["poor"]
    assert list(study.doubts) == ["doubtful"]
    (row,) = json.loads(cohort_json(study))["points"]
    assert "a DOUBTFUL fit" in row["doubts"]
    assert any("doubtful: its parameters are a DOUBTFUL fit" in line for line in _doubts(study))
    show(study)
    shown = " ".join(capsys.readouterr().out.split())
    assert "Yes: scheme d is first in all 1 data points." in shown
    assert "1 of 1 data points (doubtful): its parameters are a DOUBTFUL fit" in shown


def test_case_files_of_one_id_are_told_apart(tmp_path):
    """Two days of one patient in a folder: only the last was studied, and nothing said so."""
    files = [tmp_path / "monday.toml", tmp_path / "tuesday.toml"]
    for file in files:
        file.write_text(case_text(case("P01")))
    lost = [(case("P01"), "not reached")]
    fitted = cases_as_given([*map(read_case, files), case("P02")], "case files", lost)
    assert list(fitted.cases) == ["P01 (monday.toml)", "P01 (tuesday.toml)", "P02"]
    assert fitted.not_fitted == {"P01 (4)": "not reached"}
    assert fitted.groups == (("P01 (monday.toml)",), ("P01 (tuesday.toml)",), ("P02",))


@pytest.mark.slow
def test_every_point_is_ranked_at_its_own_speed(cohort):
    slow, fast, faster = cohort.points
    assert (slow.speed, fast.speed) == (3425.0, 4600.0)
    assert slow.flow < fast.flow < faster.flow
    assert slow.first("as_published") == "d"
    assert fast.first("as_published") == "h"
    assert slow.variation["as_published"] > 1.0
    assert slow.taken_up > 50.0


@pytest.mark.slow
def test_the_answer_says_who_wins_where_and_why_not_everywhere(cohort):
    assert cohort.winners("as_published") == {"h": 2, "d": 1, "a": 0}
    message = conclusion(cohort, "as_published")
    assert message.startswith("No: scheme h is first in 2 of 3 data points, d in 1.")
    assert "Elsewhere h ranks lower for other reasons in 1" in message
    single = replace(cohort, points=cohort.points[:1])
    assert conclusion(single, "as_published") == "Yes: scheme d is first in all 1 data points."


@pytest.mark.slow
def test_a_broken_alarm_is_named_as_the_reason(cohort):
    def ranked(letter: str, rank: int, kept: bool) -> Ranked:
        return Ranked(letter, rank, kept, kept, 10.0, 4.0, False, 0.0, 1.0, (), 4.0, (rank, rank))

    one, two = (ranked("d", 1, True), ranked("h", 2, True)), (ranked("h", 1, True), ranked("d", 2, False))
    points = [replace(cohort.points[0], ranking={"as_published": r}) for r in (one, one, two)]
    schemes = tuple(s for s in cohort.schemes if s.letter in "dh")
    message = conclusion(replace(cohort, points=tuple(points), schemes=schemes), "as_published")
    assert message.endswith("h in 1. Elsewhere d breaks an alarm in 1, and is placed 2 at worst.")


@pytest.mark.slow
def test_schemes_that_share_the_first_place_are_said_to(cohort):
    def ranked(letter: str, rank: int) -> Ranked:
        return Ranked(letter, rank, True, True, 10.0, 4.0, False, 0.0, 1.0, (), 4.0, (rank, rank))

    shared, ahead = (ranked("d", 1), ranked("h", 1)), (ranked("h", 1), ranked("d", 2))
    points = tuple(replace(cohort.points[0], ranking={"as_published": r}) for r in (ahead, ahead, shared))
    schemes = tuple(s for s in cohort.schemes if s.letter in "dh")
    message = conclusion(replace(cohort, points=points, schemes=schemes), "as_published")
    assert message.startswith("No: scheme h is first in 2 of 3 data points, d in 1.")
    assert "In 1 of 3 several share the first place" in message
    assert message.endswith("Elsewhere h shares the first place.")


@pytest.mark.slow
def test_summaries_count_over_the_points(cohort):
    result = {one.letter: one for one in summaries(cohort, "as_published")}
    assert result["h"].first == 2
    assert result["d"].alarms_kept < 3
    assert result["h"].above_atmosphere == 0
    assert result["a"].above_atmosphere == 3
    assert result["a"].smallest_flow <= result["a"].median_flow


@pytest.mark.slow
def test_a_flow_that_the_largest_speed_ends_is_at_least_that(cohort):
    """The median of 4.0, 5.2 and 5.2, kept to the end in two points, was shown as if a limit broke at 5.2."""

    def point(flow: float, throughout: bool):
        one = Ranked("h", 1, True, True, 10.0, flow, throughout, 0.0, 1.0, (), flow, (1, 1))
        return replace(cohort.points[0], ranking={"as_published": (one,)})

    schemes = tuple(s for s in cohort.schemes if s.letter == "h")
    for points, expected in (
        ((point(4.0, False), point(5.2, True), point(5.2, True)), (False, True)),
        ((point(4.0, False), point(4.5, False), point(5.2, True)), (False, False)),
        ((point(4.0, False), point(5.2, True)), (False, True)),
        ((point(5.2, True),), (True, True)),
    ):
        (one,) = summaries(replace(cohort, points=points, schemes=schemes), "as_published")
        assert (one.smallest_flow_may_be_larger, one.median_flow_may_be_larger) == expected


@pytest.mark.slow
def test_a_point_whose_first_scheme_is_not_known_counts_for_none(cohort):
    """Of the last point the beat of d is missing: it may be first, or not."""
    last = cohort.points[-1]
    unknown = dict.fromkeys(("rank", "places", "alarms_kept", "access_190_kept"))
    unknown |= {"largest_flow": np.nan, "flow_at_most": np.inf, "lowest_site_pressure": np.nan}
    missing = [replace(last.ranked("as_published", "d"), **unknown)]
    known = [one for one in last.ranking["as_published"] if one.letter != "d"]
    point = replace(
        last, ranking={"as_published": (*known, *missing)}, variation={"as_published": np.nan},
        unsettled=("as_published, scheme d: no steady beat at 4900 rpm",), beats_not_found=1,
    )  # fmt: skip
    gone = replace(cohort, points=(*cohort.points[:-1], point))
    assert gone.winners("as_published") == {"d": 1, "h": 1, "a": 0}
    assert gone.undecided("as_published") == ("faster",)
    message = conclusion(gone, "as_published")
    assert "In 1 of 3 it is not known which scheme is first." in message
    one = {one.letter: one for one in summaries(gone, "as_published")}["d"]
    assert (one.ranked, one.known, one.flow_known) == (2, 2, 2)
    assert one.smallest_flow > 0.0
    single = replace(gone, points=(gone.points[0], point))
    assert conclusion(single, "as_published").startswith(
        "Not known: scheme d is first in 1 of 2 data points."
    )
    nothing = replace(gone, points=(point,))
    assert conclusion(nothing, "as_published").startswith("Not known: in none")
    assert {one.letter: one for one in summaries(nothing, "as_published")}["d"].worst_rank is None


def test_fitted_parameters_win_over_those_of_the_case():
    result = {
        "parameters": {"Rmc": {"value": 0.4}, "Emaxlv": {"value": 2.0}}, "verdict": {"level": "doubtful"},
    }  # fmt: skip
    changed = with_fitted_parameters(paper_case(), result)
    assert "a DOUBTFUL fit" in changed.doubts[0]
    assert changed.parameters["Rmc"] == 0.4
    assert changed.parameters["Csart"] == paper_case().parameters["Csart"]


@pytest.mark.slow
def test_a_point_that_no_patient_can_be_is_named(tmp_path):
    """A right heart pumped empty, with an ejection fraction of -150 %, was ranked without a word."""
    small = paper_case().patient.model_copy(update={"id": "dry", "height_cm": 150.0, "weight_kg": 40.0})
    fluid = Fluid(extra_volume_ml=-600.0)
    dry = case("dry", speed_rpm=4600.0).model_copy(update={"patient": small, "fluid": fluid})
    options = StudyOptions(schemes="d", speeds="4600", volume_policy="as_published")
    study = crrt_cohort(cases_as_given([case("wet"), dry], "tests"), options)
    wet, point = study.points
    assert wet.impossible == ()
    assert point.impossible
    assert all(one.startswith("impossible: ") for one in point.impossible)
    (line,) = impossible_points(study)
    assert line.startswith("dry: no patient can have its beats, so its schemes have no order: impossible: ")
    assert line in _doubts(study)
    rows = json.loads(cohort_json(study))["points"]
    assert [bool(row["impossible"]) for row in rows] == [False, True]
    assert [row["first_as_published"] for row in rows] == ["d", None]
    assert [row["order_as_published"] for row in rows] == ["d", ""]
    assert study.winners("as_published") == {"d": 1}


@pytest.mark.slow
def test_page_tables_and_json_of_a_cohort(cohort, tmp_path):
    import csv

    from eclsim.crrt_study.cohort import FILES
    from eclsim.crrt_study.cohort_report import write_cohort

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
    missing = replace(cohort.points[0], name="gone", unsettled=("scheme d: no steady beat",), flow=np.nan,
                      variation={"as_published": np.nan})  # fmt: skip
    write_cohort(replace(cohort, points=(missing, *cohort.points[1:])), tmp_path / "gone")
    page = (tmp_path / "gone" / "report.html").read_text(encoding="utf-8")
    assert "gone: scheme d: no steady beat" in page
    assert "known for 2 data points" in page
    result = json.loads(cohort_json(cohort))
    assert result["policies"]["as_published"]["schemes"][0]["letter"] == "h"
    assert result["points"][0]["relative_misfit"] is None


@pytest.mark.slow
def test_the_terminal_table_keeps_a_row_for_each_scheme_at_120_columns(cohort, capsys, monkeypatch):
    from eclsim.crrt_study import cohort_report as report
    from eclsim.reporting import numbers

    monkeypatch.setattr(numbers, "WIDTH_WITHOUT_TERMINAL", 120)
    report.show(cohort)
    lines = capsys.readouterr().out.splitlines()
    first = lines.index("") if lines[0] == "" else 0
    _, head, units, *rows = lines[first : first + 3 + len(cohort.points[0].ranking["as_published"])]
    assert "scheme" in head + units
    assert sorted(row.split()[0] for row in rows) == ["a", "d", "h"]
    assert lines[first + 6].startswith("No: scheme h")
