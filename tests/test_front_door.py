"""Python's front door: what is of another kind is refused with what is allowed."""

import json
from fractions import Fraction

import jax
import numpy as np
import pytest

import eclsim
from eclsim import blood
from eclsim.cases.reading import read_mapping, write_case
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.steady import ADAPTIVE

CASE = read_mapping(
    {
        "format": 1,
        "patient": {"id": "P", "sex": "male", "age_years": 50, "heart_rate_bpm": 95},
        "measurements": {"MAP": 70.0, "CO": 3.0},
    }
).case


@pytest.mark.parametrize("points", ["series.csv", CASE, [CASE], [("a", CASE, 1)]])
def test_what_is_no_series_of_names_and_cases_is_refused(points):
    with pytest.raises(CaseError, match="not a pair of name and case; allowed: a list of names with cases"):
        eclsim.track(points)


@pytest.mark.parametrize(("given", "words"), [(1, "1"), (np.datetime64("2024-03-01"), "a datetime64")])
def test_a_name_of_a_measurement_is_a_text(given, words):
    """It was "a tuple is not a pair of name and case"."""
    with pytest.raises(
        CaseError, match=rf"points: {words} is not a name; allowed: a list of names with cases"
    ):
        eclsim.track([(given, CASE)])


def test_an_unknown_type_of_cannula_is_refused():
    """It was KeyError: 'venus'."""
    with pytest.raises(ValueError, match=r'return_cannula = "venus"; allowed: .*did you mean venous'):
        eclsim.ecmo("ra", "ra", return_cannula="venus")


@pytest.mark.parametrize(
    ("ask", "kind"),
    [
        (lambda given: eclsim.fit(CASE, settings=given), "FitSettings"),
        (lambda given: eclsim.track([("a", CASE)], settings=given), "TrackSettings"),
        (lambda given: eclsim.sensitivity(CASE, settings=given), "SobolSettings"),
        (
            lambda given: eclsim.posterior(CASE, settings=given),  # pyright: ignore[reportArgumentType]
            "PosteriorSettings",
        ),
    ],
)
def test_settings_of_another_kind_are_refused(ask, kind):
    with pytest.raises(TypeError, match=rf"a dict is not a {kind}; allowed: eclsim\.{kind}\(\.\.\.\)"):
        ask({"parameters": ("Rmc",)})


def test_a_posterior_is_that_of_a_fit():
    with pytest.raises(TypeError, match=r"a Case is not a fit; allowed: what eclsim\.fit\(case\) returns"):
        eclsim.posterior(CASE)  # pyright: ignore[reportArgumentType]  # on purpose


def test_variants_have_one_dimension():
    with pytest.raises(ValueError, match="Rmc: an array of 2 x 3; allowed: a number, or one for each"):
        eclsim.simulate_many(CASE, {"Rmc": np.full((2, 3), 0.5)})


@pytest.mark.parametrize("changes", [[1, 2], None, "ecmo.speed_rpm=3000", [{"Rmc": 1.0}]])
def test_changes_are_numbers_by_parameter(changes):
    """It was "'int' object has no attribute 'strip'"."""
    with pytest.raises(TypeError, match=r"changes: .* names no parameter; allowed: numbers by parameter"):
        eclsim.simulate_many(CASE, changes)


def test_a_change_that_is_no_number_is_named():
    with pytest.raises(TypeError, match='Rmc: "a" is not a number'):
        eclsim.simulate_many(CASE, {"Rmc": ["a"]}, outputs=["MAP"])


def test_one_text_is_one_name():
    """It was read letter by letter: 'R' is no parameter."""
    slopes = eclsim.derivatives(CASE, "MAP", "Rmc")
    assert slopes.shape == (1, 1)
    assert slopes.coords["parameter"].values.tolist() == ["Rmc"]
    assert eclsim.identifiability(CASE, parameters="Rmc", outputs="MAP").scaled.parameters == ("Rmc",)
    assert eclsim.FitSettings(parameters="Rmc").names == ("Rmc",)  # pyright: ignore[reportArgumentType]
    assert eclsim.SobolSettings(parameters="Rmc", outputs="MAP").parameters == ("Rmc",)


@pytest.mark.parametrize("names", [None, 5, [5]])
def test_what_is_no_name_is_refused(names):
    with pytest.raises(TypeError, match="is not a name; allowed: names such as"):
        eclsim.derivatives(CASE, ["MAP"], names)


def test_derivatives_of_nothing_are_refused():
    """It was "cannot reshape array of size 0"."""
    with pytest.raises(ValueError, match="no outputs or no parameters for derivatives"):
        eclsim.derivatives(CASE, [], [])


MODEL = eclsim.model_of(CASE)


@pytest.mark.parametrize(
    ("ask", "kind", "sentence"),
    [
        (lambda: eclsim.simulate(MODEL, solver="rk4"), ValueError, 'solver = "rk4"; allowed: semi-implicit'),
        (
            lambda: eclsim.simulate(MODEL, resolution=10**7),
            ValueError,
            "resolution = 10000000; allowed: 1 to 32",
        ),
        (lambda: eclsim.simulate(MODEL, resolution=0), ValueError, "resolution = 0; allowed: 1 to 32"),
        (lambda: eclsim.simulate(MODEL, resolution=1.5), TypeError, "resolution = 1.5: not a whole number"),
        (
            lambda: eclsim.simulate(MODEL, options={"tolerance": 1}),
            TypeError,
            "a dict is not an OrbitOptions",
        ),
        (lambda: eclsim.simulate(MODEL, check_grid="no"), TypeError, 'check_grid = "no"; allowed: True or'),
        (
            lambda: eclsim.simulate(MODEL, resolution=2, solver=ADAPTIVE),
            ValueError,
            "the adaptive solver takes no options and no resolution",
        ),
        (lambda: eclsim.OrbitOptions(tolerance=-1), ValueError, "tolerance = -1; allowed: above 0"),
        (lambda: eclsim.Execution(width=2.0), TypeError, "width = 2: not a whole number; allowed: 1 or more"),
        (
            lambda: eclsim.simulate_many(MODEL, {"Rmc": [0.8]}, execution=2),
            TypeError,
            "an int is not an Execution",
        ),
        (
            lambda: eclsim.simulate(MODEL.circuit),
            TypeError,
            r"a Circuit is not a case.*eclsim\.Model\.published",
        ),
        (lambda: MODEL.with_values(Rmc="0.8"), TypeError, 'Rmc = "0.8": not a number'),
        (lambda: MODEL.with_values(Rmc=[0.8, 0.9]), TypeError, "Rmc = a list: not a number"),
        (lambda: MODEL.with_values(["Rmc"]), TypeError, "a list names no parameter"),
        (lambda: eclsim.Model(CASE, {}), TypeError, "circuit = a Case; allowed: a Circuit"),
        (lambda: MODEL.circuit + None, TypeError, "unsupported operand"),
        (lambda: eclsim.read_case(3), TypeError, "3 is not a path; allowed: the path of a case file"),
        (lambda: eclsim.read_case("x.toml", {"Rmc": 1}), TypeError, "a dict is not a list of settings"),
        (lambda: eclsim.draw_circuit(CASE), TypeError, "circuit = a Case; allowed: a Circuit, such as"),
        (
            lambda: eclsim.plot_waveforms(None),
            TypeError,
            "None cannot be drawn; allowed: the beat of one case",
        ),
        (lambda: eclsim.Shard(3, 2), eclsim.ExecutionError, "shard 3/2: allowed: a number from 1 to 2"),
        (lambda: eclsim.Distribution(workers="2"), TypeError, 'workers = "2": not a whole number'),
        (lambda: eclsim.SobolSettings(samples=4.0), TypeError, "samples = 4: not a whole number"),
        (lambda: eclsim.SobolSettings(second_order="no"), TypeError, 'second_order = "no"; allowed: True'),
        (
            lambda: eclsim.sensitivity(CASE, settings=eclsim.SobolSettings(samples=4, outputs=[])),
            eclsim.InputError,
            "no output given",
        ),
        (
            lambda: eclsim.sensitivity(CASE, settings=eclsim.SobolSettings(samples=4), folder=__file__),
            eclsim.ExecutionError,
            "the folder cannot be created",
        ),
        (
            lambda: eclsim.FitSettings(weights="absolute"),
            ValueError,
            'weights = "absolute"; allowed: relative',
        ),
        (
            lambda: eclsim.FitSettings(bounds={"Rmc": 0.5}),
            TypeError,
            'bounds of "Rmc" = 0.5; allowed: lower and',
        ),
        (lambda: eclsim.FitSettings(uncertainties={"MAP": 2}), eclsim.InputError, r"eclsim\.Uncertainty\(3"),
        (
            lambda: eclsim.FitSettings(multi_start=10),
            TypeError,
            r"multi_start = 10; allowed: eclsim\.MultiStart",
        ),
        (lambda: eclsim.MultiStart(round_size=0), ValueError, "round_size = 0; allowed: 1 or more"),
        (
            lambda: eclsim.Sampling(target_accept=2),
            ValueError,
            "target_accept = 2; allowed: above 0 up to 0.99",
        ),
        (lambda: eclsim.PosteriorSettings(sampling={}), TypeError, "sampling = a dict; allowed"),
        (lambda: eclsim.TrackSettings(drifts=()), ValueError, "drifts: none given; allowed: numbers above 0"),
        (
            lambda: eclsim.track([("a", CASE)], left_out=[1, 2]),
            ValueError,
            "left_out: 2 numbers for 1 points; allowed: one for each",
        ),
        (lambda: eclsim.CourseOptions(predictor="x"), ValueError, 'predictor = "x"; allowed: secant'),
        (lambda: eclsim.course(CASE, minutes="2"), TypeError, 'minutes = "2": not a number'),
        (
            lambda: eclsim.course(CASE, minutes=2, every_min=1e-9),
            eclsim.CaseError,
            "moments; allowed: up to 20000",
        ),
        (
            lambda: eclsim.course(CASE, minutes=2, every_min=0),
            ValueError,
            "every_min = 0; allowed: above 0 min",
        ),
        (lambda: eclsim.course_cohort(CASE, minutes=1), TypeError, "a Case is not a list of cases"),
        (
            lambda: eclsim.course_band(CASE, {"Rmc": 0.8}, minutes=1),
            TypeError,
            "samples of Rmc: 0.8; allowed: lists",
        ),
        (lambda: eclsim.reach(CASE, 3), eclsim.GoalError, "3 is not a goal; allowed: goals such as MAP > 65"),
        (lambda: eclsim.reach(CASE, "MAP > 65", vary=[]), eclsim.GoalError, "no setting to vary; allowed"),
        (
            lambda: eclsim.reach(CASE, "MAP > 65", vary=[eclsim.Setting("Rmc", 2, 1)]),
            eclsim.GoalError,
            "Rmc: from 2 to 1; the first must be smaller",
        ),
        (
            lambda: eclsim.reach(CASE, [eclsim.Goal("MAP")]),
            eclsim.GoalError,
            "MAP: a goal without a finite bound",
        ),
        (
            lambda: eclsim.crrt_study(CASE, schemes=3),
            eclsim.SchemeError,
            "3 is not a scheme; allowed: letters",
        ),
    ],
)
def test_what_cannot_be_meant_ends_in_one_sentence(ask, kind, sentence):
    """They were deep tracebacks, ended the process, ran for ever, or were passed over."""
    with pytest.raises(kind, match=sentence):
        ask()


@pytest.mark.parametrize(
    "given",
    [
        ["0.8"],
        "0.8",
        np.array(["2020-01-01"], dtype="datetime64[D]"),
        [True, False],
        [True, 0.8],
        np.bool_(True),
        [[0.8], [0.9, 1.0]],
        (one for one in (0.8, 0.9)),
    ],
)
def test_a_change_that_is_no_number_is_refused(given):
    """A date was counted in days since 1970, and truth as 1."""
    with pytest.raises(TypeError, match=r"Rmc: .* is not a number or a list of numbers"):
        eclsim.simulate_many(MODEL, {"Rmc": given}, outputs=["MAP"])


@pytest.mark.parametrize(
    ("given", "kind", "sentence"),
    [
        (np.bool_(True), TypeError, "Rmc = a bool: not a number"),
        (np.ma.masked, TypeError, "Rmc = a MaskedConstant: not a number"),
        (10**400, ValueError, "Rmc = a number of over 40 digits: too large"),
        (Fraction(10**400), ValueError, "Rmc = a Fraction: too large"),
        (np.array([0.8, 0.9]), TypeError, "Rmc = a.* ndarray: not a number; allowed: one number"),
    ],
)
def test_a_value_that_is_not_one_finite_number_is_refused(given, kind, sentence):
    """NumPy's True was 1, a masked number NaN, and large integers ended in an OverflowError."""
    with pytest.raises(kind, match=sentence):
        MODEL.with_values(Rmc=given)


def test_a_number_too_large_for_a_variant_is_refused():
    with pytest.raises(ValueError, match="Rmc: a number is too large"):
        eclsim.simulate_many(MODEL, {"Rmc": [0.8, 10**400]}, outputs=["MAP"])


@pytest.mark.parametrize("transform", [jax.jit, jax.grad])
def test_transformations_of_jax_are_pointed_to_derivatives(transform):
    """They ended in a message about a DynamicJaxprTracer."""
    sentence = "Rmc: jax.jit and jax.grad cannot pass through .* eclsim.derivatives gives exact derivatives"
    with pytest.raises(TypeError, match=sentence):
        transform(lambda x: eclsim.simulate(MODEL.with_values(Rmc=x))["MAP"].values)(0.5)
    with pytest.raises(TypeError, match=sentence):
        transform(lambda x: eclsim.simulate_many(MODEL, {"Rmc": x}, outputs=["MAP"])["MAP"].values)(0.5)
    with pytest.raises(TypeError, match=sentence):
        transform(lambda x: eclsim.simulate_many(MODEL, {"Rmc": [x]}, outputs=["MAP"])["MAP"].values)(0.5)


def test_what_is_masked_is_missing():
    """The number under the mask was simulated."""
    masked = np.ma.masked_array([0.8, 0.9], [False, True])
    many = eclsim.simulate_many(MODEL, {"Rmc": masked}, outputs=["MAP"])
    assert many["status"].values.tolist() == ["converged", "invalid_input"]


def test_numbers_of_any_library_are_numbers():
    frame = eclsim.simulate_many(MODEL, {"Rmc": np.float32(0.5)}, outputs=["MAP"])
    plain = eclsim.simulate(MODEL.with_values(Rmc=np.array([0.5])))
    assert float(frame["MAP"][0]) == float(plain["MAP"])
    width = eclsim.Execution(width=np.int64(2), threads=np.int32(1))
    assert (type(width.width), type(width.threads)) == (int, int)


def test_a_course_refuses_a_parameter_that_it_does_not_read():
    """The variants were all the case itself."""
    with pytest.raises(eclsim.CaseError, match="Rmcc: the course of this case has no such parameter"):
        eclsim.course_many(CASE, {"Rmcc": [0.5, 1.0]}, minutes=1)


def test_one_text_is_one_setting(tmp_path):
    write_case(CASE, tmp_path / "a.toml")
    assert eclsim.read_case(tmp_path / "a.toml", "Rmc=0.8").case.parameters == {"Rmc": 0.8}


def test_a_model_is_made_of_whatever_is_a_case(tmp_path):
    write_case(CASE, tmp_path / "a.toml")
    reading = eclsim.read_case(tmp_path / "a.toml")
    assert eclsim.model_of(reading).values == eclsim.model_of(tmp_path / "a.toml").values == MODEL.values


def test_a_misspelt_function_lists_its_neighbours():
    with pytest.raises(AttributeError) as error:
        _ = eclsim.simulat
    assert (error.value.name, error.value.obj) == ("simulat", eclsim)  # what tracebacks make suggestions of


@pytest.mark.slow
def test_results_say_in_a_line_what_they_are():
    """Notebooks showed every array and the whole circuit: 5,000 to 27,000 characters."""
    batch = eclsim.Batch.of(MODEL)
    assert repr(MODEL).startswith("<Model P: 10 compartments")
    assert repr(batch).startswith("<Batch of 1:")
    assert repr(eclsim.steady_beat(batch, ["MAP"])).startswith("<SteadyBeat of 1, 1 converged: MAP")
    search = eclsim.MultiStart(points_per_parameter=4, refined_share=1.0)
    fit = eclsim.fit(CASE, settings=eclsim.FitSettings(("Rmc",), multi_start=search))
    assert repr(fit).startswith(
        f"<FitResult P: Rmc = {fit.parameters['Rmc'].value:.3g}; {fit.verdict.headline}"
    )
    few = eclsim.SobolSettings(samples=4, parameters=["Rmc"], outputs=["MAP"])
    assert repr(eclsim.sensitivity(CASE, settings=few)) == "<SensitivityResult of 4 rows: MAP by Rmc>"
    found = eclsim.identifiability(CASE, parameters=["Rmc"])
    assert repr(found) == "<Identifiability P: of 1 parameters, to fit: Rmc>"
    reached = eclsim.reach(CASE, "MAP > 60", vary="Rmc=0.2..2")
    assert repr(reached) == f"<Reached P: {reached.message}>"


def test_a_setting_without_its_unit_is_in_that_of_its_parameter():
    turned = [eclsim.Setting("Rmc", 0.2, 2.0)]
    assert eclsim.reach(CASE, "MAP > 60", vary=turned).settings[0].unit == "mmHg s/mL"


def test_settings_take_numbers_of_other_libraries_and_refuse_mistakes_at_once():
    """Bounds of NumPy were kept, so results could not be written as JSON; a wrong prior was found later."""
    bounds = {"Rmc": np.array([0.25, 2.0], dtype=np.float32)}
    settings = eclsim.FitSettings(("Rmc",), bounds=bounds)
    bounds.clear()
    assert json.loads(json.dumps(settings.as_object()))["bounds"] == {"Rmc": [0.25, 2.0]}
    with pytest.raises(ValueError, match='prior = "x"; allowed: log-uniform, log-normal'):
        eclsim.TrackSettings(prior="x")  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match=r'po2 = "90": a text; allowed: a number'):
        blood.gases(po2="90", pco2=40.0)  # pyright: ignore[reportArgumentType]
    with pytest.raises(eclsim.GoalError, match="'' lacks a name; allowed: names with commas between"):
        eclsim.reach(CASE, "MAP > 65", vary="")


@pytest.mark.slow
def test_scripts_with_unusual_but_legal_arguments():
    """Names given twice ended in a broadcasting error, an empty batch had numbers for texts."""
    ecmo = {"mode": "VA", "pump": "Rotaflow", "oxygenator": "Quadrox-i Adult", "flow_l_min": 3.0}
    flow = read_mapping(CASE.as_mapping() | {"ecmo": ecmo}).case
    twice = eclsim.derivatives(flow, ["MAP", "MAP"], ["Rmc", "ecmo.flow_l_min", "Rmc"])
    once = eclsim.derivatives(flow, ["MAP"], ["Rmc", "ecmo.flow_l_min"])
    assert twice.values.tolist() == [once.values[0, [0, 1, 0]].tolist()] * 2
    with pytest.raises(ValueError, match="no outputs or no parameters for derivatives"):
        eclsim.derivatives(flow, ["MAP"], [])
    nothing = eclsim.simulate_many(MODEL, {"Rmc": []}, outputs=["MAP"])
    kinds = {name: nothing[name].dtype.kind for name in ("status", "message", "warnings", "impossible")}
    assert kinds == {"status": "U", "message": "U", "warnings": "U", "impossible": "i"}
    lost = eclsim.simulate_many(flow, {"ecmo.flow_l_min": [np.nan]}, outputs=["MAP"])
    assert str(lost["message"].values[0]) == "ecmo.flow_l_min = nan is not a finite number"
    with pytest.raises(eclsim.UnknownValueError, match=r"no parameter 'parameters.Rmc'; did you mean Rmc"):
        eclsim.simulate_many(MODEL, {"parameters.Rmc": [0.8]})
    with pytest.raises(TypeError, match=r'Rmc: "0\.8" is not a number or a list of numbers'):
        eclsim.simulate_many(MODEL, {"Rmc": [0.5, "0.8"]})
