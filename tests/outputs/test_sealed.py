"""A beat that closed valves make one of many is not passed off as the patient's."""

import json
from dataclasses import replace

import numpy as np
import pytest

from eclsim.app.beat import compute_beat, plain
from eclsim.app.knobs import turn
from eclsim.app.state import PageState
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import read_mapping
from eclsim.devices.ecmo import ecmo
from eclsim.identification.density import beats_of_members
from eclsim.orbit.model import model_of
from eclsim.orbit.status import NoDerivativesError, Status
from eclsim.orbit.steady import Batch, solve, start_state
from eclsim.outputs.alarms import findings
from eclsim.outputs.results import simulate, simulate_many
from eclsim.outputs.sealed import CLOSED_VALVE_L_MIN, sealed
from eclsim.outputs.steady_beat import measured, steady_beat
from eclsim.patient.circulation import circulation
from eclsim.regulation.attach import REFLEXES, with_reflex, with_volume_offset
from eclsim.reporting.beat_values import case_name
from eclsim.sensitivity.runs import SteadyBeatEvaluator
from eclsim.simulation.files import case_object
from model_catalogue import model

WEAK_LEFT = {"Emaxlv": 0.1, "ecmo.speed_rpm": 4500.0}
VALVES = ("tricuspid", "pulmonary", "mitral", "aortic")
SHUT = {f"{valve}_valve_flow": 0.0 for valve in VALVES}
LEFT = ("EDVLV", "ESVLV", "end_diastolic_pressure_lv", "ejection_fraction_lv", "PCWP")


@pytest.fixture(scope="module")
def beat():
    return simulate(model("V-A", **WEAK_LEFT))


def test_a_steady_beat_behind_closed_valves_is_one_of_many(beat):
    """Waiting from the published start ends at another steady beat than the search, and both stay."""
    assert beat.attrs["converged"] == 1
    assert beat.attrs["status"] == "one_of_many"
    patient, only = model("V-A", **WEAK_LEFT), np.array([0])
    orbits = solve(Batch.of(patient))
    waited = orbits.wait(only, start_state(patient)[:, None], 400)
    names = [c.name for c in patient.circuit.compartments]
    for states in (waited, orbits.states):
        assert np.abs(orbits.wait(only, states) - states).max() < 1e-5
    apart = (waited - orbits.states)[[names.index(n) for n in ("lv", "pvn", "svn")], 0]
    assert np.abs(apart).min() > 10.0


def test_simulate_says_that_it_is_and_marks_the_numbers(beat):
    (message,) = [w for w in beat.attrs["warnings"] if "not determined by the case" in w]
    assert "no blood passes the tricuspid, pulmonary, mitral and aortic valves throughout the beat" in message
    assert "the right ventricle, the pulmonary vessels with the left atrium and the left ventricle" in message
    assert "one of many" in beat.attrs["message"]
    assert case_object(beat)["one_of_many"] is True
    assert case_name(beat) == "V-A (VALVES SHUT: VOLUMES NOT DETERMINED)"
    for name in (*LEFT, "EDVRV", "MPAP", "MAP", "drainage_pressure"):
        assert beat[name].attrs["finding"]
    assert "finding" not in beat["systemic_flow"].attrs


@pytest.mark.slow
def test_what_another_start_moves_is_what_is_marked(beat):
    """Pressures of arteries and lines as well: what is shut in is missing there. Flows hold."""
    patient, only = model("V-A", **WEAK_LEFT), np.array([0])
    found = steady_beat(Batch.of(patient)).orbits
    waited = found.wait(only, start_state(patient)[:, None], 1000)
    other = measured(replace(found, states=waited), None, (), ())
    marked = [name for name in other.names if beat[name].attrs.get("finding")]
    moved = {
        n: abs(other.outputs()[n] - float(beat[n])) for n in other.names if beat[n].attrs["units"] == "mmHg"
    }
    assert moved["MAP"] > 1.0
    assert {name for name, change in moved.items() if change > 0.1} <= set(marked)
    assert abs(other.outputs()["PF"] - float(beat["PF"])) < 1e-3


@pytest.mark.slow
def test_where_a_ventricle_still_ejects_flows_are_marked_too():
    """An RVAD past a shut right ventricle: what that holds is missing where the left one fills."""
    pump = {"pump": "HM3", "speed_rpm": 3000, "inlet_site": "lv", "outlet_site": "ao"}
    right = {"pump": "HVAD", "speed_rpm": 2200, "inlet_site": "ra", "outlet_site": "pas"}
    raw = {
        "format": 1, "blood_volume_policy": "patient_held", "lvad": {"left": pump, "right": right},
        "patient": {"id": "P", "sex": "female", "age_years": 70, "heart_rate_bpm": 90},
        "parameters": {"Emaxlv": 0.3, "Emaxrv": 0.1, "Rmc": 0.8, "P0svn": 12.0},
    }  # fmt: skip
    patient, only = model_of(read_mapping(raw).case), np.array([0])
    beat = simulate(patient)
    assert beat.attrs["status"] == "one_of_many"
    assert any("the flows through the heart that still beats" in text for text in beat.attrs["warnings"])
    filled = model_of(read_mapping(raw | {"fluid": {"extra_volume_ml": 0}}).case)
    asked = steady_beat(Batch.of(filled), ("MAP", "heart_rate"))
    assert asked.undetermined_outputs() == ("MAP",)
    found = steady_beat(Batch.of(patient)).orbits
    waited = found.wait(only, start_state(patient)[:, None], 1000)
    other = measured(replace(found, states=waited), None, (), ()).outputs()
    moved = {name for name, value in other.items() if abs(value - float(beat[name])) > 0.01 * abs(value)}
    assert {"LVO", "CO", "lvad.left.flow", "systemic_flow"} <= moved
    assert moved <= {name for name in other if beat[name].attrs.get("finding")}


def test_a_batch_says_so_of_each_member_whatever_its_outputs():
    result = simulate_many(model("V-A"), {"Emaxlv": [1.5, 0.1], "ecmo.speed_rpm": [3425.0, 4500.0]}, ("MAP",))
    assert list(result.data_vars) == [
        "MAP",
        "status",
        "message",
        "warnings",
        "impossible",
        "beats",
        "residual",
    ]
    assert list(result["status"].values) == ["converged", "one_of_many"]
    assert result.attrs["failed"] == 0
    assert np.isfinite(result["MAP"].values).all()
    ejecting, shut = result["message"].values
    assert "one of many" not in ejecting
    assert "one of many: no blood passes the tricuspid" in shut


@pytest.mark.slow
def test_analyses_of_many_take_no_number_from_it():
    """Sensitivity indices, draws of a posterior and studies of schemes count it as lost, with its status."""
    patient = model("V-A")
    changes = {"Emaxlv": np.array([1.5, 0.1]), "ecmo.speed_rpm": np.array([3425.0, 4500.0])}
    beat = steady_beat(Batch(patient.circuit, {**patient.values, **changes}, 2), ("MAP",))
    assert list(beat.converged) == [True, True]
    assert list(beat.determined) == [True, False]
    assert list(np.isfinite(beat.determined_only().values[0])) == [True, False]
    evaluator = SteadyBeatEvaluator(patient.circuit, patient.values, ("MAP",), "as_published", resolution=1)
    runs = evaluator(changes, 2)
    assert [Status(k).word for k in runs.status] == ["converged", "one_of_many"]
    assert list(np.isfinite(runs.values[:, 0])) == [True, False]
    draws = beats_of_members(patient, {**patient.values, **changes}, 2, ("MAP",)).values.T
    assert list(np.isfinite(draws[:, 0])) == [True, False]
    with pytest.raises(NoDerivativesError, match="singular"):
        beat.linearise(("MAP",), ("Rmc",), 1)


def test_the_page_gets_it_beside_what_else_is_to_be_said_of_a_number():
    state = PageState(PRESETS["paper"].case())
    for key, value in (("parameters.Emaxlv", 0.1), ("parameters.Emaxrv", 0.1), ("ecmo.speed_rpm", 4500)):
        state = state.with_case(turn(state.case, key, value))
    data = json.loads(json.dumps(plain(compute_beat(state), ())))
    assert [kind for kind, text in data["notes"] if "not determined by the case" in text] == ["caution"]
    assert "not determined by the case" in data["cautions"]["EDVLV"]
    assert "distension or unloading" in data["cautions"]["EDVLV"]
    assert "not determined by the case" in data["cautions"]["EDVRV"]


VPA = circulation() + ecmo("ra", "pas")
BARE = circulation()


def test_only_what_the_closed_valves_part_is_named():
    right = {name: 0.0 if name[0] in "tp" else 5.0 for name in SHUT}
    only = sealed(right | {"EDVRV": 90.0, "MAP": 70.0, "PF": 4.0, "oxygenator_pressure_drop": 20.0}, VPA)
    assert only is not None
    assert only.parts == (("rv",),)
    left = ("mitral_valve_flow", "aortic_valve_flow")
    assert only.concerns == (*left, "EDVRV", "MAP", "PF", "oxygenator_pressure_drop")
    none = sealed(SHUT | {"EDVRV": 90.0, "MAP": 70.0, "PF": 4.0, "oxygenator_pressure_drop": 20.0}, VPA)
    assert none is not None
    assert none.concerns == ("EDVRV", "MAP")
    assert "how much blood the right ventricle holds is not determined" in only.sentence
    levels = ("effluent_pressure", "iabp_augmented_pressure", "iabp_end_diastolic_pressure")
    differences = ("pump_head", "transmembrane_pressure", "iabp_augmentation")
    shut = sealed(SHUT | dict.fromkeys((*levels, *differences), 1.0), VPA)
    assert shut is not None
    assert shut.concerns == levels
    assert sealed(SHUT | {"heart_rate": 80.0}, with_volume_offset(VPA)).concerns == ()
    regulated = with_reflex(with_volume_offset(VPA), REFLEXES["ursino1998"])
    assert sealed(SHUT | {"heart_rate": 80.0}, regulated).concerns == ("heart_rate",)
    still = sealed(SHUT, BARE)
    assert still is not None
    assert still.parts == (("rv",), ("pas", "part", "pvn", "la"), ("lv",))


def test_one_closed_valve_shuts_nothing_in():
    for name in SHUT:
        assert sealed(dict.fromkeys(SHUT, 5.0) | {name: 0.0}, BARE) is None
    assert sealed(dict.fromkeys(SHUT, 2.0 * CLOSED_VALVE_L_MIN), BARE) is None
    assert sealed({}, BARE) is None
    assert [f.quantity for f in findings(SHUT, {}, BARE)] == ["aortic_valve_flow", "Vrv"]
