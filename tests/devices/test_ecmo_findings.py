"""What the ECMO circuit says of a beat besides limits."""

from pathlib import Path

import numpy as np
import pytest

import eclsim
from eclsim.cases.reading import read_mapping
from eclsim.components.exchangers import FLOWMETER_TO_STPD
from eclsim.devices.ecmo import ecmo
from eclsim.inputs.mistakes import CaseError
from eclsim.outputs.alarms import findings
from eclsim.patient.circulation import circulation

LOW_SWEEP = Path(__file__).parents[2] / "examples/veno_venous_low_sweep.toml"


def used_up(sweep: float, fdo2: float = 1.0):
    """The beat at a sweep, and the warnings that say its gas is used up."""
    case = eclsim.read_case(LOW_SWEEP).case.with_section("ecmo", sweep_l_min=sweep, fdo2=fdo2)
    beat = eclsim.simulate(case)
    return beat, [text for text in beat.attrs["warnings"] if "sweep gas" in text]


@pytest.mark.parametrize("sweep", [0.05, 0.17, 0.2])
def test_a_sweep_that_the_blood_takes_up_is_said_where_no_carbon_dioxide_leaves(sweep):
    beat, (said,) = used_up(sweep)
    brought = 1000.0 * FLOWMETER_TO_STPD * sweep
    assert float(beat["VO2_oxygenator"]) == pytest.approx(brought, rel=0.01)
    assert float(beat["VCO2_oxygenator"]) < 0.1
    assert np.isnan(float(beat["PexhaustCO2"]))
    assert f"of {brought:.0f} mL/min STPD" in said
    assert "removes 0 mL/min of carbon dioxide; raise the sweep" in said


@pytest.mark.parametrize(("sweep", "fdo2"), [(0.0, 1.0), (0.3, 1.0), (0.17, 0.21)])
def test_nothing_is_said_of_a_sweep_that_is_off_or_leaves_the_oxygenator(sweep, fdo2):
    beat, said = used_up(sweep, fdo2)
    assert beat.attrs["converged"]
    assert said == []


def veno_venous(**keys):
    """What is said about a case on V-V ECMO with gas exchange and the given keys of its circuit."""
    raw = {
        "format": 1,
        "patient": {"id": "v", "sex": "male", "age_years": 45, "heart_rate_bpm": 95},
        "gas": {},
        "ecmo": {
            "mode": "VV", "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult",
            "drainage_fr": 25, "return_fr": 19, **keys,
        },
    }  # fmt: skip
    reading = read_mapping(raw)
    return [
        [(one.key, one.message) for one in remarks if "share no compartment" in one.message]
        for remarks in (reading.warnings, reading.notes)
    ]


def test_mixing_where_drainage_and_return_are_apart_is_said_to_have_no_effect():
    """`mode = "VV"` drains svn and returns to ra: a mixing of 0.33 gave 3 % of recirculation, silently."""
    (warning,), notes = veno_venous(drainage_mixing=0.33)
    assert warning[0] == "ecmo.drainage_mixing"
    assert 'without effect: drainage ("svn") and return ("ra")' in warning[1]
    assert 'write drainage_site and return_site = "ra"' in warning[1]
    assert not notes
    warnings, ((key, message),) = veno_venous()
    assert not warnings
    assert key == "ecmo.drainage_site"
    assert "the more the higher the flow" in message
    assert "9 to 28 % at 4 L/min" in message
    assert veno_venous(drainage_site="ra", return_site="ra", drainage_mixing=0.33) == [[], []]


@pytest.mark.parametrize(("site", "opposed"), [("ra", False), ("pas", False), ("ao", True)])
def test_only_an_ecmo_that_returns_to_arteries_opposes_an_lvad(site, opposed):
    """A right-sided ECMO fills the LVAD; it was said that the two may oppose each other."""
    raw = {
        "format": 1,
        "patient": {"id": "l", "sex": "male", "age_years": 57, "heart_rate_bpm": 95},
        "lvad": {"pump": "HM3", "speed_rpm": 5400, "inlet_site": "lv", "outlet_site": "ao"},
        "gas": {},
        "ecmo": {
            "pump": "Rotaflow", "speed_rpm": 2800, "oxygenator": "Quadrox-i Adult", "drainage_fr": 25,
            "return_fr": 19, "drainage_site": "ra", "drainage_cannula": "venous", "return_site": site,
            "return_cannula": "arterial",
        },
    }  # fmt: skip
    notes = [note.message for note in read_mapping(raw).notes]
    assert any("oppose each other" in note for note in notes) is opposed


@pytest.mark.parametrize(("clamp", "said"), [(0.0, False), (0.97, True), (1.0, False)])
def test_a_flow_below_the_label_is_said_of_a_kinked_return_line(clamp, said):
    """At a clamp of 0.97 the flow of 0.2 L/min broke no limit; blood clots in it as without a clamp."""
    case = eclsim.read_case(LOW_SWEEP).case.with_section("ecmo", return_clamp=clamp)
    warnings = eclsim.simulate(case).attrs["warnings"]
    assert any("below 0.5 L/min: outside the label" in one for one in warnings) == said


@pytest.mark.parametrize(("speed", "clamp"), [(0.0, 0.0), (0.0, 1.0), (1500.0, 0.0)])
def test_a_veno_venous_pump_that_stands_still_is_said_to_supply_nobody(speed, clamp):
    """A flow of -0.0005 L/min was "outside the label", and nothing was said of the 706 mmHg behind it."""
    raw = eclsim.read_case(LOW_SWEEP).case.as_mapping()
    reading = read_mapping(raw | {"ecmo": raw["ecmo"] | {"speed_rpm": speed, "return_clamp": clamp}})
    beat = eclsim.simulate(reading.case)
    read = [one.message for one in reading.warnings if "stands still" in one.message]
    assert any("hardly any blood flows through it" in one for one in read) == (not speed and not clamp)
    assert len(read) <= 1
    warnings = beat.attrs["warnings"]
    assert any("stands still, and 0.00 L/min pass its oxygenator" in one for one in warnings) == bool(read)
    assert any("blood stands in the ECMO circuit" in one for one in warnings) == (speed == 0.0)
    assert not any("outside the label" in one for one in warnings)
    assert bool(float(beat["VO2_oxygenator"]) < 1.0) == (speed == 0.0)


def test_a_kinked_drainage_line_has_the_resistance_of_its_open_area():
    """Half of the area has four times the resistance; a kink could only be stated as a smaller cannula."""
    whole = eclsim.read_case(LOW_SWEEP).case
    results = [eclsim.simulate(whole.with_section("ecmo", drainage_clamp=c)) for c in (0.0, 0.5, 0.9)]
    flows, inlets = ([float(r[name]) for r in results] for name in ("PF", "drainage_pressure"))
    assert flows[0] == pytest.approx(float(eclsim.simulate(whole)["PF"]), rel=1e-7)
    assert flows == sorted(flows, reverse=True)
    assert inlets == sorted(inlets, reverse=True)
    dropped = [float(r["right_atrial_pressure"] - r["drainage_pressure"]) for r in results]
    resistances = np.array(dropped) / np.array(flows) ** 2  # flows hardly pulsate
    assert resistances[1:] / resistances[0] == pytest.approx([4.0, 100.0], rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("circuit", "device"),
    [
        ({"second_drainage_site": "la", "second_drainage_fr": 19}, {}),
        ({}, {"vent": {"site": "la", "fr": 14}}),
    ],
)
def test_the_drained_blood_is_all_that_the_oxygenator_gets(circuit, device):
    """It was that of the first cannula: 60 % where 72 % entered the oxygenator, as its uptake showed."""
    raw = {
        "format": 1,
        "patient": {"id": "v", "sex": "male", "age_years": 58, "heart_rate_bpm": 95},
        "gas": {"haemoglobin_g_dl": 10.0},
        "parameters": {"Emaxlv": 0.6, "Emaxrv": 0.4, "Rmc": 0.9},
        "ecmo": {
            "mode": "VA", "pump": "Rotaflow", "speed_rpm": 3200, "oxygenator": "Quadrox-i Adult",
            "drainage_fr": 25, "return_fr": 17, "fdo2": 0.7, **circuit,
        },
        **device,
    }  # fmt: skip
    beat = eclsim.simulate(read_mapping(raw).case)
    of = {name: float(beat[name]) for name in ("SpreO2", "PpreO2", "SpostO2", "PpostO2", "PF", "SvO2")}
    before, behind = (0.0134 * 10.0 * of[f"S{at}O2"] + 0.0031 * of[f"P{at}O2"] for at in ("pre", "post"))
    assert float(beat["VO2_oxygenator"]) == pytest.approx(10.0 * of["PF"] * (behind - before), rel=1e-3)
    assert of["SpreO2"] > of["SvO2"] + 5.0


@pytest.mark.slow
def test_recirculation_is_that_of_the_blood_of_both_drainage_cannulae():
    """It was that of the first: a second in the veins raised it from 0.20 to 0.23, where it falls to 0.13."""
    two = {"second_drainage_site": "svn", "second_drainage_fr": 21}
    shares = []
    for second in ({}, two):
        raw = {
            "format": 1,
            "patient": {"id": "v", "sex": "male", "age_years": 58, "heart_rate_bpm": 95},
            "gas": {"haemoglobin_g_dl": 9.5, "shunt_fraction": 0.8, "vo2_ml_min": 240},
            "ecmo": {
                "pump": "Rotaflow", "speed_rpm": 3400, "oxygenator": "Quadrox-i Adult",
                "drainage_site": "ra", "drainage_cannula": "venous", "drainage_fr": 25, "return_site": "ra",
                "return_cannula": "arterial", "return_fr": 19, "drainage_mixing": 0.33, **second,
            },
        }  # fmt: skip
        beat = eclsim.simulate(read_mapping(raw).case)
        of = {
            place: 0.0134 * 9.5 * float(beat[f"S{place}O2"]) + 0.0031 * float(beat[f"P{place}O2"])
            for place in ("a", "pre", "post")
        }
        venous = of["a"] - float(beat["VO2"]) / (10.0 * float(beat["CO"]))
        shares.append(float(beat["recirculation_fraction"]))
        assert shares[-1] == pytest.approx((of["pre"] - venous) / (of["post"] - venous), rel=0.08)
    assert shares[1] < 0.75 * shares[0]


BAD_LUNGS = {
    "format": 1,
    "patient": {"id": "h", "sex": "male", "age_years": 60, "heart_rate_bpm": 90},
    "gas": {"haemoglobin_g_dl": 10, "shunt_fraction": 0.6, "fio2": 0.6},
    "ecmo": {"mode": "VA", "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult",
             "drainage_fr": 23, "return_fr": 17},
}  # fmt: skip


def harlequin(gas=None, circuit=None, **sections):
    """The cautions on differential hypoxaemia, and the beat."""
    changed = {"gas": {**BAD_LUNGS["gas"], **(gas or {})}, "ecmo": {**BAD_LUNGS["ecmo"], **(circuit or {})}}
    beat = eclsim.simulate(read_mapping({**BAD_LUNGS, **changed, **sections}).case)
    return [text for text in beat.attrs["warnings"] if "differential hypoxaemia" in text], beat


def test_one_artery_hides_desaturated_blood_of_the_heart_and_that_is_said():
    """A radial saturation of 93 % stood over a heart that ejected 6 L/min of 86 %."""
    (said,), beat = harlequin()
    assert float(beat["SaO2"]) > 92.0
    named = float(said.split("of about ")[1].split(" %")[0])
    assert named == pytest.approx(beat["Ppvn"].attrs["SO2"], abs=1.5)
    assert '[physiology] regional = true and ecmo.return_site = "lower"' in said
    assert beat["SaO2"].attrs["read_with_care"] == 1
    assert harlequin(gas={"shunt_fraction": 0.1})[0] == []


@pytest.mark.slow
def test_central_return_in_regions_is_named_and_femoral_return_needs_no_caution():
    regions = {"physiology": {"regional": True}}
    (said,), beat = harlequin(**regions)
    assert "returns to the ascending aorta (central cannulation)" in said
    assert "regional = true" not in said
    none, femoral = harlequin(circuit={"return_site": "lower"}, **regions)
    assert none == []
    assert float(femoral["SaO2"]) < float(beat["SaO2"]) - 4.0


def test_suction_is_said_where_the_pump_draws():
    """The venous pressure of the console is measured before the pump; -115 mmHg there was no warning."""
    beat = eclsim.simulate(read_mapping({**BAD_LUNGS, "ecmo": {**BAD_LUNGS["ecmo"], "speed_rpm": 5000}}).case)
    assert float(beat["pump_inlet_pressure"]) < -100.0 < float(beat["lowest_drainage_pressure"])
    assert beat["pump_inlet_pressure"].attrs["finding"] == "warning"


def test_veno_venous_beside_veno_arterial_ecmo_recirculates_only_what_it_drains_beyond_the_organs_flow():
    """CO was taken for the venous return, which the other circuit raises: 0.30 L/min "flowed back"."""
    pump = {"pump": "Rotaflow", "oxygenator": "Quadrox-i Adult"}
    raw = {
        "format": 1, "parameters": {"Emaxlv": 0.6},
        "patient": {"id": "two", "sex": "male", "age_years": 60, "heart_rate_bpm": 90},
        "ecmo": {
            "a": pump | {"mode": "VA", "speed_rpm": 3000}, "b": pump | {"mode": "VV", "speed_rpm": 2500},
        },
    }  # fmt: skip
    both = eclsim.simulate(read_mapping(raw).case)
    assert float(both["ecmo.b.PF"]) > float(both["CO"]) + 0.1
    assert not any("back to the drainage cannula" in sentence for sentence in both.attrs["warnings"])
    alone = read_mapping(raw | {"ecmo": {"b": raw["ecmo"]["b"] | {"speed_rpm": 4500}}}).case
    assert any(
        "back to the drainage cannula" in sentence for sentence in eclsim.simulate(alone).attrs["warnings"]
    )


# --- lines that are closed, blood that runs backwards, several circuits -----------------------------

ROTARY = {"ecmo.speed_rpm": 3000.0, "ecmo.oxygenator.lowest_flow_l_min": 0.5}
ROLLER_VALUES = {"ecmo.roller_l_min": 4.5}


def said_of(outputs, values, circuit=None):
    """Kinds and sentences about a V-A circuit with some outputs and parameters, in their order."""
    whole = circulation() + ecmo("ra", "ao") if circuit is None else circuit
    return [(one.kind, one.sentence) for one in findings(outputs, {}, whole, values)]


@pytest.mark.parametrize(
    ("clamp", "flow", "words"),
    [
        ({"return_clamp": 1.0}, 0.0, "against a closed return line: no blood reaches the patient"),
        ({"drainage_clamp": 1.0}, 0.0, "with a closed drainage line: no blood reaches the patient"),
        ({"return_clamp": 0.995}, 0.034, "a return line that is 99.5 % closed: only 0.03 L/min reach the"),
        ({"return_clamp": 1.0, "second_return_fr": 15.0, "second_return_clamp": 1.0}, 0.0, "closed return"),
    ],
)
def test_a_pump_that_runs_against_a_closed_line_is_an_alarm(clamp, flow, words):
    """At 3000 rpm against a clamp only a low arterial pressure was said: nothing of the circuit."""
    values = ROTARY | {f"ecmo.{name}": value for name, value in clamp.items()}
    found = said_of({"PF": flow, "MAP": 50.0, "post_pump_pressure": 275.0}, values)
    assert found[0][0] == "alarm"
    assert "the ECMO pump runs at 3000 rpm" in found[0][1]
    assert words in found[0][1]
    assert not any("label" in text for _, text in found)
    stopped = said_of({"PF": flow, "MAP": 50.0}, values | {"ecmo.speed_rpm": 0.0})
    assert not any("pump runs" in text for _, text in stopped)


@pytest.mark.parametrize(
    "second", [{"second_return_fr": 15.0, "second_return_clamp": 0.3}, {"second_return_fr": 15.0}]
)
def test_a_circuit_with_an_open_second_return_is_not_closed(second):
    values = ROTARY | {"ecmo.return_clamp": 1.0} | {f"ecmo.{name}": value for name, value in second.items()}
    assert not any("pump runs" in text for _, text in said_of({"PF": 3.0}, values))
    resting = said_of({"PF": 0.0}, values | {"ecmo.speed_rpm": 0.0})
    assert any("stands still" in text for _, text in resting)
    closed = values | {"ecmo.speed_rpm": 0.0, "ecmo.second_return_clamp": 1.0}
    assert not any("stands still" in text for _, text in said_of({"PF": 0.0}, closed))


def test_at_no_clamp_is_a_running_pump_without_flow_passed_over():
    """Between the label's warning and the alarm there is no gap, at any clamp and in a batch."""
    own = read_mapping({**BAD_LUNGS, "ecmo": {**BAD_LUNGS["ecmo"], "return_clamp": 0.5}}).case
    without_gas = own.model_copy(update={"gas": None})
    clamps = (0.9, 0.95, 0.98, 0.99, 0.995, 0.999, 0.99999, 1.0)
    batch = eclsim.simulate_many(without_gas, {"ecmo.return_clamp": clamps})
    marks = [
        [
            text
            for text in str(warnings).split("\n")
            if "ECMO pump runs" in text or "outside the label" in text
        ]
        for warnings in batch["warnings"].values
    ]
    low = np.asarray(batch["PF"]) < 0.5
    assert [len(one) for one in marks] == low.astype(int).tolist()
    assert low.sum() >= 6
    assert marks[-1][0].startswith("alarm: the ECMO pump runs at 3000 rpm against a closed return line")


@pytest.mark.slow
def test_a_course_names_the_clamp_against_which_the_pump_runs():
    closes = {"at_min": 2, "set": {"ecmo.return_clamp": 1.0}}
    own = read_mapping({**{k: v for k, v in BAD_LUNGS.items() if k != "gas"}, "events": [closes]}).case
    result = eclsim.course(own, minutes=4.0, every_min=1.0)
    assert "alarm: at 00:02:01: the ECMO pump runs at 3000 rpm against a closed return line" in str(
        result.attrs["warnings"]
    )


def roller(**keys):
    """Case with a roller pump of 4.5 L/min and keys of its circuit."""
    section = {name: value for name, value in BAD_LUNGS["ecmo"].items() if name != "speed_rpm"}
    return {**BAD_LUNGS, "ecmo": section | {"pump": {"roller_l_min": 4.5}} | keys}


@pytest.mark.parametrize("key", ["return_clamp", "drainage_clamp"])
def test_a_roller_pump_is_refused_against_a_closed_line(key):
    """No steady beat was found, with the advice to check the parameters against their ranges."""
    with pytest.raises(CaseError, match=rf"ecmo.{key} = 1: a roller pump cannot run against a closed line"):
        read_mapping(roller(**{key: 1.0}))
    read_mapping(roller(**{key: 1.0, "pump": {"roller_l_min": 0}}))
    read_mapping(roller(return_clamp=1.0, second_return_site="svn", second_return_fr=15))
    read_mapping(roller(drainage_clamp=1.0) | {"vent": {"site": "la", "fr": 15}})


@pytest.mark.parametrize(
    ("values", "pressures", "kind", "words"),
    [
        ({"ecmo.return_clamp": 0.7}, {"post_pump_pressure": 1187.0}, "alarm", "1187 mmHg behind the pump"),
        ({"ecmo.return_clamp": 0.9}, {"post_pump_pressure": 9440.0}, "collapse", "9440 mmHg behind the pump"),
        ({"ecmo.drainage_clamp": 0.8}, {"pump_inlet_pressure": -2000.0}, "collapse", "-2000 mmHg before the"),
    ],
)
def test_what_a_roller_pump_does_to_a_narrowed_line_comes_first(values, pressures, kind, words):
    """Empty chambers and arterial pressures came before the line that explained them."""
    outputs = {"PF": 4.5, "MAP": 1.7, "ejection_fraction_lv": -3.0, **pressures}
    found = [one for one in said_of(outputs, ROLLER_VALUES | values) if one[0] == kind]
    assert len(found) > 1 or kind == "collapse"
    assert "the ECMO roller pump moves 4.5 L/min through a " in found[0][1]
    assert words in found[0][1]
    assert "speed" not in "".join(text for _, text in said_of(outputs, ROLLER_VALUES | values))
    open_line = said_of({"PF": 4.5, **pressures}, ROLLER_VALUES)
    assert not any("roller pump moves" in text for _, text in open_line)


def test_a_roller_pump_that_stands_still_is_said_to_supply_nobody():
    values = ROLLER_VALUES | {"ecmo.roller_l_min": 0.0, "ecmo.oxygenator.lowest_flow_l_min": 0.5}
    assert any("stands still" in text for _, text in said_of({"PF": 0.0}, values))


def test_samples_of_a_circuit_in_which_blood_runs_backwards_are_read_with_care():
    """99.99 % "of the drained blood" and 83.5 % of the returned one had no mark."""
    names = ("SpreO2", "SpostO2", "SreturnO2", "recirculation_fraction", "VO2_oxygenator", "VCO2_oxygenator")
    beat = eclsim.simulate(read_mapping({**BAD_LUNGS, "ecmo": {**BAD_LUNGS["ecmo"], "speed_rpm": 0}}).case)
    assert float(beat["PF"]) < -0.5
    assert [beat[name].attrs["read_with_care"] for name in names] == [1] * len(names)
    (text,) = (one for one in beat.attrs["warnings"] if "runs backwards through the ECMO (" in one)
    assert "SpreO2 and SpostO2 are of blood that has passed the oxygenator" in text
    assert not any("differential hypoxaemia" in one for one in beat.attrs["warnings"])
    running = harlequin()[1]
    assert not any(running[name].attrs.get("read_with_care") for name in names)


@pytest.mark.slow
@pytest.mark.parametrize(
    "ecmo_keys",
    [
        {"speed_rpm": 2700, "fdo2": 0.8, "second_return_site": "svn", "second_return_fr": 17,
         "second_return_clamp": 0.5},
        {"speed_rpm": 2700, "fdo2": 0.8, "return_site": "ra", "mode": None, "second_return_site": "ao",
         "second_return_fr": 17, "drainage_site": "svn", "drainage_cannula": "venous",
         "return_cannula": "arterial"},
    ],
)  # fmt: skip
def test_only_the_flow_that_ends_in_arteries_mixes_with_the_blood_of_the_heart(ecmo_keys):
    """On V-AV ECMO the flow to the veins counted too: 86 % where the heart ejected 89 %; V-VA was silent."""
    section = {k: v for k, v in {**BAD_LUNGS["ecmo"], **ecmo_keys}.items() if v is not None}
    gas = {**BAD_LUNGS["gas"], "shunt_fraction": 0.8}
    beat = eclsim.simulate(read_mapping({**BAD_LUNGS, "gas": gas, "ecmo": section}).case)
    (text,) = (one for one in beat.attrs["warnings"] if "differential hypoxaemia" in one)
    named = float(text.split("of about ")[1].split(" %")[0])
    assert named == pytest.approx(beat["Ppvn"].attrs["SO2"], abs=1.0)


@pytest.mark.slow
def test_a_clamped_circuit_mixes_no_blood_with_that_of_the_heart():
    """The caution was said at an ECMO flow of 0.00 L/min, where all arterial blood is the heart's."""
    said, beat = harlequin(circuit={"return_clamp": 1.0})
    assert said == []
    assert float(beat["SaO2"]) < 90.0


@pytest.mark.slow
def test_blood_that_an_lvad_carries_is_blood_of_the_heart():
    """Only that through the valve counted: 0.4 of 2.9 L/min, and a saturation of 0 %."""
    pump = {"pump": "HM3", "speed_rpm": 4500, "inlet_site": "lv", "outlet_site": "ao"}
    beat = eclsim.simulate(read_mapping({**BAD_LUNGS, "lvad": pump}).case)
    (text,) = (one for one in beat.attrs["warnings"] if "differential hypoxaemia" in one)
    assert "first get what the heart and the LVAD eject" in text
    named = float(text.split("of about ")[1].split(" %")[0])
    assert named == pytest.approx(beat["Ppvn"].attrs["SO2"], abs=1.5)


@pytest.mark.slow
def test_blood_of_two_circuits_is_taken_out_of_the_mixture_once():
    pump = {"pump": "Rotaflow", "oxygenator": "Quadrox-i Adult", "mode": "VA"}
    both = {"a": pump | {"speed_rpm": 2500}, "b": pump | {"speed_rpm": 2200}}
    beat = eclsim.simulate(read_mapping({**BAD_LUNGS, "ecmo": both}).case)
    (text,) = (one for one in beat.attrs["warnings"] if "differential hypoxaemia" in one)
    named = float(text.split("of about ")[1].split(" %")[0])
    assert named == pytest.approx(beat["Ppvn"].attrs["SO2"], abs=1.5)


@pytest.mark.slow
def test_two_veno_venous_circuits_drain_together_more_than_comes_back():
    """Each was compared alone: 4.4 of 5.2 L/min, while 8.8 L/min were drained from one atrium."""
    pump = {
        "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult", "drainage_site": "ra",
        "drainage_cannula": "venous", "drainage_fr": 23, "return_site": "ra", "return_cannula": "arterial",
        "return_fr": 19,
    }  # fmt: skip
    beat = eclsim.simulate(read_mapping({**BAD_LUNGS, "ecmo": {"a": pump, "b": pump}}).case)
    (text,) = (one for one in beat.attrs["warnings"] if "back to the drainage" in one)
    drained, output = float(beat["ecmo.a.PF"] + beat["ecmo.b.PF"]), float(beat["systemic_flow"])
    assert f"together drain {drained:.2f} L/min, but only {output:.2f} L/min come back" in text
    assert f"at least {100.0 * (drained - output) / drained:.0f} % of the drained blood" in text
    # Everything that both return mixes in the atrium with what comes back from the body.
    share = float(text.split("by its oxygen about ")[1].split(" %")[0])
    assert share == pytest.approx(100.0 * drained / (drained + output), abs=2.0)
    for name in ("ecmo.a.PF", "ecmo.b.PF", "ecmo.b.recirculation_fraction"):
        assert beat[name].attrs["read_with_care"] == 1


def test_veno_venous_ecmo_of_a_heart_that_stands_is_judged_without_a_share_by_oxygen():
    """The share by oxygen was divided by the output of the heart."""
    outputs = {
        "PF": 4.0,
        "CO": 0.0,
        "VO2": 200.0,
        "SaO2": 90.0,
        "PaO2": 60.0,
        "SpreO2": 90.0,
        "SpostO2": 100.0,
    }
    circuit = circulation() + ecmo("ra", "svn")
    text = next(f.sentence for f in findings(outputs, {}, circuit) if "come back from the body" in f.sentence)
    assert "only 0.00 L/min come back" in text
