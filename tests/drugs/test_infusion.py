"""Wash-in and wash-out of infusions against exponentials."""

import numpy as np
import pytest

from eclsim.drugs.infusion import InfusedDoses
from eclsim.drugs.published import PUBLISHED
from eclsim.parameters.regulation import dose

PUMP = {dose(name): np.array([0.0, 0.2]) for name in PUBLISHED}


@pytest.mark.parametrize("drug", PUBLISHED.values(), ids=PUBLISHED)
def test_half_of_a_step_is_in_effect_after_a_half_life(drug):
    """Integrated by small steps of the classical Runge-Kutta method, two patients at once."""
    law = InfusedDoses()
    assert law.reads == ()
    state = dict(law.start(PUMP, {}))
    assert {s.name for s in law.states} == set(state)
    pump = {key: np.array([0.4, 0.0]) for key in PUMP}  # one is started, the other stopped
    key, steps = f"{dose(drug.name)}_in_effect", 60
    step = 60.0 * drug.half_life_min / steps

    def rates(at):
        return law.rates(at, pump, {}, {})

    def moved(at, by, slope):
        return {name: at[name] + by * slope[name] for name in at}

    for _ in range(steps):
        first = rates(state)
        second = rates(moved(state, step / 2, first))
        third = rates(moved(state, step / 2, second))
        fourth = rates(moved(state, step, third))
        state = {
            n: state[n] + step / 6 * (first[n] + 2 * second[n] + 2 * third[n] + fourth[n]) for n in state
        }
    np.testing.assert_allclose(state[key], [0.2, 0.1], rtol=1e-8)
    np.testing.assert_array_equal(law.in_effect(state, pump)[dose(drug.name)], state[key])


def test_a_dose_that_does_not_change_stays():
    law = InfusedDoses()
    found = law.rates(law.start(PUMP, {}), PUMP, {}, {})
    assert all(not np.any(rate) for rate in found.values())
