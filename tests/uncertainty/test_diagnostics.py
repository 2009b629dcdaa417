"""Diagnostics against ArviZ, and what is trusted."""

import warnings

import numpy as np
import pytest

from eclsim.uncertainty.diagnostics import diagnose, effective_bulk, effective_tail, r_hat


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
        wanted = arviz.convert_to_dataset(data)
    except (TypeError, ValueError):
        wanted = arviz.convert_to_datatree({"posterior": data})

    def value(found):
        return float(np.asarray(found["x"] if "x" in found else found["posterior"]["x"]))

    assert r_hat(draws) == pytest.approx(value(arviz.rhat(wanted)), abs=2e-3)
    assert effective_bulk(draws) == pytest.approx(value(arviz.ess(wanted, method="bulk")), rel=0.02)
    assert effective_tail(draws) == pytest.approx(value(arviz.ess(wanted, method="tail")), rel=0.05)


def diagnosed(draws, diverging=0):
    flags = np.zeros(draws.shape, dtype=bool)
    flags[0, :diverging] = True
    return diagnose(("a",), draws[:, :, None], flags)


def test_good_chains_are_trusted():
    assert diagnosed(chains()).trusted


@pytest.mark.parametrize(
    ("draws", "diverging", "word"),
    [
        (chains(shift=0.5), 0, "R-hat of a"),
        (chains(0.995), 0, "effective sample size of a"),
        (chains(), 200, "diverged"),
    ],
)
def test_bad_chains_are_not(draws, diverging, word):
    found = diagnosed(draws, diverging)
    assert not found.trusted
    assert any(word in doubt for doubt in found.doubts)


def test_a_chain_that_never_moved_is_not_trusted():
    draws = np.tile(np.arange(4.0)[:, None], (1, 100))
    assert not diagnosed(draws).trusted
