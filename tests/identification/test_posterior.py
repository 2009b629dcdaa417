"""From a fit to a posterior and its files."""

import itertools
import json
import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from eclsim.cases import read_case, write_case
from eclsim.cases.case import Case, Measurements, Patient
from eclsim.cases.quantities import with_values
from eclsim.cases.regulation import Regulation
from eclsim.cases.sections import Gas
from eclsim.execution import using_threads
from eclsim.files import NOTICE
from eclsim.identification.density import Prior
from eclsim.identification.draws import away_from_fit, doubts_of, piled_up, read_samples
from eclsim.identification.figures import plot_pairs, plot_predictive
from eclsim.identification.files import write_posterior
from eclsim.identification.fit import fit as fit_case
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.nuts import MissingPackageError
from eclsim.identification.objective import Box
from eclsim.identification.posterior import PosteriorSettings, posterior
from eclsim.identification.predictions import predict, predict_all
from eclsim.identification.report import posterior_text
from eclsim.identification.settings import FitSettings
from eclsim.identification.verdict import Aspect, Level, Reason
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate_many
from eclsim.outputs.uncertainty import Uncertainty
from eclsim.parameters.thiel2025 import BOUNDS, PARAMETERS
from eclsim.validation.reference_cases import PAPER_PATIENT, reference_model

NAMES = ("Rmc", "Emaxlv")
KNOWN = {name: PARAMETERS[name].value for name in BOUNDS if name not in NAMES}
CASE = Case(
    patient=Patient(id="example", sex="female", age_years=60, heart_rate_bpm=80),
    measurements=Measurements(SP=110, DP=75, MAP=88, CO=4.0),
    parameters=KNOWN,
)
QUICK = FitSettings(NAMES, multi_start=MultiStart(points_per_parameter=10, refined_share=0.2))


def faster(case):
    patient = case.patient.model_copy(update={"heart_rate_bpm": 100})
    return case.model_copy(update={"patient": patient})


def with_gas(case):
    return case.model_copy(update={"gas": Gas(fio2=0.6)})


@pytest.fixture(scope="module")
def fit():
    return fit_case(CASE, settings=QUICK)


@pytest.fixture(scope="module")
def result(fit):
    settings = PosteriorSettings(method="importance")
    return posterior(fit, settings=settings, predictions=[("patient.heart_rate_bpm=100", faster(fit.case))])


def test_draws_that_pile_up_at_a_bound_are_said_to_be_limited_by_it():
    """Both parameters at bounds that cut the posterior: R-hat 1.000 and nothing beside the intervals."""
    box = {"Rmc": (0.5, 0.3, 0.9), "Emaxlv": (1.0, 0.1, 10.0), "gas.shunt_fraction": (0.4, 0.0, 0.9)}
    z = np.random.default_rng(0).standard_normal((4, 500, 3))
    prior = Prior.within(Box.of(box))
    assert piled_up(prior, z) == ()
    z += np.array([2.0, 0.0, -3.0])
    (word,) = piled_up(prior, z)
    assert word.startswith("Rmc: 49% of the draws are in the last 2.5 %")
    assert "at the upper bound of 0.9: the bound limits it" in word


@pytest.mark.slow
def test_draws_that_leave_the_fit_out_are_said_to(result):
    """Two solutions, shunt 0.62 and 1.0: all draws were near the first, the fit was the second."""
    box = {"gas.shunt_fraction": (0.4, 0.0, 1.0), "Rmc": (0.5, 0.05, 5.0)}
    prior = Prior.within(Box.of(box))
    random = np.random.default_rng(0)
    x = prior.scale.coordinates(np.array([0.65, 0.57])) + [0.3, 0.1] * random.standard_normal((4000, 2))
    z, fitted = prior.z_of(prior.clip(x)), prior.scale.coordinates(np.array([[1.0, 0.57], [0.66, 0.7]]))
    (said,) = away_from_fit(prior, z[None], fitted[0])
    assert said.startswith("gas.shunt_fraction: no draw is near the fitted value of 1 (the nearest has 0.")
    assert away_from_fit(prior, z[None], fitted[1]) == ()
    at_bound = prior.z_of(np.column_stack([prior.upper[0] - np.abs(x[:, 0] - x[:, 0].mean()), x[:, 1]]))
    assert away_from_fit(prior, at_bound[None], fitted[0]) == ()
    assert not any("no draw is near" in note for note in result.notes)


@pytest.mark.slow
def test_parameters_lie_in_their_bounds_around_the_fit(fit, result):
    assert result.trusted
    for k, name in enumerate(NAMES):
        draws = result.flat[:, k]
        low, high = np.quantile(draws, (0.01, 0.99))
        assert low < fit.parameters[name].value < high
        assert draws.min() >= np.exp(fit.box.lower[k])
        assert draws.max() <= np.exp(fit.box.upper[k])


@pytest.mark.slow
def test_outputs_agree_with_the_measurements(result):
    first = result.predictions[0]
    for name, value in result.density.measured.items():
        low, middle, high = first.intervals[first.outputs.index(name)]
        assert low < middle < high
        assert abs(middle - value) < 2.0 * result.density.errors[name]
        assert high - low < 2 * 1.645 * 1.2 * result.density.errors[name]


@pytest.mark.slow
def test_prediction_at_another_heart_rate(fit, result):
    from eclsim.orbit.model import model_of
    from eclsim.outputs.results import simulate

    there = result.predictions[1]
    assert there.settings == "patient.heart_rate_bpm=100"
    simulated = float(simulate(model_of(faster(fit.case)))["CO"])
    low, _, high = there.intervals[there.outputs.index("CO")]
    assert low < simulated < high
    k = there.outputs.index("CO")
    gaussian = result.gaussian_predictions[1].intervals[k]
    assert gaussian == pytest.approx(there.intervals[k], rel=0.1)


@pytest.mark.slow
def test_draws_are_the_same_whatever_the_number_of_threads(fit, result):
    for count in (1, 3):
        with using_threads(count):
            again = posterior(fit, settings=result.settings)
        assert np.array_equal(again.samples, result.samples)
        assert np.array_equal(again.predictions[0].values, result.predictions[0].values, equal_nan=True)


@pytest.mark.slow
def test_surer_measurements_give_narrower_intervals(fit, result):
    sure = {n: Uncertainty(relative=0.01) for n in result.density.measured}
    narrow = posterior(fit, settings=PosteriorSettings(method="importance", uncertainties=sure))
    assert (np.std(np.log(narrow.flat), axis=0) < 0.6 * np.std(np.log(result.flat), axis=0)).all()


@pytest.mark.slow
def test_uncertainties_of_what_was_not_measured_are_refused(fit):
    """They change nothing: a misspelt name went unnoticed, with the draws of the default uncertainty."""
    for name in ("PCWP", "MAPP"):
        settings = PosteriorSettings(method="gaussian", uncertainties={name: Uncertainty(absolute=4.0)})
        with pytest.raises(CaseError, match=rf"{name}.*not measured.*allowed: SP, DP, MAP, CO"):
            posterior(fit, settings=settings)


@pytest.mark.slow
def test_without_numpyro_nothing_is_sampled_first(fit, monkeypatch):
    """Chains start from weighted draws: half a minute went by before it said what is missing."""
    monkeypatch.setitem(sys.modules, "numpyro.infer.hmc", None)
    done = []
    with pytest.raises(MissingPackageError, match=r"eclsim\[bayes\].*importance"):
        posterior(fit, progress=done.append)
    assert done == []


@pytest.mark.slow
def test_predictions_that_would_be_called_something_else_are_refused(fit):
    """An empty label made them "as measured"; with two of the same none could be chosen in the NetCDF."""
    there = faster(fit.case)
    for predictions, said in (([("", there)], "an empty label"), ([("a", there)] * 2, r'"a" is there twice')):
        with pytest.raises(ValueError, match=said):
            posterior(fit, settings=PosteriorSettings(method="gaussian"), predictions=predictions)


@pytest.mark.slow
def test_a_prediction_of_what_was_fitted_or_of_somebody_else_is_refused(fit):
    """The draws' own resistance was used in place of the one asked for; any patient could follow a fit."""
    asked = with_values(faster(CASE), {"Rmc": 2.0})
    other = CASE.model_copy(update={"patient": CASE.patient.model_copy(update={"id": "OTHER"})})
    settings = PosteriorSettings(method="gaussian")
    with pytest.raises(CaseError) as refused:
        posterior(fit, settings=settings, predictions=[("Rmc 2", asked), ("other", other)])
    of_fitted, of_patient = map(str, refused.value.mistakes)
    assert of_fitted.startswith('Rmc = 2: of the prediction "Rmc 2": it was fitted, so every draw has its')
    assert "as before the fit" in of_fitted
    assert of_patient.startswith('patient.id = "OTHER": of the prediction "other": not the patient who was')
    assert CASE.patient.id in of_patient
    with pytest.raises(ValueError, match='"as measured" is there twice'):
        posterior(fit, settings=settings, predictions=[("as measured", faster(CASE))])


@pytest.mark.slow
def test_predictions_are_labelled_with_the_draws_they_were_made_with(fit, result):
    """Every fourth draw was used, labelled 0, 1, 2 ...: joined to the parameters, correlations were lost."""
    tree = result.draws
    predicted = tree["predictions"]["MAP"].sel(settings="patient.heart_rate_bpm=100")
    assert predicted.dims == ("chain", "draw")
    assert predicted.draw.values[:3].tolist() == [0, 4, 8]
    assert np.array_equal(tree["posterior_predictive"]["MAP"]["draw"], predicted["draw"])
    chosen = predicted.isel(draw=[3, 500, 999])
    of = {n: tree["posterior"][n].sel(draw=chosen.draw).values.ravel() for n in NAMES}
    again = simulate_many(model_of(faster(fit.case)), of, ["MAP"])["MAP"].values
    assert chosen.values.ravel() == pytest.approx(again, rel=1e-6)


@pytest.mark.slow
def test_the_draws_say_what_was_assumed_and_what_was_warned_of(result):
    """A file of draws had the warnings at the measured settings only, and none of the notes."""
    tree = result.draws
    assert "the blood volume is held" in tree["posterior"].attrs["notes"]
    warnings = tree["predictions"]["warnings"]
    assert warnings.dims == ("settings",)
    assert [w.split("; ") for w in warnings.values] == [
        [part for w in p.warnings for part in w.split("; ")] or [""] for p in result.predictions
    ]
    assert "warnings" not in tree["predictions"].attrs


@pytest.mark.slow
def test_a_prediction_under_another_volume_policy_is_refused(fit):
    """It was computed under the policy of the fit, whatever the case says."""
    held = faster(fit.case).with_volume_policy("patient_held")
    said = r"blood_volume_policy = patient_held: of the prediction.*as_published"
    with pytest.raises(CaseError, match=said):
        posterior(fit, settings=PosteriorSettings(method="gaussian"), predictions=[("held", held)])


@pytest.mark.slow
def test_a_prediction_without_a_section_of_the_fitted_parameters_is_named(fit):
    blood = replace(
        fit, settings=replace(fit.settings, parameters=("Rmc", "gas.fio2")), case=with_gas(fit.case)
    )
    with pytest.raises(ValueError, match=r'prediction "no gas": fio2: the case has no \[gas\] section'):
        posterior(blood, settings=PosteriorSettings(method="gaussian"), predictions=[("no gas", CASE)])


@pytest.mark.slow
def test_a_reflex_that_is_switched_on_for_a_prediction_has_the_set_point_of_the_patient(fit, tmp_path):
    """It had that of the case before the fit: a mean pressure of 88 fell to that of a healthy person."""
    write_case(CASE, tmp_path / "patient.toml")
    reflex = read_case(tmp_path / "patient.toml", ["regulation.baroreflex=1"]).case
    settings = PosteriorSettings(method="gaussian")
    measured, there = posterior(fit, settings=settings, predictions=[("reflex", reflex)]).predictions
    k = measured.outputs.index("MAP")
    assert 88.0 < there.intervals[k, 1] < measured.intervals[k, 1]


@pytest.mark.slow
def test_a_prediction_takes_its_draws_from_all_chains(fit, result):
    """Of two chains of 800 draws the first thousand were taken: all of one chain, a quarter of the other."""
    chains = np.repeat([[[0.4, 1.0]], [[0.8, 1.0]]], 800, axis=1)
    (found,) = predict_all([("", model_of(fit.case))], result.density, chains)
    pressures, counts = np.unique(found.column("MAP").round(2), return_counts=True)
    assert len(found.values) == 1000
    assert len(pressures) == 2
    assert counts.tolist() == [500, 500]


@pytest.mark.slow
def test_draws_of_a_reflex_belong_to_the_fitted_case_only(tmp_path):
    """With the file that was fitted every draw got a set point of its own, and nothing said so."""
    reflex = CASE.model_copy(update={"regulation": Regulation(baroreflex=1.0)})
    fitted = fit_case(reflex, settings=QUICK)
    write_posterior(tmp_path, posterior(fitted, settings=PosteriorSettings(method="gaussian")))
    for file in ("samples.csv", "posterior.nc"):
        own, others = (" ".join(doubts_of(tmp_path / file, case)) for case in (fitted.case, reflex))
        assert "leaves open" not in own
        assert (
            "its draws were fitted with regulation.set_point_mmHg = 88, which the case leaves open" in others
        )


@pytest.mark.slow
def test_every_prediction_says_that_its_fit_is_doubtful(fit):
    """At the measured settings alone it was said."""
    doubt = Reason(Aspect.AGREEMENT, Level.DOUBTFUL, "CO", "CO is 3 standard uncertainties from it")
    there = faster(CASE)
    settings = PosteriorSettings(method="gaussian")
    found = posterior(fit.judged([doubt]), settings=settings, predictions=[("100 bpm", there)])
    assert ["DOUBTFUL fit" in " ".join(p.warnings) for p in found.predictions] == [True, True]


def labels(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.mark.slow
def test_names_of_outputs_do_not_run_into_each_other(result):
    """The names of the pressures of a circuit were written over those of the next panels."""
    names = (
        "drainage_pressure",
        "pump_inlet_pressure",
        "pre_oxygenator_pressure",
        "post_oxygenator_pressure",
    )
    renamed = [replace(p, outputs=names, values=p.values[:, :4]) for p in result.predictions]
    figure = plot_predictive(replace(result, predictions=tuple(renamed), gaussian_predictions=tuple(renamed)))
    figure.draw_without_rendering()
    spans = [ax.xaxis.label.get_window_extent() for ax in figure.axes if ax.get_xlabel()]
    assert len(spans) == 4
    assert all(left.x1 < right.x0 for left, right in itertools.pairwise(spans))
    assert spans[-1].x1 <= figure.bbox.x1


@pytest.mark.slow
def test_draws_are_called_what_they_are(result):
    assert labels(plot_predictive(result))[:2] == [
        "posterior (weighted draws): median and 90 %", "Gaussian approximation, unchecked",
    ]  # fmt: skip
    table = posterior_text(result.as_object())
    assert "Gaussian" not in table
    assert f"{result.weighted.effective:.0f} effective draws, Pareto k {result.weighted.shape:.2f}" in table
    heads = [line.split() for line in table.splitlines() if line.startswith("output")]
    assert heads == [["output", "unit", "median", "5", "%", "95", "%"]] * 2
    assert "patient.heart_rate_bpm=100: posterior (weighted draws)" in table


@pytest.mark.slow
def test_the_gaussian_approximation_is_never_called_posterior(fit):
    found = posterior(fit, settings=PosteriorSettings(method="gaussian"))
    assert not found.trusted
    assert found.verdict == "NOT CHECKED"
    assert found.predictions is found.gaussian_predictions
    assert labels(plot_predictive(found))[0] == "Gaussian approximation, unchecked: median and 90 %"
    for figure in (plot_predictive(found), plot_pairs(found)):
        assert "posterior" not in figure.get_suptitle()
    assert "posterior" not in posterior_text(found.as_object()).replace("against the posterior", "")


@pytest.mark.slow
def test_doubts_stand_beside_every_prediction(result):
    doubted = replace(result, doubts=("Pareto k of the weights is 0.83 (below 0.7): sample with chains",))
    table = posterior_text(doubted.as_object())
    assert table.count("NOT TO BE TRUSTED:\n  Pareto k of the weights is 0.83") == 3


@pytest.mark.slow
def test_the_verdict_on_the_fit_is_not_repeated_under_each_prediction(result):
    verdict = "its parameters are a DOUBTFUL fit of eclsim identify: see why in its report"
    first, second = result.predictions
    warned = replace(second, warnings=(verdict, "MAP 50.0 mmHg is below 55 mmHg"))
    table = posterior_text(replace(result, predictions=(first, warned)).as_object())
    assert "At the medians of the draws: MAP 50.0 mmHg" in table
    assert verdict not in table


@pytest.mark.slow
def test_draws_without_a_steady_beat_are_counted_and_doubted(result):
    first, second = result.predictions
    few, many = replace(second, without_beat=0.004), replace(second, without_beat=0.05)
    assert not few.doubts
    assert many.number(many.without_beat) == 50
    doubted = replace(result, predictions=(first, many))
    table = posterior_text(doubted.as_object())
    assert [text.get_text() for text in plot_predictive(doubted).axes[0].get_yticklabels()] == [
        "as measured", "patient.heart_rate_bpm=\n100\nNOT TO BE TRUSTED",
    ]  # fmt: skip
    trusted, not_trusted = doubted.draws["predictions"]["doubts"].values.tolist()
    assert trusted == ""
    assert not_trusted.startswith("50 of 1000 draws have no steady heartbeat at these settings")
    assert "50 of 1000 draws have no steady heartbeat there and are not counted" in table
    assert table.count("NOT TO BE TRUSTED") == 1
    explored_without_gases = replace(second, without_gases=0.05)
    assert "50 of 1000 draws have no steady gas state" in explored_without_gases.doubts[0]
    assert "intervals of gases cover only the other draws" in explored_without_gases.doubts[0]
    assert "there are no intervals of gases" in replace(second, without_gases=1.0).doubts[0]
    table = posterior_text(replace(result, predictions=(first, explored_without_gases)).as_object())
    assert "50 of 1000 draws have no steady gas state there (excluded from gases)" in table
    outputs = result.weighted.outputs.copy()
    outputs[:3] = np.nan
    lost = replace(result, weighted=replace(result.weighted, outputs=outputs))
    assert f"3 of the {len(outputs)} weighted draws have no steady heartbeat" in posterior_text(
        lost.as_object()
    )


@pytest.mark.slow
def test_draws_that_no_patient_can_have_are_counted_and_in_no_interval():
    """At this speed half of the draws have a chamber without blood; their MAP is some 10 mmHg higher."""
    from eclsim.simulation.single import simulate_many

    model = reference_model(PAPER_PATIENT).with_values({"ecmo.speed_rpm": 5500.0})
    rng = np.random.default_rng(1)
    draws = {n: model.values[n] * np.exp(0.3 * rng.standard_normal(7)) for n in ("Rmc", "Csvn")}
    prediction = predict(model, draws, ("MAP",), "ecmo.speed_rpm=5500")
    beats = simulate_many(model, draws, ["MAP"])
    impossible = (beats["impossible"] == 1).to_numpy()
    number, lost = (prediction.number(share) for share in (prediction.impossible, prediction.without_beat))
    assert 0 < number < 7
    assert np.isnan(prediction.values[impossible]).all()
    assert np.isfinite(prediction.values).sum() == 7 - number - lost
    assert f"{number} of 7 draws are beats that no patient can have" in " ".join(prediction.doubts)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"method": "NUTS"}, 'method = "NUTS"; allowed: nuts, '),
        ({"prior": "flat"}, 'prior = "flat"; allowed: log-un'),
    ],
)
def test_a_method_or_prior_that_there_is_not_is_refused(wrong, said):
    """Any other prior was sampled as log-normal, any other method as weighted draws."""
    with pytest.raises(ValueError, match=said):
        PosteriorSettings(**wrong)


@pytest.mark.slow
def test_a_posterior_of_patients_that_cannot_be_is_not_trusted(result):
    first, second = result.predictions
    assert result.as_object()["predictions"][0]["draws_impossible"] == 0
    impossible = replace(first, impossible=0.05)
    assert "50 of 1000 draws are beats that no patient can have" in impossible.warning_of_impossible_beats[0]
    assert not first.warning_of_impossible_beats
    table = posterior_text(replace(result, predictions=(first, replace(second, impossible=0.05))).as_object())
    assert "50 of 1000 draws are beats that no patient can have" in table
    assert table.count("NOT TO BE TRUSTED") == 1


@pytest.mark.slow
def test_predictions_of_a_poor_fit_are_not_trusted(fit):
    poor = fit.judged(
        [Reason(Aspect.AGREEMENT, Level.POOR, "CO", "CO is 6 standard uncertainties from the measurement")]
    )
    found = posterior(poor, settings=PosteriorSettings(method="gaussian"))
    assert found.verdict == "NOT TO BE TRUSTED"
    assert any("POOR FIT" in doubt for doubt in found.doubts)


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    """Everything that is written of a posterior."""
    folder = tmp_path_factory.mktemp("posterior")
    written = write_posterior(folder, result)
    assert {p.name for p in written} >= {"posterior.nc", "samples.csv", "posterior.json", "pairs.png"}
    return folder


@pytest.mark.slow
def test_files(folder):
    content = json.loads((folder / "posterior.json").read_text())
    assert content["trusted"] is True
    assert (
        content["predictions"][1]["outputs"]["CO"]["lower"]
        < content["predictions"][1]["outputs"]["CO"]["upper"]
    )


@pytest.mark.slow
def test_samples_are_what_the_crrt_study_reads(result, folder):
    samples = read_samples(folder / "samples.csv")
    assert set(samples) == set(NAMES)
    assert len(samples["Rmc"]) == 1000
    assert np.median(samples["Rmc"]) == pytest.approx(np.median(result.flat[:, 0]), rel=0.05)


@pytest.mark.slow
def test_the_netcdf_holds_the_draws_and_states_version_and_intended_use_in_every_group(result, folder):
    """`intended_use`, which every NetCDF file has, was missing."""
    with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as written:
        groups = {node.path: node.to_dataset(inherit=False).load() for node in written.subtree}
    assert {*groups} == {node.path for node in result.draws.subtree}
    for path, data in groups.items():
        assert data.attrs == result.draws[path].attrs | {"intended_use": NOTICE}
        xr.testing.assert_equal(data, result.draws[path].to_dataset(inherit=False))
    columns = read_samples(folder / "posterior.nc")
    count = result.flat.shape[0]
    assert columns["Rmc"] == result.flat[:: -(-count // 1000), 0].tolist()


@pytest.mark.slow
def test_arviz_opens_the_netcdf(result, folder):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about a coming version
        arviz = pytest.importorskip("arviz")
        data = arviz.from_netcdf(folder / "posterior.nc")
        posterior = data["posterior"]
        assert np.asarray(posterior["Rmc"]) == pytest.approx(result.samples[:, :, 0])
        assert posterior["Rmc"].dims == ("chain", "draw")
        assert float(np.asarray(data["observed_data"]["CO"])) == 4.0
        assert list(np.asarray(data["predictions"]["settings"])) == [
            "as measured",
            "patient.heart_rate_bpm=100",
        ]
        summary = arviz.summary(data, var_names=list(NAMES))
        tree = result.draws
        taken = arviz.from_datatree(tree) if hasattr(arviz, "from_datatree") else tree  # as docs/python.md
        direct = arviz.summary(taken, var_names=list(NAMES))
    assert set(summary.index) == set(NAMES)
    assert direct["mean"].to_dict() == summary["mean"].to_dict()


@pytest.mark.slow
def test_chains_agree_with_weighted_draws(fit, result):
    pytest.importorskip("numpyro")
    from eclsim.identification.nuts import Sampling

    sampled = posterior(
        fit, settings=PosteriorSettings(sampling=Sampling(chains=4, warmup=100, draws=120, seed=1))
    )
    assert sampled.diagnostics is not None
    assert sampled.diagnostics.r_hat.max() < 1.05
    assert sampled.diagnostics.divergent <= 10
    spread = np.std(np.log(result.flat), axis=0)
    away = np.mean(np.log(sampled.flat), axis=0) - np.mean(np.log(result.flat), axis=0)
    assert np.abs(away / spread).max() < 0.25
    assert np.std(np.log(sampled.flat), axis=0) == pytest.approx(spread, rel=0.2)
