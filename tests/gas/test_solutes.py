"""Effective clearances: closed forms where the paths are simple, and nothing is lost on any."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from eclsim.devices.crrt import crrt
from eclsim.devices.ecmo import ecmo
from eclsim.gas.network import flows_of
from eclsim.gas.tracers import effective_shares, sources
from eclsim.gas.transport import mixtures
from eclsim.outputs.measures import single
from eclsim.patient.circulation import circulation

OUTPUT, ECMO, CRRT = 3.0, 2.0, 0.2
CLEARED = np.array([30.0, 5.0])
WATER = np.array([170.0, 130.0])


def flows_along(circuit, **given):
    """Forward flows of a patient with an output of 3 L/min; other connections as given."""
    return np.array([given.get(c.name, OUTPUT if c.group == "patient" else 0.0) for c in circuit.connections])


def effective(circuit, forward):
    law = effective_shares(circuit, "crrtfil")
    assert law.connections == tuple(c.name for c in circuit.connections)
    numbers = np.array([*forward, *np.zeros(len(forward)), *CLEARED, *WATER])
    return CLEARED * np.asarray(single(law.compute, law.key)(numbers))


def lines(flow):
    return dict.fromkeys(("crrttuin", "crrtpump", "crrttupf", "crrtfil", "crrttuout"), flow)


def test_on_a_vein_behind_the_tissues_all_of_the_clearance_is_effective():
    circuit = circulation() + crrt("svn", "ra")
    forward = flows_along(circuit, svn=OUTPUT - CRRT, **lines(CRRT))
    np.testing.assert_allclose(effective(circuit, forward), CLEARED, rtol=1e-8)


def test_from_and_to_the_same_vein_what_is_cleaned_is_drawn_again():
    circuit = circulation() + crrt("svn", "svn")
    forward = flows_along(circuit, **lines(CRRT))
    again = CRRT / (OUTPUT + CRRT)
    expected = CLEARED * (1.0 - again) / (1.0 - again * (1.0 - CLEARED / WATER))
    np.testing.assert_allclose(effective(circuit, forward), expected, rtol=1e-8)


def test_arterial_access_draws_blood_that_was_cleaned_on_its_way_through_the_heart():
    circuit = circulation() + crrt("sart", "ra")
    forward = flows_along(circuit, sart=OUTPUT - CRRT, svn=OUTPUT - CRRT, **lines(CRRT))
    again = CRRT / OUTPUT
    expected = CLEARED * (1.0 - again) / (1.0 - again * (1.0 - CLEARED / WATER))
    np.testing.assert_allclose(effective(circuit, forward), expected, rtol=1e-8)


def test_what_the_filter_removes_is_what_the_tissues_give():
    circuit = circulation() + ecmo("ra", "ao") + crrt("ecmotuor", "ecmooxy")
    rng = np.random.default_rng(5)
    forward, backward = rng.uniform(0.5, 4.0, (2, len(circuit.connections)))
    at = sources(circuit, "crrtfil")
    mixed = jax.jit(lambda *both: mixtures(flows_of(circuit, *both, {}), at))(forward, backward)
    kept = 1.0 - CLEARED[0] / WATER[0]
    inlet = mixed.inlets[-1, 0] / (1.0 - kept * mixed.inlets[-1, 1])
    outlets = jnp.array([1.0, kept * inlet])
    gained = mixed.streams * (outlets - mixed.inlets @ outlets)
    assert float(gained.sum()) == pytest.approx(0.0, abs=1e-10)
    assert float(-gained[1] / mixed.streams[1]) == pytest.approx(float(inlet * (1.0 - kept)), rel=1e-12)
    np.testing.assert_allclose(mixed.compartments.sum(axis=1), 1.0, atol=1e-12)


def test_regional_beds_are_all_tissue():
    from eclsim.patient.circulation import Anatomy

    regional = circulation(Anatomy(regional=True)) + crrt("ivc", "ra")
    names = [regional.connections[k].name for k in sources(regional, "crrtfil")]
    assert names == ["upper", "lower", "crrtfil"]
