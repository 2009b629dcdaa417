"""Following a patient whose parameters drift in a known way."""

import numpy as np
import pytest

from eclsim.haemodynamics.dataset import simulate
from eclsim.patients.case import Case, Measurements, Patient
from eclsim.patients.mistakes import CaseError
from eclsim.solver.model import model_of
from eclsim.studies.fit_settings import FitSettings
from eclsim.studies.measurement_errors import measurement_errors
from eclsim.studies.track import Tracker, TrackSettings, track

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
def tracked(series):
    return track([(str(k), case) for k, (case, _) in enumerate(series)], SETTINGS)


def test_follows_the_drift(tracked, truth):
    errors = [np.log(t.parameters["Rmc"].median / row[0]) for t, row in zip(tracked, truth, strict=True)]
    assert np.sqrt(np.mean(np.square(errors))) < 0.05
    assert tracked[-1].parameters["Rmc"].median < 0.85 * tracked[0].parameters["Rmc"].median


def test_learns_from_one_measurement_to_the_next(tracked):
    def width(point, name):
        return np.log(point.parameters[name].upper / point.parameters[name].lower)

    assert width(tracked[-1], "Emaxlv") < 0.9 * width(tracked[0], "Emaxlv")


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


def test_nothing_is_flagged_that_fits(tracked):
    assert not any(t.unusual or t.failed for t in tracked)
    assert all(i.used for t in tracked for i in t.innovations.values())
    assert tracked[0].chi_square is None
    assert all(0.0 < t.probability <= 1.0 for t in tracked[1:])


def test_a_wrong_value_is_flagged_and_left_out(series, tracked):
    tracker = Tracker(SETTINGS)
    for k, (case, _) in enumerate(series[:5]):
        tracker.update(str(k), case)
    right, _ = series[5]
    wrong = right.model_copy(
        update={"measurements": right.measurements.model_copy(update={"CO": 2.2 * right.measurements.CO})}
    )
    found = tracker.update("5", wrong)
    assert found.innovations["CO"].unusual
    assert not found.innovations["CO"].used
    assert found.innovations["MAP"].used
    assert found.unusual
    assert "CO does not fit" in found.message
    assert found.parameters["Rmc"].median == pytest.approx(tracked[5].parameters["Rmc"].median, rel=0.12)


def test_a_sudden_change_of_everything_is_flagged_and_followed(series):
    tracker = Tracker(SETTINGS)
    for k, (case, _) in enumerate(series[:4]):
        tracker.update(str(k), case)
    changed, _ = measured_at(2.4, 0.7, np.random.default_rng(0), noise=0.3)
    found = tracker.update("changed", changed)
    assert found.unusual
    assert "sudden change" in found.message
    for _ in range(3):
        found = tracker.update("again", changed)
    assert found.parameters["Rmc"].median == pytest.approx(2.4, rel=0.25)


def test_a_measurement_may_be_missing(series):
    tracker = Tracker(SETTINGS)
    tracker.update("0", series[0][0])
    case = series[1][0].model_copy(update={"measurements": Measurements(MAP=80.0)})
    found = tracker.update("1", case)
    assert set(found.innovations) == {"MAP"}
    assert "CO" in found.forecast


def test_forecast_of_what_has_not_been_measured(series):
    tracker = Tracker(SETTINGS)
    tracker.update("0", series[0][0])
    forecast, expected = tracker.forecast(series[1][0])
    assert expected["CO"].lower < forecast["CO"].lower < series[1][1]["CO"] < forecast["CO"].upper


def test_before_the_first_measurement_there_is_no_forecast(series):
    with pytest.raises(RuntimeError, match="no measurement"):
        Tracker(SETTINGS).forecast(series[0][0])


def test_a_point_without_measurements_is_refused(series):
    bare = series[0][0].model_copy(update={"measurements": None})
    with pytest.raises(CaseError):
        Tracker(SETTINGS).update("0", bare)
