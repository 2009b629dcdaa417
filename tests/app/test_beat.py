"""The page's lean beat is the same as that of `eclsim simulate`."""

import asyncio
import re
import time

import numpy as np
import pytest

from eclsim.app.beat import POINTS, beat_of, compute_beat, page_circuit, plain
from eclsim.app.display import display, named_specs, output_specs
from eclsim.app.engine import Engine, _warm_states
from eclsim.app.knobs import connect, turn
from eclsim.app.session import BEATS_WORTH_A_CLOSER_START
from eclsim.app.state import PageState, preset_state
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import read_mapping
from eclsim.orbit.status import Status
from eclsim.outputs.alarms import CAUTION, marks
from eclsim.parameters.adult_ranges import adult_ranges
from eclsim.simulation.single import simulate, simulate_many
from patience import until
from shock_patient import SHOCK


@pytest.fixture(scope="module")
def paper() -> PageState:
    return PageState(PRESETS["paper"].case())


@pytest.mark.slow
def test_outputs_and_waveforms_are_those_of_simulate(paper):
    beat, reference = compute_beat(paper), simulate(paper.case)
    assert beat.converged
    for name, value in beat.outputs.items():
        assert value == pytest.approx(float(reference[name]), rel=1e-5, abs=1e-4), name
    for name in ("Pao", "Vlv", "Qecmopump", "Pcrrttuin", "Vsvn"):
        phases = np.arange(POINTS) / POINTS
        expected = np.interp(phases, reference["phase"].values, reference[name].values)
        assert beat.waves[name] == pytest.approx(expected, rel=1e-4, abs=2e-3), name


@pytest.mark.slow
def test_oxygen_delivery_is_held_against_the_size_of_the_patient():
    """As the commands have it: 600 to 700 mL/min are enough for 1.8 m2, and low for 2.9 m2."""
    case = connect(PRESETS["healthy"].case(), "gas")
    assert case.gas is not None
    large = case.patient.model_copy(update={"height_cm": 195.0, "weight_kg": 160.0})
    pale = case.gas.model_copy(update={"haemoglobin_g_dl": 8.0})
    state = PageState(case.model_copy(update={"patient": large, "gas": pale}))
    beat = compute_beat(state)
    assert 500.0 < beat.outputs["DO2"] < 720.0
    assert beat.levels()["DO2"] == "warning"
    said = next(finding.sentence for finding in beat.findings if finding.quantity == "DO2")
    assert said in simulate(state.case).attrs["warnings"]
    assert [one["value"] for one in display(state.case)["specs"]["DO2"]["limits"]] == [493.0, 824.0]


@pytest.mark.slow
def test_without_a_steady_beat_the_reason_is_an_alarm_of_every_output(paper):
    """The page said "The simulated values break no limit" beside dashes."""
    circuit, values = page_circuit(paper.case)
    shown = plain(beat_of(paper, circuit, dict(values) | {"LV_Pd_kappa": 50.0}), ("Pao",))
    assert not shown["converged"]
    assert [kind for kind, _ in shown["notes"]] == ["alarm"]
    (said,) = (sentence for _, sentence in shown["notes"])
    assert said.startswith("no steady beat found: check the parameters against their ranges (residual")
    assert shown["outputs"]["MAP"] is None
    assert shown["levels"]["MAP"] == shown["levels"]["PF"] == "alarm"


@pytest.mark.slow
def test_a_balloon_holds_no_blood():
    beat = compute_beat(PageState(connect(connect(PRESETS["healthy"].case(), "gas"), "iabp")))
    places = plain(beat, ())["gas"]["places"]
    assert "iabpballoon" in beat.gases.places
    assert "iabpballoon" not in places
    assert set(beat.gases.places) - set(places) == {"iabpballoon"}


@pytest.mark.slow
def test_moving_a_crrt_line_keeps_the_compiled_circuit(paper):
    moved = turn(paper.case, "crrt.access_site", "pre_pump")
    assert page_circuit(moved)[0] is page_circuit(paper.case)[0]
    beat = compute_beat(paper.with_case(moved))
    reference = simulate(moved)
    assert beat.outputs["crrt_access_pressure"] == pytest.approx(
        float(reference["crrt_access_pressure"]), abs=0.01
    )


def test_starting_from_a_neighbour_changes_nothing(paper):
    far = paper.with_case(turn(paper.case, "ecmo.speed_rpm", 4500))
    prepare_nearby_searches = compute_beat(far, compute_beat(paper))
    assert prepare_nearby_searches.outputs["MAP"] == pytest.approx(compute_beat(far).outputs["MAP"], rel=1e-5)


def test_a_circuit_is_said_to_be_compiled_once():
    engine, said = Engine(workers=1), []
    state = preset_state("healthy")

    async def twice():
        for _ in range(2):
            await engine.beat(state, None, lambda: said.append(True))

    asyncio.run(twice())
    engine.stop()
    assert said == [True]


def test_the_browser_gets_numbers_or_null(paper):
    data = plain(compute_beat(paper), ("Pao", "Qlvadpump"))
    assert list(data["waves"]) == ["Pao"]
    assert len(data["waves"]["Pao"]) == POINTS
    assert data["outputs"]["MAP"] == pytest.approx(70.4, abs=0.1)


def test_a_broken_limit_is_said(paper):
    fast = compute_beat(paper.with_case(turn(paper.case, "ecmo.speed_rpm", 4800)))
    assert any(f.kind == "alarm" and f.quantity == "crrt_return_pressure" for f in fast.findings)
    assert fast.place_levels()["crrttuout"] == fast.levels()["crrt_return_pressure"] == "alarm"


def test_drainage_pressure_above_zero_breaks_no_limit(paper):
    slow = compute_beat(paper.with_case(turn(paper.case, "ecmo.speed_rpm", 1000)))
    assert slow.outputs["lowest_drainage_pressure"] > 0
    assert slow.levels()["lowest_drainage_pressure"] == "ok"
    assert "range" not in output_specs()["lowest_drainage_pressure"]


@pytest.mark.parametrize("sex", ["female", "male"])
def test_reference_ranges_are_those_of_a_fit_for_the_same_sex(paper, sex):
    """A woman's ventricles were compared with those of men, and CO with another range than in her report."""
    patient = paper.case.patient.model_copy(update={"sex": sex})
    specs = named_specs(paper.case.model_copy(update={"patient": patient}))
    for name, one in adult_ranges(sex).items():
        assert tuple(specs[name]["range"]) == (*one.healthy, one.source)
    assert specs["MAP"]["limits"]
    assert specs["SP"]["range"][:2] == [90.0, 140.0]


def test_what_no_patient_can_have_is_marked_at_its_place(paper):
    dry = turn(turn(paper.case, "ecmo.speed_rpm", 5000), "volume_ml", -200)
    beat = compute_beat(paper.with_case(dry))
    assert beat.converged
    assert not beat.possible
    assert beat.waves["Vra"].min() < 0
    assert beat.place_levels()["ra"] == beat.place_levels()["rv"] == "collapse"
    assert plain(beat, ())["possible"] is False


def test_alarms_of_no_table_mark_their_numbers_as_in_terminal_and_figures():
    """The alarm of a ventricle too weak for its blood stood in the list alone; no tile had its sign."""
    weak = SHOCK | {"parameters": SHOCK["parameters"] | {"Emaxlv": 0.05}}
    beat = compute_beat(PageState(read_mapping(weak).case))
    assert "alarm" in {finding.kind for finding in beat.findings if finding.quantity == "EDVLV"}
    assert beat.levels()["CO"] == beat.levels()["ejection_fraction_lv"] == "alarm"
    assert beat.place_levels()["lv"] == beat.place_levels()["ao"] == "alarm"
    graver = {n: k for n, k in marks(beat.findings, beat.outputs, beat.values).items() if k != CAUTION}
    assert {n: k for n, k in beat.levels().items() if k != "ok"} == graver


@pytest.mark.parametrize(
    ("preset", "turned", "said"),
    [
        ("vv-ecmo", {"ecmo.speed_rpm": 0}, "stands still"),
        ("paper", {"ecmo.speed_rpm": 4800, "ecmo.drainage_fr": 29, "ecmo.return_fr": 23}, "is above 7 L/min"),
    ],
)
def test_warnings_of_no_table_mark_the_flow_that_they_are_about(preset, turned, said):
    """Those of a pump that stands still and of an oxygenator's label stood in the list alone."""
    case = PRESETS[preset].case()
    for key, value in turned.items():
        case = turn(case, key, value)
    beat = compute_beat(PageState(case))
    assert any(said in finding.sentence for finding in beat.findings)
    assert beat.levels()["PF"] == "warning"


@pytest.mark.parametrize("preset", PRESETS)
def test_strip_tiles_and_schematic_agree(preset):
    beat = compute_beat(PageState(PRESETS[preset].case()))
    messages = {f.quantity: f.kind for f in beat.findings if f.kind != "caution"}
    marked = {name for name, level in beat.levels().items() if level != "ok"}
    assert bool(marked) <= bool(messages)
    assert {name: kind for name, kind in messages.items() if beat.levels().get(name, "ok") != "ok"} == {
        name: beat.levels()[name] for name in messages if name in marked
    }


def with_gas(**changes: float) -> PageState:
    case = connect(connect(PRESETS["paper"].case(), "crrt"), "gas")
    for key, value in changes.items():
        case = turn(case, key.replace("__", "."), value)
    return PageState(case)


@pytest.mark.slow
def test_blood_gases_stand_everywhere_with_their_colour(paper):
    assert plain(compute_beat(paper), ())["gas"] is None, "not asked for"
    beat = compute_beat(with_gas())
    gas = plain(beat, ())["gas"]
    assert set(gas["places"]) == {c.name for c in beat.circuit.compartments}
    assert gas["places"]["sart"]["values"]["SO2"] == pytest.approx(beat.outputs["SaO2"], rel=1e-4)
    assert gas["places"]["ecmotuor"]["colour"] != gas["places"]["ecmodrain"]["colour"]
    uptake = [oxygen for oxygen, _ in gas["exchanged"].values()]
    assert sum(uptake) == pytest.approx(0.0, abs=1e-3)
    assert set(gas["exchanged"]) == set(display(with_gas().case)["exchangers"])
    labels = {one["place"]: one["outputs"] for one in display(with_gas().case)["samples"]}
    assert labels["ecmotuor"]["PO2"] == "PpostO2"


@pytest.mark.slow
def test_blood_that_stands_still_has_no_gases_on_the_page():
    """A heart that does not eject beside V-A ECMO: mixed venous blood would have no carbon dioxide."""
    case = connect(connect(PRESETS["cardiogenic-shock"].case(), "ecmo"), "gas")
    for key, value in {"ecmo.speed_rpm": 3800, "parameters.Emaxlv": 0.2, "parameters.Emaxrv": 0.1}.items():
        case = turn(case, key, value)
    shown = plain(compute_beat(PageState(case)), ())
    places = shown["gas"]["places"]
    assert {"rv", "pas", "part", "pvn", "la", "lv"} == {n for n, one in places.items() if "standing" in one}
    assert set(places["pas"]["values"].values()) == {None}
    assert shown["outputs"]["SvO2"] is None, "100 % stood in the table of outputs"
    assert shown["outputs"]["PvO2"] is None
    assert 40.0 < places["svn"]["values"]["SO2"] < 80.0
    assert "no blood flows through the lungs" in shown["cautions"]["SvO2"]
    assert shown["cautions"].keys() >= {"SvO2", "PvO2"}
    result = simulate(case)
    assert "SO2" in result["Psvn"].attrs
    assert "SO2" not in result["Ppas"].attrs, "nor in figures"
    assert np.isnan(float(result["SvO2"])), "100 % stood in terminal, tables and files"
    many = simulate_many(case, {"Rmc": [0.5, 0.9]}, ["SvO2"])
    assert np.isnan(many["SvO2"]).all()
    assert "pulmonary_flow" not in many


@pytest.mark.slow
def test_without_a_steady_gas_state_the_reason_stands_in_place_of_numbers():
    shown = plain(compute_beat(with_gas(gas__shunt_fraction=1.0, ecmo__sweep_l_min=0.0)), ())
    gas = shown["gas"]
    assert (gas["places"], gas["exchanged"]) == ({}, {})
    assert "no steady gas state" in gas["message"]
    assert shown["outputs"]["SaO2"] is None
    assert shown["levels"]["SaO2"] == "alarm"
    kinds = [kind for kind, _ in shown["notes"]]
    assert kinds == sorted(kinds, key=("collapse", "alarm", "warning", "caution").index), "the gravest first"


@pytest.mark.slow
def test_a_reflex_sets_the_length_of_the_beat():
    healthy = PageState(PRESETS["healthy"].case(), origin="healthy")
    on = healthy.with_case(connect(healthy.case, "regulation"))
    at_rest = compute_beat(on)
    assert at_rest.outputs["MAP"] == pytest.approx(compute_beat(healthy).outputs["MAP"], rel=1e-4)
    weak = compute_beat(on.with_case(turn(on.case, "parameters.Emaxlv", 0.9)))
    unregulated = compute_beat(healthy.with_case(turn(healthy.case, "parameters.Emaxlv", 0.9)))
    assert weak.period < at_rest.period, "the heart is driven"
    assert weak.outputs["MAP"] > unregulated.outputs["MAP"] + 3.0


@pytest.mark.slow
def test_sentences_of_the_page_have_a_minus():
    case = turn(connect(PRESETS["paper"].case(), "gas"), "ecmo.speed_rpm", 5000)
    shown = plain(compute_beat(PageState(case)), ())
    sentences = [sentence for _, sentence in shown["notes"]] + list(shown["cautions"].values())
    assert any("\u2212" in sentence for sentence in sentences)
    assert not any(re.search(r"(^|[ (])-\d", sentence) for sentence in sentences)


@pytest.mark.slow
def test_a_search_that_begins_near_takes_no_jacobian(paper):
    """From the patient as opened every search at 5000 rpm took one, and a turn of the knob 0.1 s."""
    engine = Engine(workers=1)

    def at(rpm: float) -> PageState:
        return paper.with_case(turn(paper.case, "ecmo.speed_rpm", rpm))

    async def beats():
        opened = await engine.beat(paper)
        far = await engine.beat(at(4600.0), opened)
        assert far.effort > BEATS_WORTH_A_CLOSER_START
        await engine.prepare_nearby_searches(at(4600.0), far)
        return [await engine.beat(at(5000.0), start) for start in (opened, far)]

    from_opened, from_near = asyncio.run(beats())
    engine.stop()
    assert from_opened.effort > 25 > from_near.effort
    for name, value in from_near.outputs.items():
        assert value == pytest.approx(from_opened.outputs[name], rel=1e-6, abs=1e-6), name


def test_what_is_loaded_is_not_looked_through_again(paper, monkeypatch):
    """Python's collector looked through all of JAX in between, and every page stood still for 0.1 s."""
    engine, done = Engine(workers=1), []
    monkeypatch.setattr(engine, "_warm_one", lambda state: done.append("warm"))
    monkeypatch.setattr("eclsim.app.engine.gc.freeze", lambda: done.append("frozen"))
    engine.warm(paper)
    asyncio.run(until(lambda: len(done) == 2))
    engine.stop()
    assert done == ["warm", "frozen"]


def test_circuits_of_the_presets_are_compiled_while_no_knob_is_turned(paper, monkeypatch):
    engine, done = Engine(workers=1), []
    monkeypatch.setattr("eclsim.app.engine.FIRST_PAGE_GRACE_S", 0.0)
    monkeypatch.setattr(engine, "_warm_one", done.append)
    monkeypatch.setattr(engine.fits, "prepare", lambda: done.append("fits"))
    monkeypatch.setattr("eclsim.app.engine.gc.freeze", lambda: None)
    engine._wanted_at = float("inf")
    engine.warm(paper)
    asyncio.run(until(lambda: done))
    time.sleep(0.3)
    assert done == [paper], "a knob is being turned"
    engine._wanted_at, states = float("-inf"), _warm_states()
    asyncio.run(until(lambda: len(done) == len(states) + 2))
    engine.stop()
    half = len(states) // 2
    assert done == [paper, *states[:half], "fits", *states[half:]]
    warmed = [state.case for state in states]
    assert all(preset.case() in warmed for preset in PRESETS.values())


@pytest.mark.slow
def test_numbers_of_a_heart_that_opens_no_valve_are_not_determined(paper):
    case = turn(turn(paper.case, "parameters.Emaxlv", 0.2), "parameters.Emaxrv", 0.03)
    beat = compute_beat(paper.with_case(case))
    assert beat.status is Status.ONE_OF_MANY
    assert {"MAP", "PCWP", "right_atrial_pressure"} <= set(plain(beat, ())["undetermined"])
    assert not {"PF", "CO"} & set(beat.undetermined)
    assert compute_beat(paper).undetermined == ()


@pytest.mark.slow
def test_the_left_ventricle_has_a_flow_of_its_own_only_with_a_device_that_makes_it_differ():
    balloon = PageState(connect(PRESETS["cardiogenic-shock"].case(), "iabp"))
    shown = plain(compute_beat(balloon), ())
    assert "CO" in shown["cautions"]
    assert shown["apart"] == []
    assert plain(compute_beat(preset_state("lvad")), ())["apart"] == ["LVO"]
    raw = PRESETS["right-heart-failure"].case().as_mapping()
    raw["lvad"] = {"pump": "HM3", "speed_rpm": 3000.0, "inlet_site": "rv", "outlet_site": "part"}
    assert "pulmonary_flow" in plain(compute_beat(PageState(read_mapping(raw).case)), ())["apart"]
