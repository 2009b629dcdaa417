import numpy as np
import pytest

from eclsim.orbit.steady import Batch
from eclsim.outputs.results import simulate, simulate_many
from eclsim.outputs.steady_beat import steady_beat
from model_catalogue import SCHEMES, model, scheme_sites

OUTPUTS = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF", "crrt_access_pressure", "crrt_return_pressure")


@pytest.fixture(scope="module")
def anywhere():
    """All nine schemes in one batch of one circuit."""
    base = model("V-A, CRRT anywhere")
    sites = [scheme_sites(scheme) for scheme in SCHEMES]
    values = dict(base.values) | {key: np.array([s[key] for s in sites]) for key in sites[0]}
    beat = steady_beat(Batch(base.circuit, values, len(sites)), OUTPUTS)
    return dict(zip(SCHEMES, beat.values.T, strict=True))


def test_a_chosen_site_equals_a_fixed_one(anywhere):
    fixed = model("V-A, CRRT g")
    beat = steady_beat(Batch.of(fixed), OUTPUTS)
    np.testing.assert_allclose(anywhere["g"], beat.values[:, 0], rtol=1e-6)


def test_schemes_differ(anywhere):
    pressures = {tuple(np.round(values[-2:], 3)) for values in anywhere.values()}
    assert len(pressures) == len(SCHEMES)
    # Access at the highest pressure of the circuit and at the lowest.
    assert anywhere["a"][-2] > 150.0 > 0.0 > anywhere["h"][-2]


@pytest.mark.parametrize("site", [0.5, -1.0, 7.0, np.nan, np.inf])
def test_a_number_that_is_no_site_is_refused(site):
    patient = model("V-A, CRRT anywhere", **scheme_sites("g")).with_values({"crrt.access_site": site})
    result = simulate(patient)
    assert result.attrs["status"] == "invalid_input"
    assert np.isnan(float(result["MAP"]))
    assert f"crrt.access_site = {site:g}: not a site of this circuit" in result.attrs["message"]
    assert "allowed: 0 (ecmodrain), 1 (ecmotudp), 2 (ecmotupo)" in result.attrs["message"]
    with pytest.raises(ValueError, match="not a site of this circuit; allowed: 0 \\(ecmodrain\\)"):
        patient.circuit.with_chosen_sites(patient.values)


def test_in_a_batch_only_the_member_without_a_site_fails():
    patient = model("V-A, CRRT anywhere", **scheme_sites("g"))
    sites = [patient.values["crrt.access_site"], 0.5, np.nan, 3.0]
    result = simulate_many(patient, {"crrt.access_site": sites}, ("MAP", "crrt_access_pressure"))
    assert list(result["status"].values) == ["converged", "invalid_input", "invalid_input", "converged"]
    assert list(np.isnan(result["MAP"].values)) == [False, True, True, False]
    assert "crrt.access_site = 0.5: not a site" in str(result["message"].values[1])
    assert "steady beat found" in str(result["message"].values[0])
