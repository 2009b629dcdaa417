"""What the patient's own beat says is said wherever an analysis of that patient is."""

from pathlib import Path

import pytest

import eclsim
from eclsim.outputs.results import beat_warnings
from eclsim.sensitivity.analysis import merge_shards
from eclsim.sensitivity.identifiability import identifiability
from eclsim.sensitivity.results import doubts

CASE = """format = 1
[patient]
id = "P01"
sex = "female"
age_years = 70
height_cm = 165
weight_kg = 60
heart_rate_bpm = 120
[measurements]
MAP = 80
CO = 1.4
PF = 5.6
[ecmo]
pump = "Rotaflow"
speed_rpm = 4700
oxygenator = "Quadrox-i Small Adult"
drainage_fr = 21
return_fr = 17
mode = "VA"
"""
LABEL = "outside the label of its oxygenator, 0.5 to 5 L/min"
VENTRICLE = "do not read distension or unloading of the left ventricle"
FREE = eclsim.FitSettings(("Rmc", "Emaxlv"))


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cases") / "case.toml"
    path.write_text(CASE, encoding="utf-8")
    return path


def mentions(warnings: tuple[str, ...], words: str) -> bool:
    return any(words in sentence for sentence in warnings)


def test_all_is_said_that_a_simulation_says(case: Path):
    said = beat_warnings(eclsim.read_case(case).case)
    assert list(said) == eclsim.simulate(case).attrs["warnings"]
    assert mentions(said, LABEL)
    assert mentions(said, VENTRICLE)


def test_how_outputs_are_to_be_read_that_are_not_shown_is_left_out(case: Path):
    model = eclsim.model_of(eclsim.read_case(case).case)
    assert not mentions(beat_warnings(model, shown=("MAP",)), VENTRICLE)
    assert mentions(beat_warnings(model, shown=("MAP",)), LABEL)
    assert mentions(beat_warnings(model, shown=("MAP", "PCWP")), VENTRICLE)


def test_a_beat_that_is_not_found_is_said(case: Path):
    model = eclsim.model_of(eclsim.read_case(case).case).with_values({"Rmc": -1.0})
    (said,) = beat_warnings(model)
    assert "Rmc" in said


@pytest.mark.slow
def test_identifiability_says_it(case: Path):
    result = identifiability(case, parameters=("Rmc",), outputs=("MAP",))
    assert mentions(result.warnings, LABEL)
    everything = [*result.warnings, *result.doubts]
    assert result.as_object()["warnings"] == result.dataset.attrs["warnings"] == everything


def test_sensitivity_says_it_also_where_the_runs_are_read_again(case: Path, tmp_path: Path):
    settings = eclsim.SobolSettings(samples=4, parameters=("Rmc", "Emaxlv"), second_order=False)
    result = eclsim.sensitivity(case, settings=settings, folder=tmp_path)
    assert mentions(result.warnings, LABEL)
    assert result.indices.as_object()["warnings"] == list(result.warnings)
    assert mentions(tuple(doubts(result.indices, "normal")), "normal: at the central values: ECMO flow")
    assert merge_shards(tmp_path).warnings == result.warnings


@pytest.mark.slow
def test_fit_posterior_and_tracking_say_it(case: Path):
    fit = eclsim.fit(case, settings=FREE)
    slower = eclsim.read_case(case, ["ecmo.speed_rpm=3000"])
    gaussian = eclsim.PosteriorSettings(method="gaussian")
    posterior = eclsim.posterior(fit, settings=gaussian, predictions=[("3000 rpm", slower)])
    as_measured, at_3000 = posterior.predictions
    assert mentions(fit.warnings, LABEL)
    assert mentions(as_measured.warnings, LABEL)
    assert not mentions(at_3000.warnings, LABEL)
    assert posterior.as_object()["predictions"][0]["warnings"] == list(as_measured.warnings)
    (point,) = eclsim.track([("8:00", case)], settings=eclsim.TrackSettings(fit=FREE)).points
    assert mentions(point.warnings, LABEL)
    assert point.as_object()["warnings"]


@pytest.mark.slow
def test_the_crrt_study_says_it_once(case: Path):
    study = eclsim.crrt_study(case, speeds=[3000.0], schemes="a,d,g", volume_policy="as_published")
    assert [f"without CRRT: ECMO flow {5.64:.3g}" in sentence for sentence in study.warnings].count(True) == 1
    assert sum(LABEL in sentence for sentence in study.warnings) == 1
    assert not mentions(study.warnings, "CRRT access")
    assert study.as_object()["warnings"] == list(study.warnings)
