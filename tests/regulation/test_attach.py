"""Regulated circuits: unchanged at rest, solved together with the beat, exact to first order."""

from dataclasses import replace

import numpy as np
import pytest

from eclsim.beat.heartbeat import beat_program
from eclsim.cases.reading import read_mapping
from eclsim.circuit.assembly import assemble
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.execution import Execution
from eclsim.orbit.independent import AdaptiveBeats
from eclsim.orbit.iteration import compiled_search
from eclsim.orbit.model import Model, model_of, nominal_values
from eclsim.orbit.steady import Batch, solve, start_state
from eclsim.outputs.results import derivatives
from eclsim.outputs.steady_beat import steady_beat
from eclsim.parameters.regulation import (
    EXTRA_VOLUME,
    GAIN,
    PARAMETERS,
    SET_POINT,
    UNSTRESSED,
    VENOUS_SET_POINT,
)
from eclsim.regulation.attach import REFLEXES, with_reflex, with_volume_offset
from model_catalogue import model

ACCURATE = OrbitOptions(tolerance=1e-11, error_tolerance=1e-10)
PRESSURES = ("MAP", "right_atrial_pressure")
OUTPUTS = ("MAP", "CO", "EDVLV", "PCWP")
SETTINGS = {key: parameter.value for key, parameter in PARAMETERS.items()}


def offset(changes=None):
    """The paper's patient, with veins whose unstressed volume can change."""
    plain = model("none")
    return Model(with_volume_offset(plain.circuit), {**plain.values, **SETTINGS}).with_values(changes)


def reflex(which, changes):
    plain = offset()
    return replace(plain, circuit=with_reflex(plain.circuit, REFLEXES[which])).with_values(changes)


def beat(patient, names=OUTPUTS, **options):
    return steady_beat(Batch.of(patient), names, options=ACCURATE, **options)


@pytest.fixture(scope="module")
def rest():
    """Pressures of the unregulated patient, which are the set points."""
    result = beat(model("none"), PRESSURES).outputs()
    return {SET_POINT: result["MAP"], VENOUS_SET_POINT: result["right_atrial_pressure"]}


@pytest.mark.slow
def test_an_offset_of_zero_is_the_published_patient_in_every_bit():
    plain, with_offset = (steady_beat(Batch.of(one)) for one in (model("none"), offset()))
    assert set(plain.names) < set(with_offset.names)
    for name in plain.names:
        np.testing.assert_array_equal(plain.output(name), with_offset.output(name))


@pytest.mark.slow
def test_receptors_of_the_atrium_feel_its_transmural_pressure():
    """A tamponade raises the catheter's pressure and lowers what stretches the wall: veins tighten."""
    raw = {
        "format": 1, "patient": {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75},
        "physiology": {"pericardium": True}, "regulation": {"baroreflex": 1.0, "model": "heldt2010"},
        "parameters": {"Csvn": 95.0, "P0svn": 8.0},
    }  # fmt: skip
    patient = model_of(read_mapping(raw).case)
    names = ("right_atrial_pressure", "pericardial_pressure", "unstressed_volume", "heart_rate")
    rest = beat(patient, names).outputs()
    assert rest["heart_rate"] == pytest.approx(75.0, rel=1e-6)
    felt = rest["right_atrial_pressure"] - rest["pericardial_pressure"]
    assert patient.values[VENOUS_SET_POINT] == pytest.approx(felt, abs=1e-6)
    tamponade = beat(patient.with_values({"pericardium_ml": 80.0}), names).outputs()
    assert tamponade["right_atrial_pressure"] > rest["right_atrial_pressure"] + 1.0
    assert tamponade["right_atrial_pressure"] - tamponade["pericardial_pressure"] < felt - 0.3
    assert tamponade["unstressed_volume"] < rest["unstressed_volume"] - 150.0


@pytest.mark.slow
def test_blood_given_is_blood_and_unstressed_volume_is_not():
    patients = (offset(), offset({EXTRA_VOLUME: 300.0}), offset({UNSTRESSED: -300.0}))
    plain, given, shifted = (beat(patient) for patient in patients)
    assert given.volume("patient") - plain.volume("patient") == pytest.approx(300.0, abs=1e-6)
    assert shifted.volume("patient") == pytest.approx(plain.volume("patient"), abs=1e-6)
    np.testing.assert_allclose(given.values, shifted.values, rtol=1e-9)
    assert given.outputs()["CO"] > 1.1 * plain.outputs()["CO"]


def test_blood_given_equals_veins_that_were_filled_to_a_higher_pressure():
    """Another way to the same: the published start pressure of the veins, raised by 300 mL / Csvn."""
    plain = model("none")
    fuller = plain.with_values({"P0svn": plain.values["P0svn"] + 300.0 / plain.values["Csvn"]})
    np.testing.assert_allclose(beat(fuller).values, beat(offset({EXTRA_VOLUME: 300.0})).values, rtol=1e-9)


@pytest.mark.parametrize("which", REFLEXES)
def test_a_patient_at_rest_is_unchanged(which, rest):
    plain, regulated = beat(model("none")), beat(reflex(which, rest))
    np.testing.assert_allclose(regulated.values, plain.values, rtol=1e-8)
    assert regulated.volume("patient") == pytest.approx(plain.volume("patient"), abs=1e-6)


@pytest.mark.parametrize("which", REFLEXES)
def test_lost_blood_is_answered_and_the_solved_beat_is_where_marching_ends(which, rest):
    patient = reflex(which, {**rest, EXTRA_VOLUME: -150.0})
    regulated, bled = beat(patient), beat(offset({EXTRA_VOLUME: -150.0}))
    kept, lost = (rest[SET_POINT] - one.outputs()["MAP"] for one in (regulated, bled))
    assert 0.0 < kept < 0.6 * lost
    assert regulated.volume("patient") == pytest.approx(bled.volume("patient"), abs=1e-6)
    program, state = beat_program(patient.circuit), start_state(patient)
    packed = Batch.of(patient).packed(program)
    state = compiled_search(program, 1).wait(state[:, None], packed, 1500)[:, 0]
    np.testing.assert_allclose(state, regulated.orbits.states[:, 0], rtol=1e-6, atol=1e-6)


@pytest.mark.slow
def test_the_independent_path_regulates_to_the_same_beat(rest):
    patient = reflex("heldt2004", {**rest, EXTRA_VOLUME: -150.0})
    orbit = solve(Batch.of(patient), ACCURATE).states[:, 0]
    beats, state = AdaptiveBeats(patient), orbit
    for _ in range(40):
        state = beats.beat(state)
    layout = assemble(patient.circuit).layout
    for block in (layout.volumes, layout.controllers):
        np.testing.assert_allclose(state[block.where], orbit[block.where], rtol=3e-3, atol=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize("which", REFLEXES)
def test_derivatives_match_central_differences(which, rest):
    patient = reflex(which, {**rest, EXTRA_VOLUME: -150.0, GAIN: 0.7})
    parameters = (GAIN, SET_POINT, EXTRA_VOLUME, UNSTRESSED, "Rmc", "Emaxlv", "heart_rate_bpm")
    parameters += (VENOUS_SET_POINT,) if which != "ursino1998" else ()
    exact = derivatives(patient, OUTPUTS, parameters).values
    steps = np.array([max(1e-4 * abs(patient.values[p]), 1e-2 * (p == UNSTRESSED)) for p in parameters])
    shifts = np.concatenate([np.diag(steps), -np.diag(steps)])
    values = {p: patient.values[p] + shifts[:, k] for k, p in enumerate(parameters)}
    many = Batch(patient.circuit, {**patient.values, **values}, len(shifts))
    table = steady_beat(many, OUTPUTS, options=ACCURATE, execution=Execution(width=1)).values
    numeric = (table[:, : len(steps)] - table[:, len(steps) :]) / (2.0 * steps)
    size = np.array([max(abs(patient.values[p]), 100.0 * (p == UNSTRESSED)) for p in parameters])
    outputs = beat(patient).values
    np.testing.assert_allclose(exact * size / outputs, numeric * size / outputs, rtol=1e-3, atol=1e-4)


def test_searches_begin_at_the_published_patient():
    circuit = reflex("heldt2004", {}).circuit
    nominal = nominal_values(circuit)
    assert nominal is not None
    own = {key: value for key, value in SETTINGS.items() if key in circuit.parameter_names()}
    assert {key: nominal[key] for key in own} == own


@pytest.mark.slow
def test_regions_are_regulated_as_the_undivided_patient_is():
    """Factors and the veins' volume are divided among both halves of the body."""
    result = {}
    for regional in (False, True):
        case = {
            "format": 1,
            "patient": {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75},
            "physiology": {"regional": regional},
            "fluid": {"extra_volume_ml": -150},
            "drugs": {"noradrenaline": 0.1},
            "regulation": {"baroreflex": 1, "set_point_mmHg": 66},
        }
        names = ("MAP", "CO", "heart_rate", "systemic_resistance_factor", "unstressed_volume")
        result[regional] = beat(model_of(read_mapping(case).case), names)
    whole, divided = (result[key].outputs() for key in (False, True))
    assert result[True].converged.all()
    for name in ("systemic_resistance_factor", "heart_rate", "unstressed_volume", "MAP", "CO"):
        assert divided[name] == pytest.approx(whole[name], rel=0.05), name
    given, held = (result[key].volume("patient") for key in (False, True))
    assert held == pytest.approx(given, rel=1e-2)
