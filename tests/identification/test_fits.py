"""Fits of cases and cohorts with few free parameters, their files, and going on with them."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from eclsim.cases import CaseError, read_case
from eclsim.cases.case import Case, Measurements, Patient
from eclsim.cases.cohort import CohortPoint
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import read_mapping
from eclsim.execution import Distribution, ExecutionError, Shard, ShardDone
from eclsim.identification import cohort
from eclsim.identification.cohort import fit_cohort, r_squared
from eclsim.identification.density import NoSteadyBeatError
from eclsim.identification.files import fits_object, write_fit_figures, write_fits, write_fitted_case
from eclsim.identification.fit import NOT_FROM_A_POOR_FIT, checked_by_simulation, fit_cases
from eclsim.identification.fit import fit as fit_case
from eclsim.identification.multi_start import Exploration, FitStatus, MultiStart, optimum_without_fit
from eclsim.identification.posterior import PosteriorSettings, posterior
from eclsim.identification.profiles import with_profiles
from eclsim.identification.report import fits_text
from eclsim.identification.settings import FitSettings, checked_fit, read_bounds
from eclsim.identification.verdict import Aspect, Level, interval_agreement
from eclsim.inputs.mistakes import InputError
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate
from eclsim.outputs.uncertainty import Uncertainty
from eclsim.parameters.thiel2025 import BOUNDS

QUICK = FitSettings(("Rmc", "Emaxlv"), multi_start=MultiStart(10, 0.2, round_size=4, rediscoveries=2))
TRUTH = {"Rmc": 0.85, "Emaxlv": 1.3}


@pytest.fixture(scope="session")
def fit(twin):
    return fit_case(twin, settings=QUICK)


def test_a_twin_gives_back_its_parameters(fit):
    assert fit.status == "fitted"
    for name, value in TRUTH.items():
        found = fit.parameters[name]
        assert found.value == pytest.approx(value, rel=1e-4)
        assert found.lower < value < found.upper
        assert found.identifiable
        assert not found.at_bound


def test_the_written_case_gives_the_fitted_outputs(fit, tmp_path: Path):
    reading = read_case(write_fitted_case(tmp_path, fit))
    beat = simulate(model_of(reading.case))
    for name, value in fit.simulated.items():
        assert float(beat[name]) == pytest.approx(value, rel=1e-5)


def test_a_measurement_that_is_not_fitted_is_named_in_the_verdict(twin):
    """Only the terminal said it: in Python and in every file a blood gas without [gas] was gone."""
    assert twin.measurements is not None
    more = twin.measurements.model_copy(update={"SaO2": 93.0})
    found = fit_case(twin.model_copy(update={"measurements": more}), settings=QUICK)
    (sentence,) = (r.sentence for r in found.verdict.reasons if r.sentence.startswith("SaO2"))
    assert "measured and not fitted, since the case has no such output; it needs [gas]" in sentence


def test_the_object_is_that_of_the_documentation(fit):
    point = json.loads(json.dumps(fit.as_object(), allow_nan=False))
    assert point["id"] == "T01"
    assert point["cost"] < 1e-8
    assert set(point["outputs"]["MAP"]) == {"measured", "simulated", "lower", "upper", "determined"}
    assert point["verdict"]["level"] == "good"
    assert set(point["verdict"]["goodness"]["differences"]) == set(fit.measured)
    assert point["implied"]["EDVRV"]["healthy"] == [78.0, 218.0]
    assert {"value", "lower", "upper", "at_bound", "identifiable"} <= set(point["parameters"]["Rmc"])
    assert point["starts_agreeing"] >= 2
    assert point["seconds"] > 0
    assert point["correlation"]["Rmc"]["Rmc"] == pytest.approx(1.0)


def test_the_labelled_result_has_units(fit):
    labelled = fit.dataset
    assert float(labelled["value"].sel(parameter="Rmc")) == fit.parameters["Rmc"].value
    assert labelled["parameter_units"].sel(parameter="Rmc") == "mmHg s/mL"
    assert float(labelled["measured"].sel(output="CO")) == fit.measured["CO"]
    assert labelled["output_units"].sel(output="CO") == "L/min"
    assert float(labelled["correlation"].sel(parameter="Rmc", with_parameter="Rmc")) == pytest.approx(1.0)
    assert labelled.attrs["verdict"] == "good"
    of_output = labelled[["simulated_lower", "simulated_upper", "determined"]].sel(output="CO")
    interval = fit.intervals["CO"]
    assert [of_output[n].item() for n in of_output] == [interval.low, interval.high, interval.determined]


def test_a_fit_says_that_stated_uncertainties_do_not_weight_it(twin):
    settings = replace(QUICK, uncertainties={"MAP": Uncertainty(1.0)})
    said = [r.sentence for r in fit_case(twin, settings=settings).verdict.remarks]
    assert any("uncertainties of MAP judge the fit" in sentence for sentence in said)


@pytest.mark.slow
def test_the_labelled_result_has_the_reasons_of_its_verdict(twin, tmp_path):
    """Its headline asked to read the reasons, which it did not have."""
    fit = fit_case(twin, settings=replace(QUICK, bounds={"Rmc": (1.5, 2.0)}))
    fit.dataset.to_netcdf(tmp_path / "fit.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "fit.nc", engine="h5netcdf") as saved:
        assert [*saved.attrs["reasons"]] == [f"{r.level}: {r.sentence}" for r in fit.verdict.reasons]
        assert saved.attrs["reasons"][0].startswith("poor: ")
        assert saved["reason"].sel(parameter="Rmc").item() == fit.parameters["Rmc"].reason
        again = simulate(model_of(Case.model_validate_json(saved.attrs["case"])))
    for name in ("MAP", "CO"):
        assert float(again[name]) == pytest.approx(fit.simulated[name], rel=1e-5)


def test_the_same_seed_gives_the_same_numbers(twin, fit):
    again = fit_case(twin, settings=QUICK).as_object()
    assert {**again, "seconds": 0} == {**fit.as_object(), "seconds": 0}


@pytest.mark.slow
def test_an_optimum_outside_the_bounds_is_found_at_the_bound(twin):
    narrow = replace(QUICK, bounds={"Rmc": (0.1, 0.7)})
    result = fit_case(twin, settings=narrow)
    found = result.parameters["Rmc"]
    assert found.value == 0.7
    assert found.at_bound
    assert not found.identifiable
    assert result.verdict.level is not Level.POOR
    assert found.reason.startswith("at its upper bound, which limits it: larger values")
    assert "the true value may be beyond the bound" in found.reason


@pytest.mark.slow
def test_a_poor_fit_at_a_bound_says_that_alone(twin):
    found = fit_case(twin, settings=replace(QUICK, bounds={"Rmc": (1.5, 2.0)}))
    assert found.verdict.level is Level.POOR
    assert found.parameters["Rmc"].at_bound
    assert {p.reason for p in found.parameters.values()} == {NOT_FROM_A_POOR_FIT}
    held_back = [r for r in found.verdict.doubts if r.about == "Rmc"]
    assert "--bounds" in held_back[0].sentence


@pytest.mark.slow
def test_the_profile_interval_is_the_gaussian_one_where_the_measurements_determine(twin):
    fit = fit_case(twin, settings=replace(QUICK, weights="uncertainty"))
    judged, _ = with_profiles(fit)
    assert judged.verdict.level == "good"
    for name, p in judged.parameters.items():
        assert p.identifiable
        lower, upper = judged.profile[name]
        assert np.log(lower) == pytest.approx(np.log(p.lower), abs=0.15 * np.log(p.upper / p.lower))
        assert np.log(upper) == pytest.approx(np.log(p.upper), abs=0.15 * np.log(p.upper / p.lower))
        assert judged.as_object()["parameters"][name]["profile"] == [lower, upper]


def test_intervals_of_relative_weights_are_wider_than_those_of_the_uncertainties(twin, fit):
    """They were the same, although only the weights by uncertainty make errors that small."""
    best = fit_case(twin, settings=replace(QUICK, weights="uncertainty"))
    for name, p in fit.parameters.items():
        other = best.parameters[name]
        assert p.value == pytest.approx(other.value, rel=1e-4)
        assert p.upper / p.lower > 1.005 * other.upper / other.lower


@pytest.mark.slow
def test_the_terminal_prints_the_wider_of_two_intervals_and_no_profile_is_said(fit, tmp_path, monkeypatch):
    point = fit.as_object()
    gaussian = point["parameters"]["Rmc"]
    gaussian["profile"] = [0.5 * gaussian["lower"], 0.99 * gaussian["upper"]]
    text = fits_text(fits_object([point], QUICK.as_object()))
    assert f"{gaussian['profile'][0]:.4g}  {gaussian['upper']:.4g}" in text
    assert "the wider of the Gaussian approximation and the profile likelihood" in text
    nowhere = SimpleNamespace(costs=np.array([np.inf]))
    monkeypatch.setattr("eclsim.identification.profiles.refine", lambda *_: nowhere)
    judged, profiled = with_profiles(fit)
    assert profiled is None
    assert "no profile likelihood could be computed" in judged.verdict.doubts[0].sentence
    (tmp_path / "profiles.svg").write_text("of an earlier fit")
    write_fit_figures(tmp_path, judged, profiled)
    assert {file.stem for file in tmp_path.iterdir()} == {"slices", "starts", "residuals", "correlation"}


@pytest.mark.slow
def test_a_twin_is_a_good_fit_and_a_contradictory_patient_a_poor_one(twin, fit):
    assert fit.verdict.level == "good"
    assert {"EDVLV", "EDVRV", "right_atrial_pressure"} <= set(fit.implied)
    high = twin.measurements.model_copy(update={"MPAP": twin.measurements.MPAP + 14.0})
    poor = fit_case(twin.model_copy(update={"measurements": high}), settings=QUICK)
    assert poor.status == "fitted"
    assert poor.verdict.level == "poor"
    assert poor.verdict.reasons[0].about == "MPAP"
    assert not any(p.identifiable for p in poor.parameters.values())
    assert poor.parameters["Rmc"].reason.startswith("the fit is poor")


def test_intervals_that_exclude_each_other_end_a_good_fit(fit):
    value = fit.parameters["Rmc"].upper
    other = {"Rmc": {"lower": 1.2 * value, "upper": 1.5 * value}}
    doubted = fit.judged(interval_agreement(fit.as_object()["parameters"], other, "posterior"))
    assert doubted.verdict.level == "poor"
    assert not doubted.parameters["Rmc"].identifiable
    wide = {"Rmc": {"lower": 0.1, "upper": 5.0}}
    wider = fit.judged(interval_agreement(fit.as_object()["parameters"], wide, "posterior"))
    assert wider.verdict.level == "doubtful"
    assert "use the wider" in wider.parameters["Rmc"].reason
    assert wider.parameters["Emaxlv"].identifiable


@pytest.mark.slow
def test_weights_by_uncertainty_favour_what_is_known_well(twin):
    wrong = twin.measurements.model_copy(update={"MAP": twin.measurements.MAP * 1.08, "SP": None, "DP": None})
    case = twin.model_copy(update={"measurements": wrong})
    only_rmc = replace(QUICK, parameters=("Rmc",), weights="uncertainty")
    trusted = fit_case(case, settings=replace(only_rmc, uncertainties={"MAP": Uncertainty(0.1)}))
    doubted = fit_case(case, settings=replace(only_rmc, uncertainties={"MAP": Uncertainty(50.0)}))
    assert abs(trusted.simulated["MAP"] / wrong.MAP - 1) < 0.01
    assert abs(doubted.simulated["MAP"] / wrong.MAP - 1) > 0.02


@pytest.mark.slow
def test_equal_bounds_fix_a_parameter_in_the_written_case(twin):
    fixed = replace(QUICK, parameters=("Rmc", "Rpmc"), bounds={"Rpmc": (0.08, 0.08)})
    found = fit_case(twin, settings=fixed)
    assert set(found.parameters) == {"Rmc"}
    assert found.case.parameters["Rpmc"] == 0.08


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"parameters": ("Rmcc",)}, "did you mean Rmc"),
        ({"parameters": ("ecmo.speed",)}, "ecmo.speed: unknown parameter; allowed: names"),
        ({"parameters": ("gas.shunt_fraction",)}, "not read by the circuit"),
        ({"bounds": {"Rmc": (2.0, 0.1)}}, "lower bound above upper bound"),
        ({"bounds": {"Rsvn": (0.001, 0.1)}}, "not free"),
        ({"parameters": ("Recmooxy",)}, "not read by the circuit"),
        ({"bounds": {"Rmc": (0.6, 0.6), "Emaxlv": (1.0, 1.0)}}, "none is free"),
    ],
)
def test_what_cannot_be_fitted_is_said_before_anything_is_computed(twin, changes, words):
    checked = checked_fit(twin, replace(QUICK, **changes))
    assert any(words in str(m) for m in checked.mistakes), checked.mistakes
    with pytest.raises(CaseError):
        fit_case(twin, settings=replace(QUICK, **changes))


def test_bounds_as_text():
    assert read_bounds("Rmc=0.1:2, Csart=0.5:5") == {"Rmc": (0.1, 2.0), "Csart": (0.5, 5.0)}
    with pytest.raises(InputError, match="NAME=LOWER:UPPER"):
        read_bounds("Rmc=0.1")
    with pytest.raises(InputError, match="Rmc is given twice"):
        read_bounds("Rmc=0.1:1,Rmc=0.2:2")


def fitted(points, folder, settings=QUICK, digest="abc", progress=None, **options) -> list[dict]:
    with Distribution(**options).running() as executor:
        return fit_cohort(
            points, settings, digest=digest, folder=folder, executor=executor, progress=progress
        )


@pytest.mark.slow
def test_the_points_of_a_group_are_told_one_by_one(points):
    lines: list[str] = []
    fitted(points, None, progress=lambda state: lines.append(str(state)))
    assert lines[0] == "fits: 0 of 1 groups of data points"
    assert [text for text in lines if "point 2 of 2" in text and "exploring" in text]
    assert lines[-2].endswith("refining the best start to the end (point 2 of 2)")
    assert lines[-1].startswith("fits: 1 of 1 groups of data points")


@pytest.fixture
def points(twin) -> list[CohortPoint]:
    lower = twin.measurements.model_copy(
        update={n: getattr(twin.measurements, n) * 0.97 for n in ("SP", "DP")}
    )
    other = twin.model_copy(update={"measurements": lower.model_copy(update={"CO": None})})
    return [CohortPoint("T01", "1", 2, twin), CohortPoint("T01", "2", 3, other)]


def without_times(results: list[dict]) -> list[dict]:
    return [{name: value for name, value in one.items() if name != "seconds"} for one in results]


@pytest.mark.slow
def test_a_cohort_in_shards_or_stopped_and_resumed_is_the_same_and_fitted_once(points, tmp_path, monkeypatch):
    monkeypatch.setattr(cohort, "POINTS_PER_GROUP", 1)
    whole = fitted(points, tmp_path / "whole")
    assert whole[1]["outputs"]["CO"]["measured"] is None
    assert whole[1]["line"] == 3
    for number in (2, 1):
        with pytest.raises(ShardDone):
            fitted(points, tmp_path / "shards", shard=Shard(number, 2))
    with monkeypatch.context() as patched:
        patched.setattr(cohort, "fit_cases", lambda *_: pytest.fail("fitted again"))
        assert without_times(fitted(points, tmp_path / "shards", merge=True)) == without_times(whole)
        assert fitted(points, tmp_path / "whole", resume=True) == whole
    for name in ("T01_1", "T01_2"):
        one, other = (tmp_path / run / "cases" / f"{name}.toml" for run in ("whole", "shards"))
        assert one.read_bytes() == other.read_bytes()


def test_results_made_of_something_else_are_not_gone_on_with(points, tmp_path, monkeypatch):
    monkeypatch.setattr(cohort, "fit_cases", lambda *_: [])
    fitted([], tmp_path)
    with pytest.raises(ExecutionError, match="--resume goes on"):
        fitted([], tmp_path)
    with pytest.raises(ExecutionError, match="cohort_file was 'abc' and is 'xyz'"):
        fitted([], tmp_path, digest="xyz", resume=True)
    with pytest.raises(ExecutionError, match="weights was 'relative'"):
        fitted([], tmp_path, replace(QUICK, weights="uncertainty"), resume=True)


def test_a_point_whose_fit_breaks_off_stops_no_other(points, tmp_path, monkeypatch):
    def breaking(cases, settings, progress):
        if any(name == "T01/2" for name, _ in cases):
            raise ValueError("need at least one array to stack")
        return fit_cases(cases, settings, progress)

    monkeypatch.setattr(cohort, "fit_cases", breaking)
    good, broken = fitted(points, tmp_path)
    assert good["status"] == "fitted"
    assert broken["status"] == "broken_off"
    assert broken["verdict"]["level"] == "poor"
    assert "(ValueError: need at least one array to stack)" in broken["verdict"]["reasons"][0]["sentence"]
    assert [file.name for file in (tmp_path / "cases").iterdir()] == ["T01_1.toml"]
    text = fits_text(fits_object([good, broken], QUICK.as_object()))
    assert "T01/2: poor: a program error stopped this fit" in text
    shared = fitted(points, None, replace(QUICK, shared=("Rmc",)))
    assert [point["status"] for point in shared] == ["broken_off"] * 2


def test_a_point_without_any_steady_beat_is_kept_as_such(points, tmp_path, monkeypatch):
    nothing = optimum_without_fit(2, 6, FitStatus.NO_STEADY_BEAT, Exploration(20, 20, 0, 0))
    monkeypatch.setattr("eclsim.identification.fit.identify", lambda *_: [nothing])
    (result,) = fitted(points[:1], tmp_path)
    assert result["status"] == "no_steady_beat"
    assert result["cost"] is None
    assert result["parameters"]["Rmc"]["value"] is None
    assert result["outputs"]["MAP"]["simulated"] is None
    assert list((tmp_path / "cases").iterdir()) == []
    assert r_squared([result]) == {"pressures": None, "flows": None}
    write_fits(tmp_path, fits_object([result], QUICK.as_object()))


@pytest.fixture(scope="module")
def shut() -> Case:
    """At this pump speed and elastance no valve of the heart opens."""
    patient = Patient(id="S01", sex="female", age_years=60, heart_rate_bpm=120)
    return Case(
        patient=patient, ecmo=PRESETS["paper"].case().ecmo,
        measurements=Measurements(MAP=80.0, PF=3.5), parameters={"Emaxlv": 0.1},
    )  # fmt: skip


def test_where_valves_stay_shut_at_all_explored_sets_the_fit_says_so(shut):
    settings = replace(QUICK, parameters=("Emaxlv",), bounds={"Emaxlv": (0.08, 0.18)})
    fit = fit_case(shut, settings=settings)
    assert fit.status is FitStatus.ONE_OF_MANY
    assert fit.optimum.explored.one_of_many == fit.optimum.explored.points
    assert fit.verdict.level is Level.POOR
    assert "valves stay shut throughout the beat" in fit.verdict.reasons[0].sentence
    point = fits_object([fit.as_object()], settings.as_object())["points"][0]
    assert point["status"] == "one_of_many"
    assert "one of many" in fits_text({"points": [point]})
    with pytest.raises(NoSteadyBeatError):
        posterior(fit, settings=PosteriorSettings(method="gaussian"))


def test_a_fit_that_ends_where_valves_stay_shut_is_poor_and_trusted_nowhere(fit, shut):
    sealed = checked_by_simulation(replace(fit, case=shut))
    assert sealed.status is FitStatus.ONE_OF_MANY
    assert sealed.verdict.level is Level.POOR
    (reason,) = [r for r in sealed.verdict.doubts if r.aspect is Aspect.SEARCH]
    assert "no blood passes the tricuspid" in reason.sentence
    assert not any(p.identifiable for p in sealed.parameters.values())
    assert sealed.as_object()["status"] == "one_of_many"
    assert fit.status is FitStatus.FITTED


def test_a_study_leaves_out_patients_whose_fit_is_poor_or_ends_where_valves_stay_shut(points, monkeypatch):
    monkeypatch.setattr(cohort, "fit_cases", lambda cases, *_: [ended(name, case) for name, case in cases])
    points = [*points, CohortPoint("T01", "3", 4, points[0].case)]
    reading = SimpleNamespace(points=points, digest="abc", refusals={"line 5 (T02)": "SP: not a number"})

    def ended(name, case):
        shut, poor = name == points[0].name, name == points[2].name
        status = FitStatus.ONE_OF_MANY if shut else FitStatus.FITTED
        numbers = {"id": name, "cost": 0.1, "status": str(status), "message": status.message,
                   "verdict": {"level": "poor" if poor else "good",
                               "goodness": {"differences": {"MAP": 31.0}, "probability": 0.0}},
                   "parameters": {"Rmc": {"value": 0.8}}, "outputs": {"MAP": {"measured": 80.0}}}  # fmt: skip
        return SimpleNamespace(as_object=lambda: numbers, case=case, name=name, simulated={}, measured={})

    with Distribution().running() as executor:
        fitted = cohort.fit_points(reading, QUICK, folder=None, executor=executor)
    assert list(fitted.cases) == [points[1].name]
    assert "valves stay shut" in fitted.not_fitted[points[0].name]
    assert "31.0 standard uncertainties (MAP)" in fitted.not_fitted[points[2].name]
    assert fitted.not_fitted["line 5 (T02)"] == "SP: not a number"


def test_r_squared_is_one_minus_the_share_left_over():
    def point(**values):
        return {"outputs": {n: {"measured": m, "simulated": s} for n, (m, s) in values.items()}}

    results = [
        point(SP=(100.0, 98.0), DP=(60.0, 61.0), CO=(4.0, None)),
        point(SP=(80.0, 80.0), CO=(5.0, 5.0)),
    ]
    found = r_squared(results)
    measured = np.array([100.0, 60.0, 80.0])
    assert found["pressures"] == pytest.approx(1 - 5.0 / np.sum((measured - measured.mean()) ** 2))
    assert found["flows"] is None


def test_tables_and_json_of_a_fit(fit, tmp_path):
    content = fits_object([fit.as_object()], QUICK.as_object())
    write_fits(tmp_path, content)
    assert json.loads((tmp_path / "identification.json").read_text())["points"][0]["id"] == "T01"
    lines = (tmp_path / "parameters.csv").read_text().splitlines()
    assert lines[0].startswith("id,parameter,unit,value,lower,upper")
    assert lines[0].endswith("verdict,gaussian_lower,gaussian_upper,profile_lower,profile_upper")
    assert len(lines) == 3
    assert "good" in lines[1].split(",")
    outputs = (tmp_path / "outputs.csv").read_text().splitlines()
    assert len(outputs) == 1 + len(fit.simulated)
    assert outputs[0].startswith("id,output,unit,measured,simulated,lower,upper,determined,")
    assert any(line.startswith("T01,MAP,mmHg,") and line.endswith(",fitted,good") for line in outputs)


def test_the_table_has_the_interval_that_the_terminal_prints(fit, tmp_path):
    """It had the Gaussian one alone, which was 0.18 to 9 where 0.09 to 9 was printed."""
    point = fit.as_object()
    point["parameters"]["Rmc"] |= {"lower": 0.8, "upper": 0.9, "profile": [0.7, 0.85]}
    write_fits(tmp_path, fits_object([point], QUICK.as_object()))
    lines = (tmp_path / "parameters.csv").read_text().splitlines()
    (row,) = (row for row in csv.DictReader(lines) if row["parameter"] == "Rmc")
    assert (row["lower"], row["upper"]) == ("0.7", "0.9")
    assert (row["gaussian_lower"], row["gaussian_upper"]) == ("0.8", "0.9")
    printed = next(r for r in fits_text(fits_object([point], {})).splitlines() if r.startswith("Rmc"))
    assert printed.split()[2:4] == ["0.7", "0.9"]


@pytest.fixture(scope="module")
def of_pressure_alone(twin):
    assert twin.measurements is not None
    alone = twin.model_copy(update={"measurements": Measurements(MAP=twin.measurements.MAP)})
    return fit_case(alone, settings=replace(QUICK, parameters=("Rmc", "Emaxlv", "Edla")))


@pytest.mark.slow
def test_outputs_that_nothing_determines_are_named_and_make_a_fit_doubtful(of_pressure_alone):
    """Of one pressure a fit was good, and its cardiac output had four digits and no interval."""
    found = of_pressure_alone
    assert found.verdict.level is Level.DOUBTFUL
    (sentence,) = (r.sentence for r in found.verdict.doubts if r.about == "CO")
    assert sentence.startswith("not measured, and not determined by what was measured (90 %)")
    assert "measure CO" in sentence
    flow, truth = found.intervals["CO"], 4.9
    assert not flow.determined
    assert not found.intervals["PCWP"].determined
    assert found.intervals["MAP"].determined
    assert flow.low <= found.simulated["CO"] <= flow.high
    assert flow.low < truth < flow.high
    for warning in found.warnings:
        assert warning.endswith("one of many who meet the measurements") is not warning.startswith(
            "caution: "
        )
    text = fits_text(fits_object([found.as_object()], {}))
    (line,) = (line for line in text.splitlines() if line.startswith("CO "))
    assert line.split()[1:4] == ["L/min", "-", f"({found.simulated['CO']:.4g})"]
    assert "in brackets: the measurements do not determine it" in text


def test_outputs_that_follow_from_the_measured_ones_are_determined(fit):
    assert all(interval.determined for interval in fit.intervals.values())
    assert "in brackets" not in fits_text(fits_object([fit.as_object()], {}))


@pytest.mark.slow
def test_measurements_that_contradict_each_other_stay_in_the_verdict(twin):
    """The warning of the case file was gone from JSON, report and table."""
    more = twin.measurements.model_copy(update={"MPAP": 15.0, "PCWP": 21.0})
    found = fit_case(twin.model_copy(update={"measurements": more}), settings=QUICK)
    sentences = [r.sentence for r in found.verdict.doubts if r.about == "PCWP"]
    assert any("measured PCWP 21 mmHg is above the mean pulmonary artery pressure 15" in s for s in sentences)


@pytest.mark.slow
def test_a_missed_measurement_names_the_held_parameters_that_move_it(twin):
    """A chart was called wrong because the blood volume was held."""
    more = twin.measurements.model_copy(update={"MPAP": 32.0, "PCWP": 20.0})
    found = fit_case(twin.model_copy(update={"measurements": more}), settings=QUICK)
    (sentence,) = (r.sentence for r in found.verdict.doubts if r.sentence.startswith("PCWP depends on"))
    assert "held at usual values by this fit" in sentence
    assert "--free Rmc,Emaxlv," in sentence
    assert "fluid.extra_volume_ml" in sentence
    assert not any("set of parameters" in r.sentence for r in found.verdict.reasons)


@pytest.mark.slow
def test_the_interval_of_a_fit_holds_every_start_that_met_the_measurement_as_well():
    """A mean pressure alone: the derivatives at the fit gave Rmc 0.16 to 0.33, the truth being 0.5."""
    names = ("Rmc", "Emaxlv", "Rsvn", "Emaxrv")
    patient = {"id": "P", "sex": "male", "age_years": 50, "heart_rate_bpm": 95}
    truth = {"format": 1, "patient": patient, "parameters": {"Emaxlv": 1.0}}
    pressure = float(simulate(read_mapping(truth).case)["MAP"])
    case = read_mapping({"format": 1, "patient": patient, "measurements": {"MAP": pressure}}).case
    search = MultiStart(points_per_parameter=50, refined_share=0.06)
    found = fit_case(case, settings=FitSettings(names, weights="uncertainty", multi_start=search))
    starts = found.optimum.starts
    meets = starts.within_90(
        [found.objective.outputs.index("MAP")], np.array([pressure]), np.array([3.0]), 0.0
    )
    ends = starts.end[meets]
    assert len(ends) > 3
    for name, values in zip(names, found.box.scale.values(ends).T, strict=True):
        p = found.parameters[name]
        assert p.lower <= values.min() * (1.0 + 1e-9)
        assert values.max() <= p.upper * (1.0 + 1e-9)
        assert not p.identifiable
    assert found.parameters["Rmc"].upper > 0.5


@pytest.mark.slow
def test_the_interval_of_a_parameter_at_its_bound_holds_the_values_that_others_make_up_for():
    """Of 24 points with noise half missed the true Rpmc of 0.06 to 0.1: 0.005 to 0.044."""
    patient = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 90}
    truth = {"Rmc": 0.6, "Emaxlv": 0.5, "Rpmc": 0.07}
    ecmo = {"mode": "VA", "pump": "Rotaflow", "speed_rpm": 3200, "oxygenator": "Quadrox-i Adult"}
    content = {"format": 1, "patient": patient, "ecmo": ecmo}
    beat = simulate(read_mapping({**content, "parameters": truth}).case)
    names = ("SP", "DP", "MAP", "MPAP", "CO", "PF")
    measured = {name: float(beat[name]) for name in names} | {"MPAP": float(beat["MPAP"]) - 2.5}
    search = MultiStart(points_per_parameter=50, refined_share=0.06)
    settings = FitSettings(tuple(truth), weights="uncertainty", multi_start=search)
    found = fit_case(read_mapping({**content, "measurements": measured}).case, settings=settings)
    p = found.parameters["Rpmc"]
    assert p.at_bound
    assert p.lower == p.value == pytest.approx(0.005)
    assert p.upper > 0.07
    assert p.upper < 0.4


@pytest.mark.slow
def test_a_profile_finds_the_valley_that_no_start_of_the_search_ended_in():
    """V-A ECMO with noise: the arterial compliance was determined, 0.42 to 2.4; at 7.1 all is met as well."""
    measured = {"MAP": 61.79, "SP": 72.08, "DP": 55.52, "PF": 3.43, "CO": 1.73}
    case = read_mapping(
        {
            "format": 1,
            "patient": {
                "id": "P", "sex": "male", "age_years": 50, "height_cm": 178, "weight_kg": 80,
                "heart_rate_bpm": 95,
            },
            "ecmo": {
                "pump": "Rotaflow", "speed_rpm": 3200, "oxygenator": "Quadrox-i Adult", "mode": "VA",
                "drainage_fr": 25, "return_fr": 17,
            },
            "measurements": measured,
        }
    ).case  # fmt: skip
    search = MultiStart.quick(24)
    found = fit_case(case, settings=FitSettings(tuple(BOUNDS), weights="uncertainty", multi_start=search))
    assert found.parameters["Csart"].upper < 2.0
    judged, _ = with_profiles(found)
    assert judged.profile["Csart"][1] > 7.0
    assert not judged.parameters["Csart"].identifiable
    assert judged.parameters["Csart"].reason
