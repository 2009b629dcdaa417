import numpy as np
import pytest

from eclsim.circuit.assembly import assemble
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.execution import Execution
from eclsim.orbit.model import PATIENT_HELD, UnknownValueError
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, solve, start_state
from eclsim.outputs.results import simulate, simulate_many
from eclsim.outputs.steady_beat import steady_beat
from eclsim.reporting.beat_values import marks_of, summary_lines
from model_catalogue import CIRCUITS, model

CLINICAL = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO")


def moved_by(orbits, members, beats=1):
    """Largest relative change of the members' states over some plain beats."""
    states = orbits.states[:, members]
    later = orbits.wait(np.array(members), states, beats)
    return (np.abs(later - states) / np.maximum(np.abs(states), 1.0)).max()


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
    return steady_beat(varied("V-A, CRRT g", 40), CLINICAL)


def some_of(batch, members):
    """Some members of a batch as a batch."""
    values = {key: np.asarray(v)[members] if np.ndim(v) else v for key, v in batch.values.items()}
    return Batch(batch.circuit, values, len(members))


@pytest.mark.slow
@pytest.mark.parametrize("name", CIRCUITS)
def test_a_solved_beat_repeats_itself(name):
    orbits = solve(Batch.of(model(name)))
    assert orbits.status[0] == Status.CONVERGED
    assert moved_by(orbits, [0]) <= 1e-8
    assert orbits.residual[0] <= 1e-8


def test_all_the_blood_is_there(many):
    volumes = len(many.batch.circuit.compartments)
    start = sum(assemble(many.batch.circuit).start_volumes(many.batch.values))
    np.testing.assert_allclose(many.orbits.states[:volumes].sum(axis=0), start, rtol=1e-8)


def test_most_patients_converge_within_a_few_beats(many):
    assert many.determined.all()
    assert np.median(many.orbits.beats) <= 20


def test_converged_means_that_ten_more_beats_change_nothing(many):
    assert moved_by(many.orbits, list(range(40)), 10) < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("width", [1, 32])
def test_a_result_depends_on_its_own_member_alone(many, width):
    """Not on the others, their number or their order, and not on what was solved before: to the last bit."""
    batch, execution = many.batch, Execution(threads=2, width=width)
    whole = steady_beat(batch, CLINICAL, execution=execution)
    back = np.arange(40)[::-1]
    for members in (back, np.array([17]), np.array([39, 0, 17])):
        part = steady_beat(some_of(batch, members), CLINICAL, execution=execution)
        np.testing.assert_array_equal(part.orbits.states, whole.orbits.states[:, members])
        np.testing.assert_array_equal(part.values, whole.values[:, members])


@pytest.mark.slow
@pytest.mark.parametrize("width", [1, 32])
def test_a_hopeless_neighbour_changes_no_bit(many, width):
    batch, execution = some_of(many.batch, np.arange(4)), Execution(width=width)
    values = dict(batch.values) | {"Rmc": np.array([np.nan, *np.asarray(batch.values["Rmc"])[1:]])}
    for key, value in WEAK_HEARTS["weak right heart"].items():
        values[key] = np.array([value if k == 1 else np.asarray(values[key])[k] for k in range(4)])
    beside = steady_beat(Batch(batch.circuit, values, 4), CLINICAL, execution=execution)
    whole = steady_beat(batch, CLINICAL, execution=execution)
    assert [Status(k).word for k in beside.status[:2]] == ["invalid_input", "one_of_many"]
    assert np.isnan(beside.values[:, 0]).all()
    np.testing.assert_array_equal(beside.values[:, 2:], whole.values[:, 2:])


def test_side_by_side_and_one_by_one_take_the_same_steps(many):
    one, several = (solve(many.batch, execution=Execution(width=width)) for width in (1, 32))
    np.testing.assert_array_equal(one.beats, several.beats)
    np.testing.assert_allclose(one.states, several.states, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(one.residual, several.residual, rtol=1e-3, atol=1e-11)
    np.testing.assert_allclose(one.drift, several.drift, rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("width", [1, 32])
def test_what_broydens_method_does_not_find_newtons_does(many, width):
    batch, execution = some_of(many.batch, np.array([3])), Execution(width=width)
    few = OrbitOptions(quasi_newton_beats=5, newton_iterations=0)
    lost = solve(batch, few, execution=execution)
    assert lost.status[0] == Status.NOT_CONVERGED
    assert lost.beats[0] == 5
    assert np.isfinite(lost.states).all()
    result = solve(batch, OrbitOptions(quasi_newton_beats=5), execution=execution)
    assert result.status[0] == Status.CONVERGED
    np.testing.assert_allclose(result.states, many.orbits.states[:, [3]], rtol=1e-6, atol=1e-5)


def test_an_execution_says_what_is_allowed():
    with pytest.raises(ValueError, match="width = 0; allowed: 1 or more"):
        Execution(width=0)
    assert [Execution().width_for(k) for k in (1, 256, 257)] == [1, 1, 32]


def test_another_start_leads_to_the_same_beat():
    patient = model("V-A, CRRT g")
    changed = Batch.of(patient.with_values(Rmc=0.9, Csart=2.5))
    usual, close = solve(changed), solve(changed, start=patient.values)
    assert close.beats[0] < usual.beats[0]
    np.testing.assert_allclose(close.states, usual.states, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", ["V-A, CRRT g", "V-V", "CRRT at the patient"])
def test_a_held_patient_keeps_their_volume(name):
    patient = model(name)
    own = np.array([c.group == "patient" for c in patient.circuit.compartments])
    counted = assemble(patient.circuit).layout.conserved(own)
    started = counted @ start_state(patient)
    for policy, same in ((PATIENT_HELD, True), ("as_published", False)):
        kept = counted @ solve(Batch.of(patient, policy)).states[:, 0]
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
    assert result.attrs["status"] == "one_of_many"
    assert "aortic valve" in result.attrs["message"]
    assert abs(float(result["aortic_valve_flow"])) < 0.02
    assert any("the left ventricle does not eject" in sentence for sentence in result.attrs["warnings"])
    assert any("not determined by the case" in sentence for sentence in result.attrs["warnings"])
    alarms = [sentence for sentence in result.attrs["warnings"] if "alarm: mean arterial" in sentence]
    assert all(alarm.endswith("; the case does not determine this number") for alarm in alarms)
    too_weak = any("is too weak for the" in sentence for sentence in result.attrs["warnings"])
    assert marks_of(result, "MAP") == ("!*" if alarms or too_weak else "*")
    assert any("†" in line for line in summary_lines(result))


def test_a_search_that_is_cut_short_names_a_heart_that_does_not_eject():
    patient = model("V-A", **WEAK_HEARTS["weak right heart"])
    beat = steady_beat(Batch.of(patient), options=OrbitOptions(newton_iterations=0))
    assert beat.status[0] == Status.NO_EJECTION
    assert "mL a beat" in beat.message()
    assert np.isnan(beat.values).all()


@pytest.mark.parametrize("changes", WEAK_HEARTS.values(), ids=WEAK_HEARTS)
def test_one_patient_and_many_hear_the_same(changes):
    patient = model("V-A", **changes)
    single = simulate(patient).attrs
    one = simulate_many(patient, {"Rmc": [patient.values["Rmc"]]})
    two = simulate_many(patient, {"Rmc": [0.5, patient.values["Rmc"]]})
    assert str(one["status"].values[0]) == str(two["status"].values[1]) == single["status"]
    assert str(one["message"].values[0]) == single["message"]
    assert str(two["message"].values[1]).partition("(")[0] == single["message"].partition("(")[0]


def test_without_ejection_the_beat_depends_on_where_it_began_and_is_called_one_of_many():
    patient = model("V-A", **WEAK_HEARTS["weak right heart"])
    beat, only = steady_beat(Batch.of(patient)), np.array([0])
    waited = beat.orbits.wait(only, start_state(patient)[:, None], 300)
    assert np.abs(beat.orbits.wait(only, waited) - waited).max() < 1e-6
    assert np.abs(waited - beat.orbits.states).max() > 100.0
    assert beat.status[0] == Status.ONE_OF_MANY


EXPLOSIVE = {"LV_Pd_kappa": 50.0}
WILD = {
    "a resistance of minus one": ({"Rmc": -1.0}, "invalid_input", "Rmc = -1: allowed: zero or above"),
    "a compliance of zero": ({"Csart": 0.0}, "invalid_input", "Csart = 0: allowed: above zero"),
    "a heart that stands still": ({"heart_rate_bpm": 0.0}, "invalid_input", "heart_rate_bpm = 0: allowed"),
    "not a number": ({"Rsvn": float("nan")}, "invalid_input", "Rsvn = nan: not a number"),
    "less than no blood": ({"total_blood_volume_ml": -1.0}, "invalid_input", "total_blood_volume_ml = -1"),
    "an explosive ventricle": (EXPLOSIVE, "not_converged", "no steady beat found"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("changes", "status", "reason"), WILD.values(), ids=WILD)
def test_wild_parameters_give_the_reason(changes, status, reason):
    result = simulate(model("none", **changes))
    assert result.attrs["converged"] == 0
    assert result.attrs["status"] == status
    assert reason in result.attrs["message"]
    assert all(np.isnan(v).all() for v in result.data_vars.values())


@pytest.mark.slow
def test_a_stone_aorta_has_a_beat_that_the_grid_is_too_coarse_for():
    result = simulate(model("none", Cao=1e-9))
    assert result.attrs["status"] == "converged"
    assert "the flow through 'ao' oscillates with a period" in result.attrs["message"]


def test_a_heart_rate_of_a_million_converges_to_numbers_or_says_that_it_does_not():
    """Which of them is decided by the rounding of the processor."""
    result = simulate(model("none", heart_rate_bpm=1e6))
    known = [bool(np.isfinite(v).all()) for v in result.data_vars.values()]
    if result.attrs["converged"]:
        assert all(known)
    else:
        assert not any(known)
        assert "no steady beat found" in result.attrs["message"]


def test_without_inertia_a_flow_follows_at_once():
    plain, without = (simulate(model("none", Lao=inertance)) for inertance in (1e-7, 0.0))
    assert without.attrs["status"] == "converged"
    assert without.attrs["message"] == "steady beat found"
    for name in CLINICAL:
        assert float(without[name]) == pytest.approx(float(plain[name]), rel=1e-3)


def test_models_name_unknown_and_missing_parameters():
    with pytest.raises(UnknownValueError, match="no parameter 'Rmcc'; did you mean Rmc"):
        model("none", Rmcc=1.0)
    values = {key: value for key, value in model("none").values.items() if key != "Csart"}
    with pytest.raises(UnknownValueError, match="no value for Csart"):
        type(model("none"))(CIRCUITS["none"], values)
