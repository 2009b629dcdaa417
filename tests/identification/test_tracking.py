"""Following a patient whose parameters drift in a known way."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from eclsim.cases import write_case
from eclsim.cases.case import Case, Measurements, Patient
from eclsim.devices.ecmo import Ecmo
from eclsim.identification import tracking as track_module
from eclsim.identification.filtering import GaussianMixture, InnovationTest
from eclsim.identification.series import elapsed_hours, notes_on_bounds, notes_on_time
from eclsim.identification.settings import FitSettings
from eclsim.identification.tracking import Tracker, TrackSettings, track
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate
from eclsim.outputs.uncertainty import measurement_errors

NAMES = ("Rmc", "Emaxlv")
MEASURED = ("SP", "DP", "MAP", "CO")
SETTINGS = TrackSettings(FitSettings(NAMES))
POINTS = 7


def measured_at(resistance, elastance, random, noise=1.0, rate=80):
    """A case with measurements of a patient whose parameters are known."""
    patient = Patient(id="T", sex="female", age_years=60, heart_rate_bpm=rate)
    beat = simulate(model_of(Case(patient=patient, parameters={"Rmc": resistance, "Emaxlv": elastance})))
    outputs = {n: float(beat[n]) for n in MEASURED}
    errors = measurement_errors(outputs)
    values = {n: v + noise * errors[n] * random.standard_normal() for n, v in outputs.items()}
    return Case(patient=patient, measurements=Measurements(**values)), outputs


@pytest.fixture(scope="module")
def truth():
    """The resistance falls steadily by a third; the elastance stays."""
    return np.stack([np.geomspace(1.0, 0.66, POINTS), np.full(POINTS, 1.4)], axis=1)


@pytest.fixture(scope="module")
def series(truth):
    random = np.random.default_rng(4)
    return [measured_at(*row, random, rate=80 + 3 * k) for k, row in enumerate(truth)]


@pytest.fixture(scope="module")
def trackers(series):
    """What is known after each of the first measurements."""
    tracker, known = Tracker(SETTINGS), []
    for k, (case, _) in enumerate(series[:5]):
        tracker.update(str(k), case)
        known.append(copy.deepcopy(tracker))
    return known


@pytest.fixture
def after(trackers):
    """A tracker after so many measurements, the test's own."""
    return lambda count: copy.deepcopy(trackers[count - 1])


@pytest.fixture(scope="module")
def followed(series):
    """The result, and what was said meanwhile."""
    said = []
    points = [(str(k), case) for k, (case, _) in enumerate(series)]
    return track(points, settings=SETTINGS, progress=said.append), said


@pytest.fixture(scope="module")
def tracked(followed):
    return followed[0].points


@pytest.mark.slow
def test_follows_the_drift(tracked, truth):
    errors = [np.log(t.parameters["Rmc"].median / row[0]) for t, row in zip(tracked, truth, strict=True)]
    assert np.sqrt(np.mean(np.square(errors))) < 0.05
    assert tracked[-1].parameters["Rmc"].median < 0.85 * tracked[0].parameters["Rmc"].median


@pytest.mark.slow
def test_learns_from_one_measurement_to_the_next(tracked):
    def width(point, name):
        return np.log(point.parameters[name].upper / point.parameters[name].lower)

    assert width(tracked[-1], "Emaxlv") < 0.9 * width(tracked[0], "Emaxlv")


@pytest.mark.slow
def test_most_intervals_hold_the_truth(tracked, truth, series):
    inside = [
        t.parameters[n].lower <= row[k] <= t.parameters[n].upper
        for t, row in zip(tracked, truth, strict=True)
        for k, n in enumerate(NAMES)
    ]
    inside += [
        t.forecast[n].lower <= outputs[n] <= t.forecast[n].upper
        for t, (_, outputs) in zip(tracked[1:], series[1:], strict=True)
        for n in MEASURED
    ]
    assert np.mean(inside) > 0.75


@pytest.mark.slow
def test_nothing_is_flagged_that_fits(tracked):
    assert not any(t.unusual or t.failed for t in tracked)
    assert all(i.used for t in tracked for i in t.innovations.values())
    assert tracked[0].chi_square is None
    assert all(0.0 < t.probability <= 1.0 for t in tracked[1:])


@pytest.mark.slow
def test_a_wrong_value_is_flagged_and_left_out(series, tracked, after):
    tracker = after(5)
    right, _ = series[5]
    wrong = right.model_copy(
        update={"measurements": right.measurements.model_copy(update={"CO": 2.2 * right.measurements.CO})}
    )
    result = tracker.update("5", wrong)
    assert result.innovations["CO"].unusual
    assert not result.innovations["CO"].used
    assert result.innovations["MAP"].used
    assert result.unusual
    assert "CO does not fit" in result.message
    assert result.parameters["Rmc"].median == pytest.approx(tracked[5].parameters["Rmc"].median, rel=0.12)


@pytest.mark.slow
@pytest.mark.parametrize("between", [(), ("SP", "DP", "MAP")])
def test_a_value_that_stays_wrong_is_used_the_second_time(series, after, between):
    """An output that is measured every other time was left out each time, however often it missed."""
    tracker = after(5)
    results = []
    for k in (5, 6):
        if k == 6 and between:
            known = Measurements(**{n: getattr(series[5][0].measurements, n) for n in between})
            tracker.update("between", series[5][0].model_copy(update={"measurements": known}))
        right = series[k][0]
        changed = right.measurements.model_copy(update={"CO": 2.2 * right.measurements.CO})
        results.append(tracker.update(str(k), right.model_copy(update={"measurements": changed})))
    assert [result.innovations["CO"].used for result in results] == [False, True]
    assert all(result.innovations["CO"].unusual for result in results)
    assert "CO does not fit for the second time" in results[1].message


@pytest.mark.slow
def test_a_sudden_change_of_everything_is_flagged_and_followed(after):
    tracker = after(4)
    changed, _ = measured_at(2.4, 0.7, np.random.default_rng(0), noise=0.3)
    result = tracker.update("changed", changed)
    assert result.unusual
    assert "sudden change" in result.message
    for _ in range(3):
        result = tracker.update("again", changed)
    assert result.parameters["Rmc"].median == pytest.approx(2.4, rel=0.25)


@pytest.mark.slow
def test_a_measurement_may_be_missing(series, after):
    tracker = after(1)
    case = series[1][0].model_copy(update={"measurements": Measurements(MAP=80.0)})
    result = tracker.update("1", case)
    assert set(result.innovations) == {"MAP"}
    assert "CO" in result.forecast


@pytest.mark.slow
def test_forecast_of_what_has_not_been_measured(series, after):
    tracker = after(1)
    forecast, expected = tracker.forecast(series[1][0])
    assert expected["CO"].lower < forecast["CO"].lower < series[1][1]["CO"] < forecast["CO"].upper


def test_before_the_first_measurement_there_is_no_forecast(series):
    with pytest.raises(RuntimeError, match="no measurement"):
        Tracker(SETTINGS).forecast(series[0][0])


def test_a_point_without_measurements_is_refused(series):
    bare = series[0][0].model_copy(update={"measurements": None})
    with pytest.raises(CaseError):
        Tracker(SETTINGS).update("0", bare)


def width(point, name="Rmc"):
    return np.log(point.parameters[name].upper / point.parameters[name].lower)


def renamed(case, patient_id):
    return case.model_copy(update={"patient": case.patient.model_copy(update={"id": patient_id})})


@pytest.mark.slow
def test_another_patient_is_refused(series, after):
    tracker = after(1)
    estimate = tracker.estimate
    for use in (lambda case: tracker.update("1", case), tracker.forecast):
        with pytest.raises(CaseError, match="not the patient followed"):
            use(renamed(series[1][0], "U"))
    assert tracker.estimate is estimate


@pytest.mark.slow
def test_a_tracker_takes_the_path_of_a_case_and_says_what_is_no_number(series, after, tmp_path):
    """A path ended with "'str' object has no attribute 'patient'"."""
    write_case(series[1][0], tmp_path / "case.toml")
    tracker, path = after(1), str(tmp_path / "case.toml")
    assert tracker.forecast(path) == tracker.forecast(series[1][0])
    assert not tracker.update("1", path).failed
    with pytest.raises(TypeError, match=r'hours = "2": not a number'):
        tracker.forecast(path, hours="2")


@pytest.mark.slow
def test_an_id_written_otherwise_is_the_same_patient(series, after):
    tracker = after(1)
    assert not tracker.update("1", renamed(series[1][0], " t ")).failed


@pytest.mark.slow
def test_the_longer_ago_the_wider_the_forecast(series, after):
    tracker = after(1)

    def spread(hours):
        result, _ = tracker.forecast(series[0][0], hours)
        return result["CO"].upper - result["CO"].lower

    assert spread(0.0) < spread(6.0) < spread(24.0) < spread(24.0 * 30)
    assert spread(None) == spread(24.0)
    with pytest.raises(CaseError, match="hours"):
        spread(-1.0)


@pytest.mark.slow
def test_intervals_end_at_the_bounds_of_quantities(series, after):
    """They were quantiles of a normal distribution: a PCWP of -6 mmHg, a saturation of 104 %."""
    names, ends = ("PCWP", "CVP", "PF", "SaO2", "MAP"), {}
    outputs = GaussianMixture(np.ones(1), np.array([[4.0, 4.0, 1.0, 97.0, 80.0]]), 36.0 * np.eye(5)[None])
    ends = {n: (i.lower, i.upper) for n, i in track_module._intervals(names, outputs).items()}
    assert ends["PCWP"] == (0.0, pytest.approx(13.87, abs=0.01))
    assert ends["CVP"][0] == pytest.approx(-5.87, abs=0.01)
    assert ends["PF"][0] == pytest.approx(-8.87, abs=0.01), "blood can run backwards"
    assert ends["SaO2"] == (pytest.approx(87.13, abs=0.01), 100.0)
    assert ends["MAP"] == pytest.approx((70.13, 89.87), abs=0.01)
    point = after(2).update("3", series[2][0])
    assert not notes_on_bounds([point])
    cut = replace(point, expected=track_module._intervals(names, outputs))
    assert notes_on_bounds([point, cut]) == [
        "intervals are cut where no further values exist: PCWP at 0 mmHg, SaO2 at 100 %"
    ]


def test_equal_names_and_a_negative_interval_are_refused_at_once(series):
    case = series[0][0]
    with pytest.raises(
        CaseError, match=r'points = "a": the name of 2 measurements; allowed: a name of its own'
    ):
        track([("a", case), ("b", case), ("a", case)], settings=SETTINGS)
    with pytest.raises(ValueError, match="interval_hours = -1; allowed: from 0 h"):
        TrackSettings(interval_hours=-1)
    with pytest.raises(ValueError, match="interval_hours = nan; allowed: from 0 h"):
        TrackSettings(interval_hours=np.nan)


@pytest.mark.slow
def test_names_that_are_times_say_how_much_has_passed(series):
    cases = [case for case, _ in series[:3]]
    quick = ("2024-03-01T08:00", "2024-03-01T09:00", "2024-03-01T09:30")
    slow = ("2024-03-01", "2024-03-11", "2024-03-21")
    hourly, every_ten_days = (
        track(list(zip(names, cases, strict=True)), settings=SETTINGS).points for names in (quick, slow)
    )
    assert [p.hours for p in hourly] == [None, 1.0, 0.5]
    assert [p.hours for p in every_ten_days] == [None, 240.0, 240.0]
    assert width(hourly[-1]) < width(every_ten_days[-1])


def test_times_of_names():
    assert elapsed_hours(["2024-03-01T08-00", "2024-03-02T09:30"]) == [None, 25.5]
    assert elapsed_hours(["1", "2"]) is None
    assert elapsed_hours(["2024-03-01", "later"]) is None
    assert elapsed_hours(["2024-03-01T08:00Z", "2024-03-01T09:00"]) is None
    with pytest.raises(CaseError, match="earlier than"):
        elapsed_hours(["2024-03-02", "2024-03-01"])
    with pytest.raises(CaseError, match="the same time as"):  # it counted twice
        elapsed_hours(["2024-03-01T08:00", "2024-03-01T08-00"])
    for impossible in ("2024-13-01T08:00", "2024-02-30", "2024-03-01T25-00"):
        with pytest.raises(CaseError, match="no such date or time"):
            elapsed_hours([impossible, "2024-03-01T08:00"])


def test_clock_times_that_increase_are_those_of_one_day():
    """They counted as 24 h apart, without a word."""
    assert elapsed_hours(["08:00", "9:30", "12:00:00"]) == [None, 1.5, 2.5]
    assert elapsed_hours(["22:00", "02:00"]) is None
    assert elapsed_hours(["08:00", "25:00"]) is None
    assert elapsed_hours(["08:00", "2024-03-01T12:00"]) is None


def test_what_is_assumed_of_the_time_is_noted():
    assert notes_on_time(["08:00", "12:00"], 24.0) == [
        "the names are clock times and taken as those of one day: 08:00 to 12:00"
    ]
    for names in (["1", "2"], ["2024-03-01T08:00", "day 2"], ["22:00", "02:00"]):
        (note,) = notes_on_time(names, 12.0)
        assert "not all names of the measurements are times" in note
        assert "12 h from one to the next are assumed" in note
    assert "left out: 3; each still counts as 24 h" in notes_on_time(["1", "2"], 24.0, [1, 2])[1]
    assert notes_on_time(["2024-03-01T08:00", "2024-03-01T12:00"], 24.0) == []
    assert notes_on_time(["1"], 24.0) == []


@pytest.mark.slow
def test_a_doubtful_first_estimate_is_widened_and_said(series, tracked, monkeypatch):
    assert tracked[0].message == ""
    monkeypatch.setattr(track_module, "DRAWS", 24)
    result = Tracker(SETTINGS).update("0", series[0][0])
    assert "first estimate is itself uncertain" in result.message
    assert "effective draws" in result.message
    for name in NAMES:
        assert width(result, name) > 1.1 * width(tracked[0], name)


@pytest.mark.slow
def test_a_first_measurement_that_the_model_cannot_give_has_a_poor_verdict(series, tracked):
    assert tracked[0].verdict.level == "good"
    assert tracked[1].verdict is None
    right = series[0][0]
    wrong = right.measurements.model_copy(update={"SP": 2.5 * right.measurements.SP})
    first = track([("0", right.model_copy(update={"measurements": wrong}))], settings=SETTINGS)
    (point,) = first.points
    assert point.verdict.level == "poor"
    assert point.message.startswith("first estimate: POOR FIT, not to be used: the largest difference")
    assert first.as_object()["points"][0]["verdict"]["reasons"][0]["about"] in MEASURED


@pytest.mark.slow
def test_the_first_measurements_that_a_poor_fit_does_not_meet_are_named():
    """All were met and nothing was doubted: the verdict was in the message alone."""
    patient = Patient(id="F", sex="female", age_years=60, heart_rate_bpm=80)
    case = Case(patient=patient, measurements=Measurements(MAP=88.0, CO=4.0, PCWP=30.0))
    result = track([("1", case)], settings=TrackSettings(FitSettings(("Rmc",))))
    (point,), labelled = result.points, result.dataset.sel(point="1")
    assert point.verdict.level == "poor"
    assert not point.innovations["PCWP"].met
    assert "PCWP" in point.doubtful
    assert "PCWP: 30 mmHg was used but cannot be met by the free parameters" in point.doubts[0]
    assert "something that the model holds fixed is different in this patient" in point.doubts[0]
    assert float(labelled["met"].sel(output="PCWP")) == 0.0
    assert float(labelled["met"].sel(output="MAP")) == float(point.innovations["MAP"].met)
    assert str(labelled["verdict"].values) == "poor"
    assert str(labelled["doubts"].values).startswith("POOR FIT, not to be used")
    assert "PCWP: 30 mmHg was used" in str(labelled["doubts"].values)
    assert not point.as_object()["measurements"]["PCWP"]["met"]


@pytest.mark.slow
def test_the_labelled_result_has_what_the_points_have(followed):
    result, _ = followed
    labelled, second = result.dataset, result.points[1]
    found = labelled["parameters"].sel(point="1", parameter="Rmc", quantile=0.5)
    assert float(found) == second.parameters["Rmc"].median
    assert float(labelled["measured"].sel(point="1", output="CO")) == second.innovations["CO"].measured
    assert labelled["used"].sel(point="1").to_series().dropna().to_dict() == {
        name: innovation.used for name, innovation in second.innovations.items()
    }
    assert np.isnan(labelled["forecast"].sel(point="0")).all()
    assert labelled["parameter_units"].sel(parameter="Rmc") == "mmHg s/mL"
    assert result.assumed_interval_hours == labelled.attrs["assumed_interval_hours"] == 24.0
    assert "24 h from one to the next are assumed" in labelled.attrs["notes"][0]


@pytest.mark.slow
def test_what_is_being_done_is_reported(followed):
    _, said = followed
    assert said[0] == "measurement 1 of 7"
    assert "measurement 1 of 7: weighted draws" in said
    assert said[-1] == "measurement 7 of 7"


def test_one_output_far_from_the_forecast_is_said_though_all_together_fit():
    outputs = GaussianMixture(np.ones(1), np.zeros((1, 7)), 0.5 * np.eye(7)[None])
    values = np.array([3.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    result = InnovationTest.of(values, np.full(7, np.sqrt(0.5)), outputs, np.full(7, True))
    assert result.probability > 0.05
    assert result.unusual.tolist() == [True] + [False] * 6
    assert (
        result.message("abcdefg")
        == "a is far from the forecast, although all measurements together fit: used; check it"
    )


@pytest.mark.parametrize(("missed", "used"), [(np.nan, False), (6.0, True), (-6.0, False)])
def test_an_output_that_misses_a_second_time_in_the_same_direction_is_used(missed, used):
    outputs = GaussianMixture(np.ones(1), np.zeros((1, 4)), 0.5 * np.eye(4)[None])
    values, before = np.array([8.0, 0.0, 0.0, 0.0]), np.array([missed, np.nan, np.nan, np.nan])
    result = InnovationTest.of(values, np.full(4, np.sqrt(0.5)), outputs, np.full(4, True), before)
    assert result.unusual.tolist() == [True] + [False] * 3
    assert result.left_out.tolist() == [not used] + [False] * 3
    assert ("used now" if used else "not used") in result.message("abcd")


@pytest.mark.slow
def test_a_flow_that_nothing_free_explains_is_doubted_until_it_is_measured_again():
    """It was "used", and the flow afterwards was another, with an interval of 1 %."""
    patient = Patient(id="E", sex="male", age_years=62, height_cm=176, weight_kg=84, heart_rate_bpm=100)
    ecmo = Ecmo(pump="Rotaflow", speed_rpm=3300, oxygenator="Quadrox-i Adult", drainage_fr=25, return_fr=17,
                mode="VA")  # fmt: skip
    case = Case(patient=patient, ecmo=ecmo)
    beat = simulate(model_of(case))
    known = {name: float(beat[name]) for name in ("SP", "MAP", "CVP", "PF")}
    less = [{**known, "PF": known["PF"] - by} for by in (0.9, 1.0)]
    tracker = Tracker(TrackSettings(FitSettings(("fluid.extra_volume_ml", "Rmc", "Emaxlv"))))
    points = [
        tracker.update(str(k), case.model_copy(update={"measurements": Measurements(**each)}), 1.0)
        for k, each in enumerate((known, *less, {"MAP": known["MAP"]}, known))
    ]
    _, fell, again, missing, _ = points
    assert (fell.innovations["PF"].used, again.innovations["PF"].used) == (False, True)
    assert not any(p.innovations["PF"].met for p in (fell, again))
    assert fell.message.startswith(
        "PF does not fit the forecast and the other measurements: not used; check it"
    )
    assert "was used but cannot be met by the free parameters" in again.message
    assert "PF" in fell.doubtful
    assert "PF" in again.doubtful
    assert missing.doubts[0].startswith("PF: ")
    assert "the last measured, was not met" in missing.doubts[0]
    assert missing.message == ""
    assert points[-1].doubts == ()
    for point in points:
        for warning in (w for w in point.warnings if w.startswith("mean right atrial pressure")):
            assert f"pressure {point.outputs['CVP'].median:.3g} mmHg" in warning


def test_a_value_that_falls_with_others_is_a_sudden_change_in_the_message():
    tracker = Tracker(SETTINGS)
    tracker._course.learn({"MAP": 70.0, "CVP": 12.0, "PF": 3.9})
    one, three = np.array([False, False, True]), np.array([-2.4, 1.6, -4.4])
    test = InnovationTest(three, one, one, ~one & one, 30.0, 1e-6)
    names, fallen = ("MAP", "CVP", "PF"), {"MAP": 58.0, "CVP": 19.0, "PF": 3.1}
    assert "sudden change of the patient" in tracker._message(test, names, fallen)
    alone = {"MAP": 70.0, "CVP": 12.0, "PF": 3.1}
    assert "not used; check it" in tracker._message(test, names, alone)
