"""The page of followed patients, from made-up results."""

import pytest

from eclsim.identification.track_figures import TimeAxis
from eclsim.identification.track_report import series_text, track_page

RANGE = {"lower": 70.0, "median": 80.0, "upper": 90.0}
HELD = {"measured": 82.0, "deviation": 0.4, "unusual": False, "used": True, "met": True}


def point(name, **more):
    return {
        "id": name, "hours_since_last": 12.0, "probability": 0.4, "message": "", "failed": False,
        "unusual": False,
        "measurements": {"MAP": HELD}, "expected": {"MAP": RANGE}, "outputs": {"MAP": RANGE},
        "parameters": {"Rmc": {"lower": 0.5, "median": 0.8, "upper": 1.1}}, **more,
    }  # fmt: skip


def misfit(**marks):
    return {"MAP": HELD, "CO": {"measured": 9.0, "deviation": 3.4, "unusual": False, "used": True, **marks}}


def content(*points, patient="P01", assumed=None):
    settings = {"drifts": [0.05, 0.12, 0.3]}
    series = {"id": patient, "assumed_interval_hours": assumed, "points": list(points)}
    return {"series": [series], "refused": [], "settings": settings}


FIRST = point("1", probability=None, hours_since_last=None, expected={})


@pytest.mark.parametrize(
    ("last", "message"),
    [
        (point("2"), "2 fits the patient so far (probability 0.4)"),
        (point("2", message="CO does not fit", unusual=True), "2 does not fit the patient so far"),
        (point("2", message="CO is far from the forecast", measurements=misfit(unusual=True)),
         "2 fits the patient so far as a whole, but not in CO"),
        (point("2", message="CO: 9 was used", measurements=misfit(met=False)),
         "2 fits the patient so far as a whole, but not in CO"),
        (point("2", message="all 7 measurements are the same as in 1: if copied forward"),
         "2 fits the patient so far (probability"),
        (point("2", message="CO is held", doubts=["CO is held"]), "2 fits the patient so far (probability"),
        (point("2", failed=True, probability=None, message="no steady heartbeat", outputs={}, expected={}),
         "2 could not be used"),
    ],
)  # fmt: skip
def test_the_box_says_whether_the_last_measurement_fits(last, message):
    page = track_page(content(FIRST, last), {})
    assert message in page
    assert last["message"] in page
    assert ('class="box warn"' in page) == bool(last["message"])


def test_page_and_terminal_show_a_probability_with_the_same_digits():
    series = content(FIRST, point("2", probability=5.9081e-07))
    assert ">5.91e−07<" in track_page(series, {})
    assert "5.91e-07" in series_text(series["series"][0])


def test_the_terminal_shows_the_outputs_beside_what_was_measured():
    """It had warnings on them alone."""
    now = point("2", doubtful=["MAP"], warnings=["mean arterial pressure 80 mmHg"])
    lines = [" ".join(line.split()) for line in series_text(content(FIRST, now)["series"][0]).splitlines()]
    assert "after 2 measured estimate 5 % 95 % unit" in lines
    assert "MAP 82 80 70 90 mmHg doubtful" in lines


def test_an_output_that_is_not_met_is_marked_in_the_table():
    page = track_page(content(FIRST, point("2", measurements=misfit(met=False), doubtful=["MAP"])), {})
    assert "<td>not met</td>" in page.replace(' class="text"', "")
    assert "doubtful: see above" in page


def test_doubts_of_the_first_estimate_stay_in_sight():
    doubted = point("1", probability=None, message="the first estimate is itself uncertain")
    page = track_page(content(doubted, point("2")), {})
    assert "1: the first estimate is itself uncertain" in page
    assert 'class="box warn"' in page


def test_what_is_assumed_at_all_times_is_listed():
    followed = content(FIRST)
    followed["series"][0]["notes"] = ["the blood volume is held"]
    assert "<li>P01: the blood volume is held.</li>" in track_page(followed, {})


def test_ids_are_text():
    page = track_page(content(FIRST, patient="<script>alert(1)</script>"), {})
    assert "<script>" not in page


def test_figures_stand_inside():
    page = track_page(content(FIRST), {("P01", "outputs"): '<svg id="a"><use href="#a"/></svg>'})
    assert 'id="p0-outputs-a"' in page


def test_a_known_course_is_drawn_over_time():
    hourly = TimeAxis.of(content(FIRST, point("2"), point("3"))["series"][0])
    assert hourly.at.tolist() == [0.0, 12.0, 24.0]
    assert hourly.label == "hours since the first measurement"
    days = TimeAxis.of(content(FIRST, point("2", hours_since_last=96.0))["series"][0])
    assert days.at.tolist() == [0.0, 4.0]
    counted = TimeAxis.of(content(FIRST, point("2"), assumed=24.0)["series"][0])
    assert counted.names == ("1", "2")
    named = TimeAxis.of(content(point("monday morning"), point("monday evening"), assumed=24.0)["series"][0])
    assert named.names == ()
    assert named.at.tolist() == [1.0, 2.0]
    assert named.label == "number of the measurement"
