"""Diagnostics against ArviZ, and what is trusted."""

import warnings

import numpy as np
import pytest

from eclsim.identification.nuts import (
    diagnose,
    effective_bulk,
    effective_tail,
    energy_fraction,
    r_hat,
    remarks_on_divergence,
)


def chains(correlation=0.0, shift=0.0, seed=0, count=1000):
    random = np.random.default_rng(seed)
    draws = random.standard_normal((4, count))
    for k in range(1, count):
        draws[:, k] = correlation * draws[:, k - 1] + np.sqrt(1.0 - correlation**2) * draws[:, k]
    draws[0] += shift
    return draws


@pytest.mark.parametrize(
    "draws",
    [chains(), chains(0.9), chains(0.3, 1.0), np.exp(chains(0.5, seed=3))],
    ids=["independent", "correlated", "disagreeing", "skewed"],
)
def test_as_arviz(draws):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about a coming version
        arviz = pytest.importorskip("arviz")
    data = {"x": draws}
    try:
        expected = arviz.convert_to_dataset(data)
    except (TypeError, ValueError):
        expected = arviz.convert_to_datatree({"posterior": data})

    def value(result):
        return float(np.asarray(result["x"] if "x" in result else result["posterior"]["x"]))

    assert r_hat(draws) == pytest.approx(value(arviz.rhat(expected)), abs=2e-3)
    assert effective_bulk(draws) == pytest.approx(value(arviz.ess(expected, method="bulk")), rel=0.02)
    tail = arviz.ess(expected, method="tail", prob=(0.05, 0.95))  # of other quantiles by default since 1.0
    assert effective_tail(draws) == pytest.approx(value(tail), rel=0.05)


def diagnosed(draws, diverging=0, energy=None, saturated=0):
    flags = np.zeros(draws.shape, dtype=bool)
    flags[0, :diverging] = True
    if energy is None:
        energy = np.random.default_rng(9).standard_normal(draws.shape)
    cut = np.zeros(draws.shape, dtype=bool)
    cut[:, :saturated] = True
    statistics = {"diverging": flags, "energy": energy, "saturated": cut}
    return diagnose(("a",), draws[:, :, None], statistics)


def test_good_chains_are_trusted():
    assert not diagnosed(chains()).doubts


@pytest.mark.parametrize(
    ("draws", "diverging", "word"),
    [
        (chains(shift=0.5), 0, "R-hat of a"),
        (chains(0.995), 0, "effective sample size of a"),
        (chains(), 200, "diverged"),
    ],
)
def test_bad_chains_are_not(draws, diverging, word):
    result = diagnosed(draws, diverging)
    assert any(word in doubt for doubt in result.doubts)


def test_a_chain_that_never_moved_is_not_trusted():
    draws = np.tile(np.arange(4.0)[:, None], (1, 100))
    assert diagnosed(draws).doubts


def test_energies_that_hardly_change_are_not_trusted():
    """A slow energy: each chain sees little of the tails, though the draws look well mixed."""
    result = diagnosed(chains(), energy=chains(0.95, seed=4))
    assert any("E-BFMI of chain" in doubt for doubt in result.doubts)
    assert result.energy_fraction == pytest.approx(2.0 * (1.0 - 0.95), abs=0.05)


def test_energy_fraction_as_arviz():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about a coming version
        arviz = pytest.importorskip("arviz")
        energy = chains(0.6, seed=2)
        expected = np.ravel(arviz.bfmi(energy))
    assert [energy_fraction(e) for e in energy] == pytest.approx(list(expected), rel=1e-2)


def test_trajectories_that_are_cut_are_counted_and_named_where_draws_are_too_few():
    assert diagnosed(chains(), saturated=500).saturated == 2000
    assert not diagnosed(chains(), saturated=500).doubts
    (doubt,) = (d for d in diagnosed(chains(0.995), saturated=500).doubts if "effective" in d)
    assert "2000 of 4000 trajectories were cut" in doubt


def test_divergent_draws_are_named_also_where_they_are_few():
    """Only from 1 % on were they said; below, one had to look for them in the JSON."""
    draws = chains()
    assert remarks_on_divergence(diagnosed(draws)) == ()
    (remark,) = remarks_on_divergence(diagnosed(draws, diverging=30))
    assert remark.startswith("30 of 4000 draws diverged (0.75 %, at most 1 % are allowed)")
    many = diagnosed(draws, diverging=41)
    assert remarks_on_divergence(many) == ()
    assert any(doubt.startswith("41 of 4000 draws diverged") for doubt in many.doubts)
