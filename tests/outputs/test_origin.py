"""Every labelled result states the version that made it, and variants what they are repeated from."""

import json

import numpy as np
import pytest
import xarray as xr

import eclsim
from eclsim.cases import Case
from eclsim.cases.reading import read_mapping

PATIENT = {"id": "P", "sex": "female", "age_years": 60, "heart_rate_bpm": 80}
ECMO = {"mode": "VA", "pump": "Rotaflow", "oxygenator": "Quadrox-i Adult"}
CHANGES = {"Rmc": [0.5, 0.7]}
MADE_BY = f"eclsim {eclsim.__version__}"


def case_with(**ecmo) -> Case:
    return read_mapping({"format": 1, "patient": PATIENT, "ecmo": ECMO | ecmo}).case


def patient(**sections) -> Case:
    return read_mapping({"format": 1, "patient": PATIENT, **sections}).case


@pytest.mark.slow
def test_results_of_python_state_their_version(tmp_path):
    sobol = eclsim.SobolSettings(parameters=("Rmc",), samples=8, outputs=("MAP",), second_order=False)
    results = {
        "simulate": eclsim.simulate(patient()),
        "simulate_many": eclsim.simulate_many(patient(), CHANGES, ["MAP"]),
        "derivatives": eclsim.derivatives(patient(), ("MAP",), ("Rmc",)),
        "course": eclsim.course(patient(), minutes=1),
        "sensitivity": eclsim.sensitivity(patient(), settings=sobol).dataset,
        "identifiability": eclsim.identifiability(patient(), parameters=("Rmc", "Emaxlv")).dataset,
    }
    assert {name: result.attrs.get("made_by") for name, result in results.items()} == dict.fromkeys(
        results, MADE_BY
    )
    cases = {name: Case.model_validate_json(result.attrs["case"]) for name, result in results.items()}
    assert {name: case.patient.id for name, case in cases.items()} == dict.fromkeys(results, "P")
    results["simulate_many"].to_netcdf(tmp_path / "many.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "many.nc", engine="h5netcdf") as saved:
        assert saved.attrs["made_by"] == MADE_BY


@pytest.mark.slow
def test_fits_draws_and_tracks_state_their_version():
    measured = patient(measurements={"SP": 110, "DP": 75, "MAP": 88, "CO": 4.0})
    quick = eclsim.FitSettings(
        ("Rmc", "Emaxlv"), multi_start=eclsim.MultiStart(points_per_parameter=10, refined_share=0.2)
    )
    fit = eclsim.fit(measured, settings=quick)
    draws = eclsim.posterior(fit, settings=eclsim.PosteriorSettings(method="importance")).draws
    assert fit.dataset.attrs["made_by"] == MADE_BY
    again = eclsim.simulate(Case.model_validate_json(fit.dataset.attrs["case"]))
    assert float(again["MAP"]) == pytest.approx(fit.simulated["MAP"], rel=1e-5)
    assert draws.attrs["made_by"] == MADE_BY
    assert draws["posterior"].attrs["made_by"] == MADE_BY


@pytest.mark.slow
def test_a_crrt_study_states_its_version():
    study = eclsim.crrt_study(case_with(speed_rpm=3000), schemes="a,b")
    for result in (study.means, study.limits, study.without_crrt, study.waveforms, study.summary):
        assert result.attrs["made_by"] == MADE_BY


@pytest.mark.parametrize("setting", [{"speed_rpm": 3000}, {"flow_l_min": 3.0}])
def test_variants_of_a_case_are_repeated_from_their_file(setting, tmp_path):
    many = eclsim.simulate_many(case_with(**setting), CHANGES, ["MAP", "PF"])
    many.to_netcdf(tmp_path / "many.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "many.nc", engine="h5netcdf") as saved:
        again = eclsim.simulate_many(
            Case.model_validate_json(saved.attrs["case"]), {"Rmc": saved["Rmc"].values}, ["MAP", "PF"]
        )
    assert many.attrs["made_by"] == MADE_BY
    for name in ("MAP", "PF"):
        np.testing.assert_array_equal(again[name], many[name])


@pytest.mark.parametrize(
    ("setting", "varied"), [({"speed_rpm": 3000}, "speed_rpm"), ({"flow_l_min": 3.0}, "flow_l_min")]
)
def test_derivatives_of_a_case_are_repeated_from_their_file(setting, varied):
    names = ("MAP", "PF"), ("Rmc", f"ecmo.{varied}")
    slopes = eclsim.derivatives(case_with(**setting), *names, volume_policy="patient_held")
    again = eclsim.derivatives(Case.model_validate_json(slopes.attrs["case"]), *names)
    np.testing.assert_array_equal(again, slopes)


def test_variants_of_a_model_state_its_values():
    model = eclsim.Model.published(eclsim.circulation()).with_values(Emaxlv=1.1)
    values = json.loads(eclsim.simulate_many(model, CHANGES, ["MAP"]).attrs["values"])
    assert values == dict(model.values)
