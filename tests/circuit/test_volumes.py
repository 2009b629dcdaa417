"""Start pressures of compartments whose curve is no straight line."""

import numpy as np
import pytest

from eclsim.circuit import Circuit, Compartment, Connection, StartPressure
from eclsim.circuit.assembly import assemble
from eclsim.components import Atrium, ElasticVessel, Resistance, Ventricle
from eclsim.orbit.model import Model
from eclsim.outputs.results import simulate
from user_components import PressureSource, StiffeningDevice

VENTRICLE = Ventricle("Emax", "alpha", "kappa", "beta")
VALUES = {"Emax": 1.8, "alpha": 0.064, "kappa": 0.033, "beta": 2.5, "C": 2.0, "R": 1.0, "P0": 10.0}


def circuit_of(law) -> Circuit:
    """A compartment filled to P0 beside a vessel at 1 mmHg."""
    return Circuit(
        (
            Compartment("chamber", law, start=StartPressure("P0")),
            Compartment("vessel", ElasticVessel("C"), start=StartPressure(1.0)),
        ),
        (Connection("path", Resistance("R"), "chamber", "vessel"),),
    )


def filled(law, values) -> float:
    return assemble(circuit_of(law)).start_volumes(values)[0]


@pytest.mark.parametrize("pressure", [2.6, 10.0, 25.0, 80.0])
def test_a_relaxed_ventricle_is_filled_along_its_exponential(pressure):
    exact = np.log((pressure - 2.5) / 0.064) / 0.033
    assert filled(VENTRICLE, VALUES | {"P0": pressure}) == pytest.approx(exact, rel=1e-9)
    if pressure == 10.0:
        assert exact == pytest.approx(144.4, abs=0.1)


def test_a_straight_line_is_solved_exactly():
    assert filled(Atrium("Ed", "Emax"), VALUES | {"Ed": 0.2}) == pytest.approx(50.0, rel=1e-12)
    assert filled(ElasticVessel("C"), VALUES) == 20.0


def test_a_component_of_a_users_own_is_filled_too():
    volume = filled(StiffeningDevice("soft", "stiff"), VALUES | {"soft": 0.4, "stiff": 1e-4})
    assert 0.4 * volume + 1e-4 * volume**3 == pytest.approx(10.0, rel=1e-9)


def test_many_patients_are_filled_each_to_their_own_pressure():
    pressures, offsets = np.array([5.0, 10.0, 20.0]), np.array([1.0, 2.5, 2.5])
    together = filled(VENTRICLE, VALUES | {"P0": pressures, "beta": offsets})
    np.testing.assert_allclose(together, np.log((pressures - offsets) / 0.064) / 0.033, rtol=1e-9)


@pytest.mark.parametrize("name", ["P0", "alpha", "kappa", "beta"])
def test_the_volume_has_a_derivative(name):
    shifted = VALUES | {name: VALUES[name] + 1e-30j}
    exact = np.imag(filled(VENTRICLE, shifted)) / 1e-30
    step = 1e-4 * VALUES[name]
    high, low = (filled(VENTRICLE, VALUES | {name: VALUES[name] + s}) for s in (step, -step))
    assert abs(exact) > 1.0
    assert exact == pytest.approx((high - low) / (2 * step), rel=1e-5)


@pytest.mark.parametrize("law", [VENTRICLE, PressureSource(3.0)], ids=["below its offset", "a constant"])
def test_a_pressure_that_no_volume_has_is_said(law):
    patient = Model(circuit_of(law), VALUES | {"P0": 2.0, "heart_rate_bpm": 60.0})
    result = simulate(patient)
    assert result.attrs["status"] == "invalid_input"
    assert "start pressure of compartment 'chamber' = 2 mmHg" in result.attrs["message"]


def test_the_same_vein_is_not_filled_again_beat_by_beat(monkeypatch):
    """Each search for a volume evaluates a curve sixty times; a course asks for it with every beat."""
    calls = []
    law = Ventricle.pressure
    monkeypatch.setattr(Ventricle, "pressure", lambda *given: calls.append(1) or law(*given))
    values = VALUES | {"P0": 11.25}
    first = filled(VENTRICLE, values)
    searched = len(calls)
    assert filled(VENTRICLE, dict(values)) == first
    assert len(calls) == searched > 0
    assert filled(VENTRICLE, values | {"beta": 2.0}) > first
    assert len(calls) > searched
