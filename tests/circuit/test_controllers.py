"""Controllers: states that change once a beat and are solved for together with the steady beat."""

import numpy as np
import pytest

from eclsim.beat.heartbeat import beat_program
from eclsim.circuit import Circuit, CircuitError
from eclsim.circuit.assembly import assemble
from eclsim.circuit.network import Control, Statistic, maximum_of, mean_of, minimum_of
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.execution import Execution
from eclsim.orbit.independent import AdaptiveBeats
from eclsim.orbit.iteration import compiled_search
from eclsim.orbit.steady import Batch, solve, start_state
from eclsim.orbit.transient import follow
from eclsim.outputs.results import derivatives
from eclsim.outputs.steady_beat import steady_beat
from model_catalogue import CIRCUITS, model, regulated
from user_components import SetPointControl

MEAN_PRESSURE = mean_of("Psart")
CASES = {
    "resistance on V-A": ("V-A", mean_of("Pao"), 80.0, ("Rmc",), (True,)),
    "resistance and heart rate": ("none", MEAN_PRESSURE, 41.0, ("Rmc", "heart_rate_bpm"), (True, False)),
    "elastance by the largest pressure": ("none", maximum_of("Pao"), 45.0, ("Rmc", "Emaxlv"), (True, True)),
    "resistance by the smallest pressure": ("none", minimum_of("Pao"), 39.0, ("Rmc",), (True,)),
    "heart rate by a valve's flow": ("none", mean_of("Qlv"), 38.0, ("heart_rate_bpm",), (True,)),
}
OUTPUTS = ("MAP", "CO", "EDVLV")
"""The same for all derivatives, which are compiled for each set of outputs."""
ACCURATE = OrbitOptions(tolerance=1e-11, error_tolerance=1e-10)


def solved(patient):
    return solve(Batch.of(patient), ACCURATE)


def outputs_of(patient):
    return steady_beat(Batch.of(patient), OUTPUTS, options=ACCURATE).outputs()


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_steady_value_is_where_marching_beat_by_beat_ends(case):
    patient = regulated(*CASES[case])
    orbit = solved(patient).states[:, 0]
    program = beat_program(patient.circuit)
    packed = Batch.of(patient).packed(program)
    state = compiled_search(program, 1).wait(start_state(patient)[:, None], packed, 2000)[:, 0]
    assert abs(orbit[-1]) > 0.02, "the controller has something to do"
    np.testing.assert_allclose(state, orbit, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
def test_signals_that_the_search_derives_are_those_recorded_step_by_step():
    patient = regulated(*CASES["resistance and heart rate"])
    program, state = beat_program(patient.circuit), solved(patient).states
    packed = Batch.of(patient).packed(program)
    names, derived = compiled_search(program, 1).record(state, packed, program.signals)
    stepwise = np.asarray(program.trace(names)(state[:, 0], packed[:, 0])[1])
    assert {"Psart", "Psart'", "Qlv~", "Vlv'"} <= set(names)
    np.testing.assert_allclose(derived[..., 0], stepwise, rtol=1e-10, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["resistance and heart rate", "resistance by the smallest pressure"])
def test_the_independent_path_regulates_to_the_same_beat(case):
    patient = regulated(*CASES[case])
    orbit = solved(patient).states[:, 0]
    beats, state = AdaptiveBeats(patient), orbit
    for _ in range(60):
        state = beats.beat(state)
    scales = assemble(patient.circuit).layout.scales
    assert (np.abs(state - orbit) <= 3e-3 * np.abs(orbit) + 1e-2 * scales).all()


def test_a_course_in_time_has_beats_of_the_length_in_effect():
    patient = regulated(*CASES["resistance and heart rate"])
    course = follow(patient, 30.0, ("Vlv",))
    starts = course.time[:: course.steps_per_beat]
    lengths = np.diff(starts)
    assert lengths[0] == pytest.approx(60.0 / patient.values["heart_rate_bpm"])
    effect = assemble(patient.circuit).in_effect(patient.values, course.state)
    assert lengths[-1] == pytest.approx(60.0 / float(effect["heart_rate_bpm"]), rel=1e-2)
    assert abs(lengths[-1] / lengths[0] - 1.0) > 0.02
    assert course.time[-1] <= 30.0


@pytest.mark.slow
def test_what_is_read_is_the_output_and_reaches_its_set_point():
    patient = regulated(*CASES["resistance on V-A"])
    steady = solved(patient)
    search = steady.search(0)
    _, recorded = search.beat(steady.states[:, 0], steady.batch.packed(search.program)[:, 0])
    widths = np.diff(search.program.grid.phases)
    mean = 0.5 * (widths + np.roll(widths, -1)) @ recorded[:, search.signals.index("Pao")]
    assert mean == pytest.approx(80.0, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_derivatives_match_central_differences(case):
    patient = regulated(*CASES[case])
    parameters = ("set_point", "Rmc", "Csart", "heart_rate_bpm", "Emaxlv")
    exact = derivatives(patient, OUTPUTS, parameters).values
    numeric = np.empty_like(exact)
    for k, name in enumerate(parameters):
        step = 1e-4 * patient.values[name]
        high, low = (outputs_of(patient.with_values({name: patient.values[name] + s})) for s in (step, -step))
        numeric[:, k] = [(high[o] - low[o]) / (2.0 * step) for o in OUTPUTS]
    values = np.array([patient.values[p] for p in parameters])
    # An extreme is read at the ends of steps, and which step that is changes with the parameters.
    tolerance = 2e-3 if CASES[case][1].statistic is Statistic.MEAN else 1e-2
    np.testing.assert_allclose(exact * values, numeric * values, rtol=tolerance, atol=tolerance)


@pytest.mark.slow
def test_a_controller_cannot_be_shifted_by_what_it_makes_up_for():
    """At the set point the reading's own derivative with respect to anything else is zero."""
    patient = regulated(*CASES["resistance on V-A"])
    slopes = derivatives(patient, OUTPUTS, ("set_point", "Rmc", "Emaxlv"))
    mean = slopes.sel(output="MAP")
    assert float(mean.sel(parameter="set_point")) == pytest.approx(1.0, abs=0.02)
    assert abs(float(mean.sel(parameter="Rmc")) * patient.values["Rmc"]) < 0.05


@pytest.mark.slow
def test_a_batch_equals_each_patient_alone():
    patient = regulated(*CASES["resistance and heart rate"])
    points = np.array([39.0, 40.0, 41.5])
    values = {**patient.values, "set_point": points}
    many = solve(Batch(patient.circuit, values, 3), ACCURATE, execution=Execution(width=32)).states
    one = [solved(patient.with_values(set_point=float(p))).states[:, 0] for p in points]
    np.testing.assert_allclose(many, np.stack(one, axis=1), rtol=1e-7, atol=1e-7)


def test_the_state_has_a_block_for_controllers():
    layout = assemble(regulated(*CASES["resistance on V-A"]).circuit).layout
    assert layout.controllers.names == ("reflex.drive",)
    assert layout.names[-1] == "reflex.drive"
    assert layout.conserved()[layout.controllers.where] == 0.0
    assert layout.size == assemble(CIRCUITS["V-A"]).layout.size + 1


def test_values_in_effect_are_the_given_ones_without_controllers():
    patient = model("none")
    assembly = assemble(patient.circuit)
    assert assembly.in_effect(patient.values, start_state(patient)) is patient.values
    other = regulated(*CASES["resistance and heart rate"])
    state = solved(other).states[:, 0]
    effect = assemble(other.circuit).in_effect(other.values, state)
    factor = 1.0 + 0.5 * np.tanh(state[-1])
    assert float(effect["Rmc"]) == pytest.approx(other.values["Rmc"] * factor)
    assert float(effect["heart_rate_bpm"]) == pytest.approx(other.values["heart_rate_bpm"] / factor)
    assert effect["Csart"] == other.values["Csart"]


def test_mistakes_in_the_wiring_are_named():
    law = SetPointControl(80.0, "gain")
    table = (
        Control("one", law, (mean_of("Psarrt"),), ("Rmmc",)),
        Control("two", law, (mean_of("Psart'"),), ("Rmc",)),
        Control("two", law, (mean_of("Pao"),), ("Rmc",)),
    )
    with pytest.raises(CircuitError) as caught:
        assemble(CIRCUITS["none"] + Circuit(controllers=table))
    assert caught.value.mistakes == [
        "controller 'two' appears 2 times: names are unique",
        "controller 'one': 'Psarrt' is not a signal of the circuit that it can read; did you mean Psart?",
        "controller 'one': it acts on 'Rmmc', which is not a parameter of the circuit; "
        "did you mean Rmc or Rpmc?",
        "controller 'two': 'Psart'' is not a signal of the circuit that it can read; did you mean Psart?",
        "controller 'two': it acts on 'Rmc', and so does controller 'two'",
    ]


def test_a_controller_is_printed_and_put_under_a_prefix():
    circuit = regulated("V-A", mean_of("Pecmodrain"), 2.0, ("ecmo.speed_rpm", "heart_rate_bpm")).circuit
    assert "mean Pecmodrain -> ecmo.speed_rpm, heart_rate_bpm" in str(circuit)
    (other,) = circuit.prefixed("ecmo.left").controllers
    assert other.name == "ecmo.left.reflex"
    assert other.reads == (mean_of("Pecmo.left.ecmodrain"),)
    assert other.acts_on == ("ecmo.left.speed_rpm", "heart_rate_bpm")
    assert other.component == SetPointControl("ecmo.left.set_point", "ecmo.left.gain")
