import numpy as np
import pytest

from eclsim.beat.heartbeat import beat_program
from eclsim.beat.vectorisation import FEW
from eclsim.circuit.assembly import assemble
from eclsim.orbit.equation import OrbitProblem
from eclsim.orbit.model import PATIENT_HELD, UnknownValueError
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, start_state, steady_beats
from eclsim.outputs.dataset import simulate
from eclsim.outputs.evaluation import batch_outputs
from eclsim.outputs.variants import simulate_many
from model_catalogue import CIRCUITS, model

CLINICAL = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO")


def problem_of(steady, member):
    program = beat_program(steady.batch.circuit, int(steady.resolution[member]))
    return OrbitProblem(program, steady.batch.packed(program), steady.batch.volume()).take([member])


def varied(name, count, spread=0.4, seed=1):
    """Patients around the paper's, every resistance, compliance and elastance varied on a log scale."""
    base, rng = model(name), np.random.default_rng(seed)
    values = dict(base.values)
    for key in values:
        if key[0] in "RCE" and "." not in key:
            values[key] = base.values[key] * (1.0 + spread) ** rng.uniform(-1.0, 1.0, count)
    return Batch(base.circuit, values, count)


@pytest.fixture(scope="module")
def many():
    """Forty patients on V-A ECMO with CRRT."""
    return steady_beats(varied("V-A, CRRT g", 40))


@pytest.mark.parametrize("name", CIRCUITS)
def test_a_solved_beat_repeats_itself(name):
    patient = model(name)
    steady = steady_beats(Batch(patient.circuit, patient.values, 1))
    assert steady.orbits.status[0] == Status.CONVERGED
    problem, state = problem_of(steady, 0), steady.orbits.states
    assert problem.trial(state).change[0] <= 1e-8
    assert steady.orbits.residual[0] <= 1e-8


def test_all_the_blood_is_there(many):
    volumes = assemble(many.batch.circuit).layout.volumes.where
    start = sum(assemble(many.batch.circuit).start_volumes(many.batch.values))
    np.testing.assert_allclose(many.orbits.states[volumes].sum(axis=0), start, rtol=1e-8)


def test_most_patients_converge_within_a_few_beats(many):
    assert (many.orbits.status == Status.CONVERGED).all()
    assert np.median(many.orbits.beats) <= 20


def test_converged_means_that_ten_more_beats_change_nothing(many):
    for member in np.flatnonzero(many.orbits.status == Status.CONVERGED):
        problem, state = problem_of(many, member), many.orbits.states[:, [member]]
        later = state
        for _ in range(10):
            later = problem.beat(later)
        assert problem.trial(state, later).change[0] < 1e-7


def test_a_patient_does_not_depend_on_the_others(many):
    batch = many.batch
    for member in (0, 17, 39):
        alone = {key: np.ravel(np.broadcast_to(v, batch.count))[member] for key, v in batch.values.items()}
        state = steady_beats(Batch(batch.circuit, alone, 1)).orbits.states[:, 0]
        np.testing.assert_allclose(state, many.orbits.states[:, member], rtol=1e-10, atol=1e-10)


def test_order_does_not_matter(many):
    batch, back = many.batch, slice(None, None, -1)
    values = {key: value[back] if np.ndim(value) else value for key, value in batch.values.items()}
    states = steady_beats(Batch(batch.circuit, values, batch.count)).orbits.states
    np.testing.assert_allclose(states[:, back], many.orbits.states, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("lone", [None, True])
def test_what_was_solved_before_does_not_matter(lone):
    patient = model("V-A, CRRT g")
    beat_program.cache_clear()  # as in a process that has solved nothing yet
    first = steady_beats(Batch(patient.circuit, patient.values, 1), lone=lone).orbits.states
    steady_beats(Batch(patient.circuit, patient.with_values(Rmc=2.0, Emaxlv=3.0).values, 1), lone=lone)
    again = steady_beats(Batch(patient.circuit, patient.values, 1), lone=lone).orbits.states
    np.testing.assert_array_equal(first, again)


@pytest.mark.slow
def test_many_patients_side_by_side_equal_few():
    batch = varied("none", FEW + 40)
    together = steady_beats(batch)
    outputs = batch_outputs(together, CLINICAL)
    few = np.arange(0, batch.count, 30)
    values = {key: value[few] if np.ndim(value) else value for key, value in batch.values.items()}
    apart = steady_beats(Batch(batch.circuit, values, len(few)))
    np.testing.assert_allclose(together.orbits.states[:, few], apart.orbits.states, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(outputs[:, few], batch_outputs(apart, CLINICAL), rtol=1e-10)


def test_near_leads_to_the_same_beat():
    patient = model("V-A, CRRT g")
    changed = patient.with_values(Rmc=0.9, Csart=2.5)
    far = steady_beats(Batch(changed.circuit, changed.values, 1))
    near = steady_beats(Batch(changed.circuit, changed.values, 1), near=patient.values)
    np.testing.assert_allclose(near.orbits.states, far.orbits.states, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", ["V-A, CRRT g", "V-V", "CRRT at the patient"])
def test_a_held_patient_keeps_their_volume(name):
    patient = model(name)
    own = np.array([c.group == "patient" for c in patient.circuit.compartments])
    counted = assemble(patient.circuit).layout.conserved(own)
    started = counted @ start_state(patient)
    for policy, same in ((PATIENT_HELD, True), ("as_published", False)):
        steady = steady_beats(Batch(patient.circuit, patient.values, 1, policy))
        kept = counted @ steady.orbits.states[:, 0]
        assert (kept == pytest.approx(started, rel=1e-8)) == same


def test_an_unknown_policy_is_refused():
    patient = model("none")
    with pytest.raises(ValueError, match="allowed: as_published, patient_held"):
        simulate(patient, "frozen")


WEAK_HEARTS = {
    "weak right heart": {
        "Csart": 1.97,
        "Edla": 1.14,
        "Emaxlv": 1.57,
        "Emaxrv": 0.0228,
        "Rmc": 6.7,
        "Rpmc": 0.428,
    },
    "weak on both sides": {
        "Csart": 19.6,
        "Edla": 0.32,
        "Emaxlv": 0.223,
        "Emaxrv": 0.0162,
        "Rmc": 1.87,
        "Rpmc": 3.24,
    },
    "weak left heart": {"Emaxlv": 0.25, "ecmo.speed_rpm": 4500.0},
}


@pytest.mark.parametrize("changes", WEAK_HEARTS.values(), ids=WEAK_HEARTS)
def test_a_heart_that_does_not_eject_is_named_as_such(changes):
    result = simulate(model("V-A", **changes))
    assert abs(float(result["aortic_valve_flow"])) < 0.02
    assert any("the left ventricle does not eject" in sentence for sentence in result.attrs["warnings"])
    settled = changes is WEAK_HEARTS["weak left heart"]
    assert result.attrs["status"] == ("converged" if settled else "no_ejection")
    assert settled == ("native output 0 L/min" not in result.attrs["message"])
    assert settled == ("mL a beat" not in result.attrs["message"])


@pytest.mark.parametrize("changes", WEAK_HEARTS.values(), ids=WEAK_HEARTS)
def test_one_patient_and_many_hear_the_same(changes):
    patient = model("V-A", **changes)
    alone = simulate(patient).attrs
    one = simulate_many(patient, {"Rmc": [patient.values["Rmc"]]})
    two = simulate_many(patient, {"Rmc": [0.5, patient.values["Rmc"]]})
    assert str(one["status"].values[0]) == str(two["status"].values[1]) == alone["status"]
    assert str(one["message"].values[0]) == alone["message"]
    assert str(two["message"].values[1]).partition("(")[0] == alone["message"].partition("(")[0]


def test_without_ejection_the_beat_depends_on_where_it_began_and_is_not_called_steady():
    patient = model("V-A", **WEAK_HEARTS["weak right heart"])
    steady = steady_beats(Batch(patient.circuit, patient.values, 1))
    problem, waited = problem_of(steady, 0), start_state(patient)[:, None]
    for _ in range(300):
        waited = problem.beat(waited)
    assert problem.trial(waited).change[0] < 1e-8
    assert np.abs(waited - steady.orbits.states).max() > 100.0
    assert steady.status() is Status.NO_EJECTION


WILD = {
    "a resistance of minus one": ({"Rmc": -1.0}, "invalid_input", "Rmc = -1: allowed: zero or above"),
    "a compliance of zero": ({"Csart": 0.0}, "invalid_input", "Csart = 0: allowed: above zero"),
    "a heart that stands still": ({"heart_rate_bpm": 0.0}, "invalid_input", "heart_rate_bpm = 0: allowed"),
    "not a number": ({"Rsvn": float("nan")}, "invalid_input", "Rsvn = nan: not a number"),
    "less than no blood": ({"total_blood_volume_ml": -1.0}, "invalid_input", "total_blood_volume_ml = -1"),
    "a stone aorta": ({"Cao": 1e-9}, "not_converged", "the flow through 'ao' swings with a period"),
    "a heart rate of a million": ({"heart_rate_bpm": 1e6}, "not_converged", "no steady beat found"),
    "an explosive ventricle": ({"LV_Pd_kappa": 50.0}, "not_converged", "no steady beat found"),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "status", "reason"), WILD.values(), ids=WILD)
def test_wild_parameters_give_the_reason(changes, status, reason):
    result = simulate(model("none", **changes))
    assert result.attrs["converged"] == 0
    assert result.attrs["status"] == status
    assert reason in result.attrs["message"]
    if status == "invalid_input":
        assert all(np.isnan(v) for v in result.data_vars.values() if v.ndim == 0)


def test_without_inertia_a_flow_follows_at_once():
    plain, without = (simulate(model("none", Lao=inertance)) for inertance in (1e-7, 0.0))
    assert without.attrs["status"] == "converged"
    assert without.attrs["message"] == "steady beat found"
    for name in CLINICAL:
        assert float(without[name]) == pytest.approx(float(plain[name]), rel=1e-3)


def test_a_wild_member_does_not_harm_its_neighbours():
    patient = model("none")
    changes = {"Rmc": np.array([0.5, np.nan, 0.7]), "LV_Pd_kappa": np.array([0.033, 0.033, 50.0])}
    steady = steady_beats(Batch(patient.circuit, dict(patient.values) | changes, 3))
    assert list(steady.orbits.status == Status.CONVERGED) == [True, False, False]
    alone = steady_beats(Batch(patient.circuit, dict(patient.values) | {"Rmc": 0.5}, 1))
    np.testing.assert_allclose(steady.orbits.states[:, 0], alone.orbits.states[:, 0], rtol=1e-10)


def test_models_name_unknown_and_missing_parameters():
    with pytest.raises(UnknownValueError, match="no parameter 'Rmcc'; did you mean Rmc"):
        model("none", Rmcc=1.0)
    values = {key: value for key, value in model("none").values.items() if key != "Csart"}
    with pytest.raises(UnknownValueError, match="no value for Csart"):
        type(model("none"))(CIRCUITS["none"], values)
