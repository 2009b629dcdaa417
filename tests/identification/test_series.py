"""What the measurements of a followed patient have in common."""

import pytest

from eclsim.cases.reading import read_mapping
from eclsim.identification.series import series_of
from eclsim.identification.settings import FitSettings
from eclsim.identification.tracking import TrackSettings, track
from eclsim.outputs.results import simulate
from eclsim.parameters.regulation import SET_POINT

PATIENT = {"id": "P", "sex": "male", "age_years": 60, "height_cm": 175, "weight_kg": 78}
MEASURED = ("SP", "DP", "MAP", "CO", "PCWP", "MPAP")


def case(**sections):
    patient = {**PATIENT, "heart_rate_bpm": 95}
    return read_mapping({"format": 1, "patient": patient, **sections}).case


def with_reflex(**measured):
    return case(regulation={"baroreflex": 1.0}, measurements=measured)


def test_a_series_has_one_set_point_the_pressure_measured_first():
    points = [("a", with_reflex(CO=4.0)), ("b", with_reflex(MAP=70.0)), ("c", with_reflex(MAP=50.0))]
    series = series_of(FitSettings(("Rmc",)), points)
    for _, each in points:
        followed, checked = series.checked(each)
        assert followed.regulation.set_point_mmHg == 70.0
        assert not [w for w in checked.warnings if w.key == SET_POINT]
    (note,) = series.notes
    assert "MAP of b (70)" in note


def test_a_set_point_that_a_case_gives_is_its_own():
    given = case(regulation={"baroreflex": 1.0, "set_point_mmHg": 85}, measurements={"MAP": 60.0})
    series = series_of(FitSettings(("Rmc",)), [("a", with_reflex(MAP=70.0)), ("b", given)])
    assert series.checked(given)[0].regulation.set_point_mmHg == 85


def test_reflexes_do_nothing_in_the_patient_who_was_measured_at_rest():
    """A failing heart: with the set point of a healthy one it would be taken for a worse one."""
    truth = {"Emaxlv": 0.8, "Rmc": 0.45}
    beat = simulate(case(parameters=truth))
    measured = {name: float(beat[name]) for name in MEASURED}
    settings = TrackSettings(FitSettings(("Rmc", "Emaxlv")))
    result = track([(str(k), with_reflex(**measured)) for k in range(2)], settings=settings)
    first, second = result.points
    assert first.verdict.level == "good"
    assert second.probability > 0.5
    assert second.parameters["Emaxlv"].median == pytest.approx(truth["Emaxlv"], rel=0.03)
    assert result.as_object()["notes"] == list(result.notes) != []
