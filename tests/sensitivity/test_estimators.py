from dataclasses import replace

import numpy as np
import pytest
from SALib.analyze import sobol as salib

from eclsim.orbit.status import Status
from eclsim.sensitivity.design import Design, Estimates, sobol_indices
from eclsim.sensitivity.inputs import Continuous
from eclsim.sensitivity.results import FEWEST_ROWS, Indices, indices_of_runs, indices_text
from eclsim.sensitivity.runs import WITHOUT_GASES
from known_indices import (
    ISHIGAMI_INPUTS,
    IshigamiWithChoice,
    ishigami,
    ishigami_indices,
    runs_of,
    sobol_g,
    sobol_g_indices,
)

SEEDS = 200
ROWS = 1024  # at 512 the projections of the Sobol sequence leave single indices at 85 %
G_WEIGHTS = (0.0, 1.0, 4.5, 9.0)


def runs(design: Design, function) -> np.ndarray:
    values = function(**design.settings(design.unit()))
    return values.reshape(design.samples, design.runs_per_row, -1)


@pytest.mark.parametrize("second_order", [True, False])
def test_indices_and_intervals_are_those_of_salib(second_order):
    design = Design(ISHIGAMI_INPUTS, 128, 5, second_order=second_order)
    one = runs(design, ishigami)
    values = np.concatenate([one, 100.0 + one**2], axis=-1)
    ours = sobol_indices(values, 3, seed=9)
    problem = {"num_vars": 3, "names": ["x1", "x2", "x3"], "bounds": [[-1, 1]] * 3}
    for k in range(2):
        theirs = salib.analyze(problem, values[..., k].ravel(), calc_second_order=second_order, seed=9)
        for name in ("S1", "S1_conf", "ST", "ST_conf"):
            np.testing.assert_allclose(getattr(ours, name)[k], theirs[name], atol=1e-12, err_msg=name)
        if second_order:
            for name in ("S2", "S2_conf"):
                np.testing.assert_allclose(getattr(ours, name)[k], theirs[name], atol=1e-12, err_msg=name)
    assert (ours.S2 is None) is not second_order


def test_an_output_that_does_not_vary_has_no_indices():
    result = sobol_indices(np.full((8, 8, 1), 3.7), 3)
    assert np.all(result.S1 == 0)
    assert np.all(result.ST == 0)


def test_rounding_is_no_effect():
    """An oxygen consumption of 250 in every run but for its last digits, a recirculation of 1e-29."""
    random, design = np.random.default_rng(3), Design(ISHIGAMI_INPUTS, 64, second_order=False)
    noise = random.standard_normal((len(design.unit()), 2))
    effect = ishigami(**design.settings(design.unit()))[:, None]
    values = np.concatenate([250.0 + 1e-13 * noise[:, :1], 1e-29 * noise[:, 1:], effect], axis=1)
    indices = indices_of_runs(design, ("VO2", "recirculation_fraction", "y"), runs_of(values)).indices
    assert indices.constant == ("VO2", "recirculation_fraction")
    assert np.all(indices.estimates.ST[:2] == 0.0)
    assert indices.selected()["VO2"] == indices.ranking("VO2") == []
    assert indices.selected()["y"]
    assert any("VO2, recirculation_fraction do not vary" in s for s in indices.as_object()["warnings"])
    assert "VO2" in indices_text(indices)


@pytest.mark.parametrize("samples", [32, 256])
def test_nothing_is_ranked_from_a_handful_of_rows(samples):
    """32 rows, or 256 of which more than half are lost."""
    design = Design(ISHIGAMI_INPUTS, samples, second_order=False)
    values = ishigami(**design.settings(design.unit()))[:, None]
    status = np.zeros(len(values), dtype=int)
    if samples > FEWEST_ROWS:
        status[: design.runs_per_row * (samples // 2 + 1)] = Status.NOT_CONVERGED
    runs = replace(runs_of(values), status=status)
    indices = indices_of_runs(design, ("y",), runs).indices
    assert not indices.ranked
    assert indices.selected() == {"y": []}
    assert indices.union() == indices.ranking("y") == []
    assert list(indices.sums) == ["x1", "x2", "x3"]
    assert "TOO FEW ROWS" in indices_text(indices)
    assert any("nothing is ranked" in s for s in indices.as_object()["warnings"])
    assert any("nothing is ranked" in s for s in indices.dataset.attrs["warnings"])


def test_an_index_below_its_half_width_is_not_selected():
    total, width = np.array([[0.6, 0.4, 0.0]]), np.array([[0.1, 0.5, 0.1]])
    indices = Indices(("a", "b", "c"), ("y",), Estimates(total, width, total, width), 64, 320, (), 64)
    assert indices.selected() == {"y": ["a"]}


def test_sums_have_half_widths_and_an_order_within_them_is_called_unknown():
    """Sums of 2.28, 1.51 and 0.89 were ranked without half widths."""
    design = Design(tuple(Continuous(name, 0.0, 1.0) for name in "abc"), 128, second_order=False)
    a, b, c = design.unit().T
    values = np.stack([a + 0.97 * b + 0.2 * c, a + 0.97 * b], axis=1)
    result = indices_of_runs(design, ("y", "z"), runs_of(values)).indices
    assert list(result.sums) == ["a", "b", "c"]
    assert all(0.0 < width < 0.5 for width in result.sums_conf.values())
    assert result.open_orders == [("a", "b")]
    content = result.as_object()
    assert content["sum_ST_conf"] == result.sums_conf
    assert content["order_not_known"] == [("a", "b")]
    assert result.dataset["ST_sum_conf"].sel(factor="a") == result.sums_conf["a"]
    text = indices_text(result)
    assert f"{result.sums['a']:.2f}±{result.sums_conf['a']:.2f}" in text
    assert "order not known: a and b (their sums differ by less than the 95 % half width" in text
    # Outputs of the same runs err together: the interval of a doubled output is twice as wide.
    doubled = sobol_indices(np.repeat(values[:, :1].reshape(128, -1, 1), 2, axis=2), 3)
    single = sobol_indices(values[:, :1].reshape(128, -1, 1), 3)
    np.testing.assert_allclose(doubled.sum_conf(), 2.0 * single.sum_conf())
    np.testing.assert_allclose(single.sum_conf(), single.ST_conf[0])


def coverage(inputs, function, exact) -> np.ndarray:
    """Share of seeds whose intervals hold the exact indices, shape (S1 or ST, factors)."""
    inside = []
    for seed in range(SEEDS):
        design = Design(inputs, ROWS, seed, second_order=False)
        result = sobol_indices(runs(design, function), len(inputs), seed=seed)
        inside.append(
            [
                np.abs(result.S1[0] - exact.S1) <= result.S1_conf[0],
                np.abs(result.ST[0] - exact.ST) <= result.ST_conf[0],
            ]
        )
    return np.mean(inside, axis=0)


@pytest.mark.slow
def test_intervals_hold_the_exact_indices_of_ishigami():
    share = coverage(ISHIGAMI_INPUTS, ishigami, ishigami_indices())
    assert share.min() >= 0.95, share


@pytest.mark.slow
def test_intervals_hold_the_exact_indices_of_sobols_g_function():
    inputs = tuple(Continuous(f"x{k}", 0.0, 1.0) for k in range(len(G_WEIGHTS)))

    def function(**settings):
        return sobol_g(np.stack([settings[i.name] for i in inputs], axis=-1), G_WEIGHTS)

    share = coverage(inputs, function, sobol_g_indices(G_WEIGHTS))
    assert share.min() >= 0.95, share


@pytest.mark.slow
def test_intervals_hold_the_exact_indices_of_a_choice():
    function = IshigamiWithChoice()
    share = coverage(function.inputs(), function, function.exact())
    assert share.min() >= 0.95, share


def test_a_choice_drawn_over_the_finished_design_spoils_the_indices():
    """What drawing the connection scheme at random over the finished Saltelli matrix does."""
    function = IshigamiWithChoice()
    exact = function.exact()
    design = Design(function.inputs(), 4096)
    settings = design.settings(design.unit())
    drawn = np.random.default_rng(3).integers(5, size=design.evaluations)
    settings |= {name: np.array(values)[drawn] for name, values in function.inputs()[2].sets}
    values = function(**settings).reshape(design.samples, design.runs_per_row, 1)
    result = sobol_indices(values, 3)
    effect_of_choice = exact.ST[2]
    # The choice itself looks as if it had no effect of its own ...
    assert exact.S1[2] > 0.1
    assert abs(result.S1[0, 2]) < 0.03
    # ... and everything else carries the choice in its total order.
    expected = [exact.ST[0] + exact.S1[2], exact.ST[1] + effect_of_choice, effect_of_choice]
    np.testing.assert_allclose(result.ST[0], expected, atol=0.03)
    assert result.ST[0, 1] - exact.ST[1] > 0.2


def test_sizes_of_which_no_part_has_two_whole_rows_have_no_convergence():
    design = Design((Continuous("x", 0.0, 1.0), Continuous("y", 0.0, 1.0)), 32, second_order=False)
    values = design.unit().sum(axis=1, keepdims=True)
    failed = ~np.isin(np.repeat(np.arange(32), design.runs_per_row), (3, 20))
    runs = replace(runs_of(values), status=np.where(failed, 3, 0))
    mean = indices_of_runs(design, ("sum",), runs).convergence["mean"]
    assert np.isnan(mean.sel(rows=16)).all()
    assert np.isfinite(mean.sel(rows=32)).all()


def test_repeats_are_those_with_rows_left():
    """With all its rows left in one half, a design had two repeats of half its size, but no spread."""
    design = Design((Continuous("x", 0.0, 1.0), Continuous("y", 0.0, 1.0)), 32, second_order=False)
    values = design.unit().sum(axis=1, keepdims=True)
    failed = ~np.isin(np.repeat(np.arange(32), design.runs_per_row), (0, 4, 7, 8, 12))
    runs = replace(runs_of(values), status=np.where(failed, 3, 0))
    found = indices_of_runs(design, ("sum",), runs).convergence
    assert found["repeats"].values.tolist() == [1, 1]
    assert found["rows_used"].values.tolist() == [5.0, 5.0]
    np.testing.assert_array_equal(found["mean"].sel(rows=16), found["mean"].sel(rows=32))
    whole = indices_of_runs(design, ("sum",), runs_of(values)).convergence
    assert whole["repeats"].values.tolist() == [2, 1]
    assert whole["rows_used"].values.tolist() == [16.0, 32.0]


def test_a_design_whose_runs_failed_says_of_what():
    design = Design((Continuous("x", 0.0, 1.0), Continuous("y", 0.0, 1.0)), 8, second_order=False)
    values = np.full((8 * design.runs_per_row, 1), np.nan)
    status = np.full(len(values), WITHOUT_GASES + 1)
    status[0] = int(Status.NOT_CONVERGED)
    runs = replace(runs_of(values), status=status)
    with pytest.raises(ValueError, match=rf"no_oxygen {len(values) - 1}, not_converged 1\)"):
        indices_of_runs(design, ("sum",), runs)
