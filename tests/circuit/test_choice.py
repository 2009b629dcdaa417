import numpy as np
import pytest

from eclsim.haemodynamics.evaluation import batch_outputs
from eclsim.solver.steady import Batch, steady_beats
from model_catalogue import SCHEMES, model, scheme_sites

OUTPUTS = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF", "crrt_access_pressure", "crrt_return_pressure")


@pytest.fixture(scope="module")
def anywhere():
    """All nine schemes in one batch of one circuit."""
    base = model("V-A, CRRT anywhere")
    sites = [scheme_sites(scheme) for scheme in SCHEMES]
    values = dict(base.values) | {key: np.array([s[key] for s in sites]) for key in sites[0]}
    steady = steady_beats(Batch(base.circuit, values, len(sites)))
    return dict(zip(SCHEMES, batch_outputs(steady, OUTPUTS).T, strict=True))


def test_a_chosen_site_equals_a_fixed_one(anywhere):
    fixed = model("V-A, CRRT g")
    steady = steady_beats(Batch(fixed.circuit, fixed.values, 1))
    np.testing.assert_allclose(anywhere["g"], batch_outputs(steady, OUTPUTS)[:, 0], rtol=1e-6)


def test_schemes_differ(anywhere):
    pressures = {tuple(np.round(values[-2:], 3)) for values in anywhere.values()}
    assert len(pressures) == len(SCHEMES)
    # Access at the highest pressure of the circuit and at the lowest.
    assert anywhere["a"][-2] > 150.0 > 0.0 > anywhere["h"][-2]
