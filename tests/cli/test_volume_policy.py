"""The blood volume policy: the file says it, the option wins and says so, and every command keeps it."""

import json
from pathlib import Path

import pytest

from eclsim.cases import read_case
from eclsim.crrt_study.schemes import StudyError, policy_of_cases
from eclsim.identification.cohort import cases_as_given
from eclsim.identification.fit import fit as fit_case
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.posterior import PosteriorSettings, density_of
from eclsim.identification.settings import FitSettings
from eclsim.orbit.model import model_of

PATIENT_HELD = 'blood_volume_policy = "patient_held"\n'
MEASURED = "[measurements]\nMAP = 80\nCO = 1.4\n"


@pytest.fixture
def patient_held_case(shell):
    """A case on ECMO whose file says that its circuits are primed."""
    file = Path(shell.case("held.toml", more=shell.ecmo + MEASURED))
    file.write_text(file.read_text().replace("format = 1\n", "format = 1\n" + PATIENT_HELD))
    return str(file)


def beat(shell, *arguments):
    done = shell.run("simulate", *arguments, "--json", "-")
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout)["cases"][0], done.stderr


def test_the_file_s_policy_is_used_and_the_option_wins_with_a_word(shell, patient_held_case):
    own, message = beat(shell, patient_held_case)
    assert own["blood_volume_policy"] == "patient_held"
    assert "overrides" not in message
    other, message = beat(shell, patient_held_case, "--volume-policy", "as_published")
    assert other["blood_volume_policy"] == "as_published"
    wins = f'blood_volume_policy = "as_published": overrides "patient_held" of {patient_held_case}'
    assert f"--volume-policy: {wins}" in message
    assert own["outputs"]["MAP"] > other["outputs"]["MAP"] + 2.0
    plain, _ = beat(shell, shell.case(more=shell.ecmo))
    assert plain["blood_volume_policy"] == "as_published"


def test_another_word_is_refused_with_the_two_that_are_read(shell, patient_held_case):
    Path(patient_held_case).write_text(
        Path(patient_held_case).read_text().replace("patient_held", "patient_hold")
    )
    done = shell.run("simulate", patient_held_case)
    assert done.exit_code == 2
    assert 'held.toml:2: blood_volume_policy = "patient_hold": unknown name' in done.stderr
    assert "did you mean patient_held?" in done.stderr
    done = shell.run("simulate", shell.case(), "--set", "blood_volume_policy=patient_held")
    assert "did you mean the option --volume-policy?" in done.stderr


@pytest.mark.slow
def test_a_fitted_case_is_simulated_as_it_was_fitted(shell, tmp_path, monkeypatch):
    few = MultiStart(points_per_parameter=10, refined_share=0.2, round_size=4, rediscoveries=2)
    monkeypatch.setattr("eclsim.identification.multi_start.MultiStart", lambda **_: few)
    case, out = shell.case(more=shell.ecmo + MEASURED), tmp_path / "fit"
    arguments = ("--parameters", "Rmc,Emaxlv", "--volume-policy", "patient_held", "--out", str(out))
    done = shell.run("identify", case, *arguments, "--json", "-")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["settings"]["blood_volume_policy"] == "patient_held"
    again, _ = beat(shell, str(out / "cases" / "P01.toml"))
    assert again["outputs"]["MAP"] == pytest.approx(80.0, rel=1e-3)
    assert again["outputs"]["CO"] == pytest.approx(1.4, rel=1e-3)


@pytest.mark.slow
def test_models_fits_and_posteriors_take_the_case_s_policy(patient_held_case):
    case = read_case(patient_held_case).case
    assert model_of(case).policy == "patient_held"
    few = MultiStart(points_per_parameter=4, refined_share=0.2, round_size=2, rediscoveries=1)
    fit = fit_case(case, settings=FitSettings(("Rmc",), multi_start=few))
    assert fit.objective.policy == "patient_held"
    assert density_of(fit, PosteriorSettings()).policy == "patient_held"
    other = fit_case(case, settings=FitSettings(("Rmc",), multi_start=few, volume_policy="as_published"))
    assert other.case.volume_policy == "as_published"
    assert density_of(other, PosteriorSettings()).policy == "as_published"


def test_a_study_takes_what_the_cases_say_and_does_not_mix(shell, patient_held_case):
    done = shell.run("crrt-study", patient_held_case, "--schemes", "g", "--speeds", "3425", "--json", "-")
    assert list(json.loads(done.stdout)["policies"]) == ["patient_held"]
    case = read_case(patient_held_case).case
    published = case.with_volume_policy("as_published")
    assert policy_of_cases([case, case]) == "patient_held"
    assert policy_of_cases(list(cases_as_given([], "tests").cases.values())) == "both"
    with pytest.raises(StudyError, match="different blood volume policies"):
        policy_of_cases([case, published])


def test_a_series_of_several_policies_is_not_tracked_silently(shell, patient_held_case):
    plain = shell.case("plain.toml", more=shell.ecmo + MEASURED)
    done = shell.run("track", patient_held_case, plain, "--out", shell.folder / "out")
    assert done.exit_code == 2
    assert "patient_held in P01, as_published in P01" in done.stderr
    assert "choose one with --volume-policy" in done.stderr
