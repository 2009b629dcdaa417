"""Beats solved together with the gases of their blood: rest, signs, derivatives, courses, refusals."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import eclsim
from eclsim.cases.reading import read_mapping
from eclsim.circuit.assembly import assemble
from eclsim.identification.density import GradientEvaluator, NoSteadyBeatError
from eclsim.orbit.equation import Anchor, OrbitOptions
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch, SolvedOrbits
from eclsim.outputs.coupling import settle
from eclsim.outputs.regulation import SOLVED_BY
from eclsim.outputs.steady_beat import steady_beat

PATIENT = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}
LUNGS = {"haemoglobin_g_dl": 12, "fio2": 0.21, "alveolar_ventilation_l_min": 5, "shunt_fraction": 0.05}
ALL = {"baroreflex": 1, "chemoreflex": 1, "hypoxic_vasodilation": 1, "hypoxic_vasoconstriction": 1}
OUTPUTS = ["MAP", "MPAP", "CO", "PaO2", "SvO2", "heart_rate", "local_resistance_factor",
           "hypoxic_resistance_factor"]  # fmt: skip


def case(regulation=ALL, **sections):
    known = {"format": 1, "patient": PATIENT, "gas": LUNGS, "regulation": regulation}
    return read_mapping({k: v for k, v in (known | sections).items() if v}).case


@pytest.fixture(scope="module")
def model():
    return model_of(case())


@pytest.fixture(scope="module")
def hypoxia(model):
    """All of it switched off and on one by one in a patient who breathes less oxygen."""
    off = dict.fromkeys((f"regulation.{key}" for key in ALL), np.zeros(6))
    for k, name in enumerate(off, start=1):
        off[name] = np.where(np.isin(np.arange(6), (k, 5)), 1.0, 0.0)
    return eclsim.simulate_many(model, {"gas.fio2": 0.13, **off}, OUTPUTS)


@pytest.mark.slow
def test_at_rest_the_patient_is_unchanged(model):
    names = ["MAP", "CO", "PaO2", "PaCO2", "EDVLV"]
    plain = eclsim.simulate_many(model_of(case(regulation=None)), {}, names)
    regulated = eclsim.simulate_many(model, {}, names)
    for name in names:
        assert float(regulated[name][0]) == pytest.approx(float(plain[name][0]), rel=1e-8)


@pytest.mark.slow
def test_hypoxia_does_what_each_of_them_is_for(hypoxia):
    assert (hypoxia.status == "converged").all()
    none, _, chemoreflex, organs, lung, everything = range(6)
    change = {name: hypoxia[name].values - hypoxia[name].values[none] for name in OUTPUTS}
    assert (
        hypoxia["local_resistance_factor"].values[none] == hypoxia["hypoxic_resistance_factor"][none] == 1.0
    )
    assert change["heart_rate"][chemoreflex] > 5.0
    assert change["MAP"][chemoreflex] > 5.0
    assert change["MAP"][organs] < -5.0
    assert change["CO"][organs] > 0.1
    assert change["SvO2"][organs] > 0.5
    assert change["MPAP"][lung] > 1.0
    assert hypoxia["hypoxic_resistance_factor"][lung] > 1.3
    assert change["CO"][everything] > 1.0
    assert 0.0 < change["MAP"][everything] < change["MAP"][chemoreflex]


@pytest.mark.slow
def test_what_was_solved_for_equals_its_output(model):
    batch = Batch.of(model.with_values({"gas.fio2": 0.13}))
    beat = steady_beat(batch, [SOLVED_BY[n] for n in SOLVED_BY if n in model.circuit.parameter_names()])
    assert len(beat.coupled) == 4
    for name in beat.coupled:
        assert beat.output(SOLVED_BY[name]) == pytest.approx(beat.batch.values[name], rel=1e-6)


@pytest.mark.slow
def test_a_member_depends_on_no_other(model, hypoxia):
    single = eclsim.simulate_many(model, {"gas.fio2": 0.13}, OUTPUTS)
    for name in OUTPUTS:
        assert float(single[name][0]) == pytest.approx(float(hypoxia[name][5]), rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"gas.fio2": 0.13}, ["gas.vo2_ml_min", "Rmc", "regulation.chemoreflex"]),
        (
            {
                "gas.fio2": 0.3,
                "gas.alveolar_ventilation_l_min": 3.5,
                "regulation.carbon_dioxide_response": 0.6,
            },
            ["gas.alveolar_ventilation_l_min", "regulation.carbon_dioxide_response"],
        ),
    ],
)
def test_derivatives_include_the_answer_to_gases(model, changes, names):
    here = model.with_values(changes)
    exact = eclsim.derivatives(here, OUTPUTS, names)
    tight = OrbitOptions(1e-11, 1e-10)
    for name in names:
        step = 1e-3 * here.values[name]
        ends = eclsim.simulate_many(
            here, {name: here.values[name] + step * np.array([-1, 1])}, OUTPUTS, options=tight
        )
        slopes = np.array([np.diff(ends[o].values)[0] / (2.0 * step) for o in OUTPUTS])
        scale = 1e-3 * np.abs(slopes).max()
        np.testing.assert_allclose(exact.sel(parameter=name), slopes, rtol=1e-3, atol=1e-3 * scale)


RESISTANCE = "regulation.local_resistance"


def settled_at(model, answer):
    """What three members settle at that begin at 1, and how many were computed in each round.

    Args:
        model: whose circuit it is.
        answer: map (p, states that searches begin at or None) -> o(p), first states.
    """
    values, asked = {**model.values, RESISTANCE: np.full(3, np.nan)}, []

    def measure(part, start):
        asked.append(part.count)
        given = start.state[0] if isinstance(start, Anchor) else None
        output, state = answer(np.broadcast_to(part.values[RESISTANCE], (part.count,)), given)
        states = np.zeros((assemble(part.circuit).layout.size, part.count))
        states[0] = state
        orbits = SolvedOrbits(
            states, np.zeros(part.count, int), np.ones(part.count, int), states[0], states[0],
            batch=part, resolution=np.ones(part.count, int), width=1,
        )  # fmt: skip
        return SimpleNamespace(output=lambda _: output, orbits=orbits)

    coupled = settle(Batch(model.circuit, values, 3), (RESISTANCE,), cast(Any, measure), OrbitOptions())
    return np.where(coupled.settled, coupled.orbits.batch.values[RESISTANCE], np.nan), asked


def test_broydens_method_finds_a_fixed_point_that_iteration_leaves(model):
    """o(p) = 2 p^-3 has its fixed point at 2^(1/4); repeated insertion diverges."""
    found, _ = settled_at(model, lambda p, _: (np.where(p > 1.9, np.nan, 2.0 * p**-3.0), 0.0))
    np.testing.assert_allclose(found, 2.0**0.25, rtol=1e-6)


def test_who_has_settled_is_not_computed_again(model):
    """One member is there at once, one after a round; the third needs more."""

    def answer(p, states):
        member = np.arange(3.0) if states is None else states
        return np.choose(member.astype(int), [p, np.full(len(p), 1.1), 2.0 * p**-3.0]), member

    found, asked = settled_at(model, answer)
    np.testing.assert_allclose(found, [1.0, 1.1, 2.0**0.25], rtol=1e-6)
    assert asked[:3] == [3, 2, 1]


def test_of_two_beats_each_member_keeps_its_own(model):
    """Two beats exist at every p, with fixed points at 1.3 and 0.8; from rest either is found."""

    def answer(p, states):
        branch = np.sin(1e3 * p) > 0.0 if states is None else states > 0.0
        return np.where(branch, 1.3**1.5, 0.8**1.5) / np.sqrt(p), branch

    found, _ = settled_at(model, answer)
    np.testing.assert_allclose(found, 1.3, rtol=1e-6)


def test_without_a_gas_state_the_member_says_so(model):
    result = eclsim.simulate_many(model, {"gas.alveolar_ventilation_l_min": np.array([5.0, 0.01])}, ["MAP"])
    assert result.status.values.tolist() == ["converged", "not_converged"]
    assert np.isnan(result.MAP[1])
    assert "regulation and blood gases agree" in str(result.message.values[1])


def test_what_cannot_solve_for_gases_refuses(model):
    adaptive = eclsim.simulate(model, solver="adaptive")
    assert adaptive.attrs["status"] == "invalid_input"
    assert "responds to the gases" in adaptive.attrs["message"]

    density = SimpleNamespace(
        prior=SimpleNamespace(x_of=lambda z: z),
        policy="as_published",
        values=lambda x: model.values,
        model=model,
    )
    with pytest.raises(NoSteadyBeatError, match="importance"):
        GradientEvaluator(cast(Any, density), np.zeros(1))


@pytest.mark.slow
def test_a_long_course_ends_in_the_steady_beat(model):
    change = {"at_min": 5, "set": {"gas.alveolar_ventilation_l_min": 2.5}}
    shut = {"capillary_refill": False}
    course = eclsim.course(case(events=[change], fluid=shut), minutes=1200, outputs=OUTPUTS)
    end = eclsim.simulate(model.with_values({"gas.alveolar_ventilation_l_min": 2.5}))
    for name in OUTPUTS:
        assert float(course[name][-1]) == pytest.approx(float(end[name]), rel=1e-4)


@pytest.mark.slow
def test_what_is_solved_with_the_beat_has_no_derivative_unless_it_is_held():
    """With another parameter it ended in an error about shapes of arrays, alone in numbers."""
    model = model_of(case({"hypoxic_vasodilation": 0.8}))
    assert RESISTANCE not in model.parameters
    for names in ([RESISTANCE], ["Rmc", RESISTANCE]):
        with pytest.raises(eclsim.UnknownValueError, match=f"{RESISTANCE} is solved with the beat: give it"):
            eclsim.derivatives(model, ["MAP"], names)
    held = model.with_values({RESISTANCE: 1.3})
    assert RESISTANCE in held.parameters
    slopes = eclsim.derivatives(held, ["MAP"], ["Rmc", RESISTANCE]).values[0]
    ends = eclsim.simulate_many(held, {RESISTANCE: 1.3 + np.array([-1e-3, 1e-3])}, ["MAP"])["MAP"].values
    assert slopes[1] == pytest.approx(np.diff(ends)[0] / 2e-3, rel=1e-3)
    every = eclsim.derivatives(model, ["MAP", "SvO2"], ["Emaxlv", "Rmc", "Emaxlv"]).values
    np.testing.assert_array_equal(every[:, 0], every[:, 2])
