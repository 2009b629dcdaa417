"""Gases in time: steps against closed forms, balances of a step, and the steady state they lead to."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from eclsim.cases import read_case
from eclsim.components.exchangers import dry_gas_pressure, stpd_of_btps
from eclsim.gas.network import CONTENTS, Quantity, gas_of
from eclsim.gas.transport import HeldBlood, balanced, mixtures
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.measures import Measures, single
from eclsim.outputs.steady_beat import steady_beat
from gas_networks import flows_of

DRY, STPD = float(dry_gas_pressure(37.0)), 1000.0 * float(stpd_of_btps(37.0))
FLOW, VOLUME = 4.0, 2.0
"""L/min, L."""


@pytest.mark.slow
def test_a_compartment_is_washed_out_as_the_closed_form_says():
    """A lung that gives blood of content 1 flushes one compartment: c' = (c + q h / V) / (1 + q h / V)."""
    paths = (("lung", "b", "a"), ("back", "a", "b"))
    before, length = np.array([VOLUME, 1e-9]), 0.05
    contents = jnp.array([[0.2, 0.0], [0.2, 0.0]])
    for n in range(1, 6):
        held = HeldBlood(before / length, before / length, contents)
        mixed = mixtures(balanced(flows_of(paths, [FLOW, FLOW]), held), [0], held=held)
        assert mixed.kept is not None
        contents = mixed.compartments @ jnp.array([[1.0, 3.0]]) + mixed.kept[0]
        left = (1.0 + FLOW * length / VOLUME) ** -n
        np.testing.assert_allclose(contents[0], [1.0 - 0.8 * left, 3.0 - 3.0 * left], rtol=1e-7)


def test_a_step_fills_compartments_as_it_is_said_and_keeps_what_they_held():
    paths = (("lung", "b", "a"), ("back", "a", "b"))
    held = HeldBlood(np.array([9.0, 1.0]), np.array([8.0, 2.0]), np.array([[3.0, 0.0], [1.0, 0.0]]))
    flows = balanced(flows_of(paths, [1.2, 0.1]), held)
    np.testing.assert_allclose(flows.forward - flows.backward, [1.15, 0.15], atol=1e-8)
    mixed = mixtures(flows, [0], held=held)
    assert mixed.kept is not None
    contents = mixed.compartments @ jnp.array([[5.0, 0.0]]) + mixed.kept[0]
    gained = held.after @ contents - held.before @ held.contents
    assert float(gained[0]) == pytest.approx(1.2 * (5.0 - float(contents[0, 0])), rel=1e-6)


EXAMPLE = Path(__file__).parents[2] / "examples" / "veno_venous_gas.toml"


@pytest.fixture(scope="module")
def patient():
    """Flows and parameters of a patient on V-V ECMO, gas functions, and made-up volumes [L]."""
    own = model_of(read_case(EXAMPLE).case)
    beat = steady_beat(Batch.of(own), waveforms=None, keep=None)
    waves = {name: beat.waveform(name) for name in beat.signals}
    measures = Measures(waves, beat.waveforms[0].phases, own.circuit)
    steady, step = gas_of(own.circuit), gas_of(own.circuit, in_time=True)
    flows = [flow(name) for flow in (measures.forward, measures.backward) for name in steady.connections]
    numbers = np.array([*flows, *(own.values[name] for name in steady.parameters)], dtype=float)
    volumes = np.random.default_rng(4).uniform(0.05, 1.0, len(own.circuit.compartments))
    return own.circuit, numbers, steady, step, volumes


def state_of(function, numbers):
    state = np.asarray(single(function.compute, function.key)(numbers))
    return dict(zip(function.quantities, state, strict=True))


LUNGS_L, ALVEOLAR = 2.0, (110.0, 40.0)


def stepped(patient, contents, length, alveolar=ALVEOLAR):
    _, numbers, _, step, volumes = patient
    lungs = [LUNGS_L / length, *alveolar]
    numbers = np.concatenate([numbers, volumes / length, volumes / length, *contents, lungs])
    return state_of(step, numbers)


def alveolar_of(state):
    return [state[Quantity(gas, "within", "part")] for gas in ("PO2", "PCO2")]


def contents_of(patient, state):
    names = [c.name for c in patient[0].compartments]
    return np.array([[state[Quantity(what, "mixed", name)] for name in names] for what in CONTENTS])


def steady_state(patient):
    _, numbers, steady, *_ = patient
    return state_of(steady, numbers)


@pytest.mark.slow
def test_a_long_step_and_many_short_ones_end_in_the_steady_state(patient):
    goal = steady_state(patient)
    start = np.stack([np.full(len(patient[4]), 8.0), np.full(len(patient[4]), 60.0)])
    far = stepped(patient, start, 1e9)
    for quantity in patient[3].quantities:
        assert far[quantity] == pytest.approx(goal[quantity], rel=1e-6, abs=1e-9)
    contents, alveolar = start, ALVEOLAR
    for _ in range(60):
        state = stepped(patient, contents, 5.0, alveolar)
        contents, alveolar = contents_of(patient, state), alveolar_of(state)
    np.testing.assert_allclose(alveolar, alveolar_of(goal), rtol=1e-5)
    np.testing.assert_allclose(contents, contents_of(patient, goal), rtol=1e-5)


def test_what_blood_gains_in_a_step_is_what_exchangers_give(patient):
    volumes, length = patient[4], 1.0 / 90.0
    start = np.stack([np.linspace(4.0, 9.0, len(volumes)), np.linspace(62.0, 45.0, len(volumes))])
    state = stepped(patient, start, length)
    stored = 10.0 * (contents_of(patient, state) - start) @ volumes / length
    for amount, what in zip(stored, ("gained", "gained_co2"), strict=True):
        given = sum(number for (name, where, _), number in state.items() if (name, where) == (what, "at"))
        assert amount == pytest.approx(given, rel=1e-8)
        assert abs(given) > 5.0


def test_what_lungs_hold_more_is_what_they_breathe_in_less_what_they_give_away(patient):
    names, numbers, length = patient[3].parameters, patient[1], 1.0 / 90.0
    values = dict(zip(names, numbers[-len(names) :], strict=True))
    volumes = len(patient[4])
    start = np.stack([np.full(volumes, 12.0), np.full(volumes, 50.0)])
    state = stepped(patient, start, length)
    held = STPD * LUNGS_L / DRY * (np.array(alveolar_of(state)) - ALVEOLAR) / length
    gained = [state[Quantity(what, "at", "part")] for what in ("gained", "gained_co2")]
    breathed = STPD * values["gas.alveolar_ventilation_l_min"]
    inspired = np.array([values["gas.fio2"], 4e-4])
    out = breathed - sum(gained)
    expected = breathed * inspired - out * np.array(alveolar_of(state)) / DRY - gained
    np.testing.assert_allclose(held, expected, rtol=1e-6, atol=1e-6)
    assert np.abs(held).min() > 1.0


def test_steps_are_of_first_order(patient):
    """Against steps of an eighth, half the length halves the error."""
    goal = steady_state(patient)
    start = contents_of(patient, goal) * [[0.9], [1.05]]

    def after(count):
        contents, alveolar = start, alveolar_of(goal)
        for _ in range(count):
            state = stepped(patient, contents, 0.2 / count, alveolar)
            contents, alveolar = contents_of(patient, state), alveolar_of(state)
        return contents

    fine = after(64)
    errors = [np.abs(after(count) - fine).max() for count in (2, 4, 8)]
    assert 1.5 < errors[0] / errors[1] < 2.6
    assert 1.5 < errors[1] / errors[2] < 2.8
