import math
import tomllib

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.outputs.uncertainty import DEFAULTS, Uncertainty, standard_uncertainties
from eclsim.sensitivity.identifiability import (
    ScaledSensitivities,
    _in_words,
    all_subsets,
    fisher_information,
    identifiability,
    propose,
    relative_errors,
)
from eclsim.sensitivity.inputs import InputError, read_uncertainties, uncertainties_of
from small_patient import ON_ECMO


def scaled(columns: dict[str, list[float]]) -> ScaledSensitivities:
    matrix = np.array(list(columns.values())).T
    return ScaledSensitivities(tuple("xyz"[: len(matrix)]), tuple(columns), matrix)


def test_scaling_is_relative_to_parameter_and_uncertainty():
    result = ScaledSensitivities.of(
        ["x"], ["p", "q"], np.array([[2.0, -3.0]]), np.array([5.0, 1.0]), np.array([4.0])
    )
    np.testing.assert_allclose(result.matrix, [[2.5, -0.75]])


def test_collinearity_of_two_follows_from_their_angle():
    angle = np.deg2rad(12.0)
    result = scaled({"p": [3.0, 0.0, 0.0], "q": [5 * np.cos(angle), 5 * np.sin(angle), 0.0]})
    # Brun et al. 2001: smallest eigenvalue of two unit columns is 1 - cosine.
    assert result.collinearity(["p", "q"]) == pytest.approx(1.0 / np.sqrt(1.0 - np.cos(angle)), rel=1e-9)
    assert result.orthogonality[0, 1] == pytest.approx(np.sin(angle), rel=1e-9)


def test_orthogonal_columns_have_index_one_and_the_same_column_infinity():
    result = scaled({"p": [1.0, 0, 0], "q": [0, 2.0, 0], "r": [0, 4.0, 0]})
    assert result.collinearity(["p", "q"]) == pytest.approx(1.0)
    assert result.collinearity(["q", "r"]) == np.inf
    assert result.collinearity(["p", "q", "r"]) == np.inf


def test_all_subsets_are_what_each_gives_alone():
    random = np.random.default_rng(2)
    result = ScaledSensitivities(tuple("vwxyz"), tuple("abcdef"), random.normal(size=(5, 6)))
    sizes = all_subsets(result, limit=3.0)
    assert [s.size for s in sizes] == [2, 3, 4, 5]
    assert [s.count for s in sizes] == [15, 20, 15, 6]
    for s in sizes:
        assert result.collinearity(s.best) == pytest.approx(s.smallest)
    # An index cannot fall when a parameter joins.
    assert np.all(np.diff([s.smallest for s in sizes]) > 0)


def test_more_parameters_than_measurements_cannot_be_told_apart():
    result = scaled({"p": [1.0, 0], "q": [0, 1.0], "r": [1.0, 1.0]})
    assert result.collinearity(["p", "q", "r"]) == np.inf
    assert max(s.size for s in all_subsets(result, 10.0)) == 2
    assert relative_errors(result, ["p", "q", "r"])["p"] == np.inf


def test_fisher_information_is_that_of_a_linear_fit():
    random = np.random.default_rng(3)
    result = ScaledSensitivities(tuple("wxyz"), tuple("abc"), random.normal(size=(4, 3)))
    fisher = fisher_information(result)
    rebuilt = fisher.eigenvectors @ np.diag(fisher.eigenvalues) @ fisher.eigenvectors.T
    np.testing.assert_allclose(rebuilt, fisher.matrix, atol=1e-12)
    errors = relative_errors(result, ["a", "b", "c"])
    np.testing.assert_allclose(list(errors.values()), np.sqrt(np.diag(np.linalg.inv(fisher.matrix))))
    noisy = np.linalg.lstsq(result.matrix, random.normal(size=(4, 20_000)), rcond=None)[0]
    np.testing.assert_allclose(noisy.std(axis=1), list(errors.values()), rtol=0.03)


def test_the_proposal_gives_a_reason_for_each_parameter_left_out():
    columns = {
        "strong": [10.0, 1.0, 0.0],
        "twin": [9.0, 0.9, 0.0],
        "other": [0.0, 4.0, 0.0],
        "third": [0.0, 0.1, 3.0],
        "fourth": [1.0, 2.0, 2.0],
        "weak": [0.3, 0.0, 0.0],
        "none": [0.0, 0.0, 0.0],
    }
    result = propose(scaled(columns))
    assert result.chosen == ("strong", "other", "third")
    assert result.collinearity < 10
    assert "strong" in result.excluded["twin"]
    assert "as many parameters as measurements (3)" in result.excluded["fourth"]
    assert "too little effect" in result.excluded["weak"]
    assert result.excluded["none"] == "no effect on any measurement"
    assert result.excluded.keys() == {"twin", "fourth", "weak", "none"}


def test_a_set_that_cannot_be_told_apart_is_not_proposed():
    near = {"p": [10.0, 0.0, 0.0], "q": [100.0, 5.0, 0.0], "r": [0.0, 0.0, 5.0]}
    # The index of p and q is 28; half an uncertainty of p's effect is its own.
    loose, strict = (propose(scaled(near), limit=limit, threshold=0.1) for limit in (50.0, 5.0))
    assert set(loose.chosen) == {"p", "q", "r"}
    assert loose.excluded == {}
    assert set(strict.chosen) == {"q", "r"}
    assert "cannot be told from q" in strict.excluded["p"]
    same, near = (
        propose(scaled({"p": [1000.0, off, 0.0], "q": [1000.0, 0.0, 0.0]}), threshold=1e-9)
        for off in (0.0, 0.3)
    )
    assert "collinearity index infinite with the set" in "".join(same.excluded.values())
    assert "collinearity index 4710 with the set" in "".join(near.excluded.values())  # it was 4.71e+03


def test_a_parameter_with_next_to_no_effect_of_its_own_is_not_proposed():
    near = {"p": [10.0, 0.0, 0.0], "q": [100.0, 5.0, 0.0], "r": [0.0, 0.0, 5.0]}
    result = propose(scaled(near), limit=50.0, threshold=1.0)
    assert set(result.chosen) == {"q", "r"}
    assert result.excluded["p"] == (
        "nearly all of its effect could come from q: its own effect is 0.5 uncertainties (needed 1)"
    )


def test_better_measurements_identify_more():
    matrix = {"p": [2.0, 0.0, 0.1], "q": [0.0, 0.5, 0.2]}
    assert propose(scaled(matrix)).chosen == ("p",)
    sharper = {name: [10 * x for x in column] for name, column in matrix.items()}
    assert propose(scaled(sharper)).chosen == ("p", "q")


def test_uncertainties_are_absolute_or_relative():
    given = read_uncertainties("SP=5, CO=8%")
    chosen = uncertainties_of(["SP", "CO", "MAP"], given)
    assert chosen["SP"].at(110) == 5
    assert chosen["CO"].at(5.0) == pytest.approx(0.4)
    assert chosen["MAP"] == Uncertainty(3.0)


def test_a_percentage_of_zero_is_an_uncertainty_of_flows_only():
    """10 % of a CVP of 0 was 0.01 mmHg, a percentage of the smallest flow."""
    tenth = Uncertainty(relative=0.1)
    assert standard_uncertainties({"CO": 0.0}, {"CO": tenth}) == {"CO": pytest.approx(0.01)}
    with pytest.raises(InputError, match=r"CVP: 10 % of a value of 0 .* in mmHg, such as CVP=2$"):
        standard_uncertainties({"CVP": 0.0, "MAP": 80.0}, {"CVP": tenth, "MAP": tenth})


@pytest.mark.parametrize("error", [1e-300, 1e-9])
def test_an_uncertainty_below_what_is_computed_is_refused(error):
    """A fit ended in a traceback, or said of every beat that valves stay shut."""
    with pytest.raises(
        InputError, match=r"MAP: 1e-.* mmHg is smaller than .* at least 0.0003 mmHg \(usual: 3"
    ):
        standard_uncertainties({"MAP": 80.0, "CO": 4.0}, DEFAULTS | {"MAP": Uncertainty(error)})
    assert standard_uncertainties({"MAP": 80.0}, {"MAP": Uncertainty(3e-4)}) == {"MAP": 3e-4}


@pytest.mark.parametrize("text", ["SP", "SP=", "SP=abc", "SP=-1", "CO=0%", "CO=inf"])
def test_wrong_uncertainties_say_what_is_allowed(text):
    with pytest.raises(InputError, match="CO=10%"):
        read_uncertainties(text)


@pytest.mark.parametrize(
    ("text", "words"), [("SP=4,SP=5", "given twice"), ("CO=400%", "carries no information")]
)
def test_contradictory_uncertainties_are_refused(text, words):
    with pytest.raises(InputError, match=words):
        read_uncertainties(text)


def test_uncertainties_of_what_is_not_measured_are_refused():
    with pytest.raises(InputError, match="uncertainty of SP"):
        uncertainties_of(["MAP"], {"SP": Uncertainty(1.0)})
    with pytest.raises(InputError, match="EDVLV=5%"):
        uncertainties_of(["EDVLV"], {})


@pytest.mark.parametrize("numbers", [(-3.0, 0.0), (0.0, 0.0), (math.nan, 0.0), (math.inf, 0.0), (0.0, -0.1)])
def test_an_uncertainty_that_cannot_be_is_refused(numbers):
    """One of 0 made every effect infinite or NaN, and nothing was called identifiable."""
    with pytest.raises(InputError, match="allowed: finite, none below 0, one of them above 0"):
        Uncertainty(*numbers)


def test_a_plain_number_as_uncertainty_says_what_to_write():
    with pytest.raises(InputError, match=r"uncertainty of MAP: 3; allowed: eclsim.Uncertainty\(3.0\)"):
        standard_uncertainties({"MAP": 80.0}, {"MAP": 3.0})  # pyright: ignore[reportArgumentType]  # the mistake


def test_large_percentages_are_written_without_a_power_of_ten():
    """It read: a least standard error of 1.22e+04 %."""
    assert _in_words("Rmc", 121.7) == "12200 %"


def test_a_parameter_that_follows_the_patients_blood_is_refused_with_what_to_set():
    case = read_mapping(tomllib.loads(ON_ECMO + "dialysate_ml_h = 1500\n[gas]\n")).case
    with pytest.raises(InputError, match="haematocrit_in = 0 follows the patient's blood: set it"):
        identifiability(case, parameters=["Rmc", "crrt.haematocrit_in"])
