"""Wash-in and wash-out of infusions against exponentials."""

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.course.course import course
from eclsim.course.engine import CourseOptions
from eclsim.drugs.published import PUBLISHED, InfusedDoses
from eclsim.goals.search import reach
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate
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
    result = law.rates(law.start(PUMP, {}), PUMP, {}, {})
    assert all(not np.any(rate) for rate in result.values())


@pytest.mark.slow
def test_a_course_of_a_pump_that_is_started_and_stopped():
    """Exponentials in closed form, and at each moment the steady beat at the dose that is in effect."""
    case = {
        "format": 1,
        "patient": {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75},
        "fluid": {"capillary_refill": False},
        "drugs": {},
        "events": [
            {"at_min": 5, "set": {"drugs.noradrenaline": 0.2}},
            {"at_min": 20, "set": {"drugs.noradrenaline": 0.0}},
        ],
    }
    sharp = CourseOptions(tolerance=0.001)  # of a change that is felt, 0.06 ug/kg/min
    result = course(read_mapping(case).case, minutes=30, every_min=5, outputs=["MAP"], options=sharp)
    state, lag = (
        result["drugs.noradrenaline_in_effect"],
        PUBLISHED["noradrenaline"].half_life_min / np.log(2.0),
    )
    start = 0.2 * (1.0 - np.exp(-15.0 / lag))
    for minute, dose_then in ((0, 0.0), (10, 0.2 * (1.0 - np.exp(-5.0 / lag))), (20, start)):
        assert float(state.sel(time_min=minute)) == pytest.approx(dose_then, abs=2e-4)
    assert float(state.sel(time_min=30)) == pytest.approx(start * np.exp(-10.0 / lag), abs=2e-4)
    steady = model_of(read_mapping({k: v for k, v in case.items() if k != "events"}).case)
    for minute in (10, 30):
        own = steady.with_values({dose("noradrenaline"): float(state.sel(time_min=minute))})
        at_moment = float(result["MAP"].sel(time_min=minute))
        assert at_moment == pytest.approx(float(simulate(own)["MAP"]), abs=0.02)


@pytest.mark.slow
def test_the_smallest_dose_that_holds_a_pressure_is_found():
    case = read_mapping({
        "format": 1, "drugs": {}, "parameters": {"Rmc": 0.35},
        "patient": {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 90},
    }).case  # fmt: skip
    result = reach(case, "MAP > 65", vary="drugs.noradrenaline")
    assert result.reached
    (needed,) = result.values
    assert 0.01 < needed < 1.0
    beat = simulate(model_of(case).with_values({dose("noradrenaline"): float(needed)}))
    assert float(beat["MAP"]) == pytest.approx(65.0, abs=0.05)
