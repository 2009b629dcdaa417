"""Every knob of every preset turns, and says why a value cannot be."""

from pathlib import Path

import pytest

from eclsim.app.beat import compute_beat
from eclsim.app.display import described
from eclsim.app.drawing import drawing_of, drawing_of_circuit
from eclsim.app.knobs import (
    VOLUME,
    connect,
    connectable,
    connected,
    controls,
    turn,
    value_of,
)
from eclsim.app.remarks import beside_knob
from eclsim.app.state import PageState
from eclsim.app.texts import ENGLISH
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import read_case, read_mapping
from eclsim.cases.resolve import circuit_of
from eclsim.cases.sections import PATIENT_SECTIONS, Gas
from eclsim.circuit import Circuit, Connection
from eclsim.components import Resistance
from eclsim.devices.description import Knob, Picker, plain_control
from eclsim.devices.ecmo import OTHER_MODE, ROLLER_PUMP
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.results import simulate

EXAMPLE = Path(__file__).parents[2] / "examples" / "veno_venous_blood_gases.toml"
CASES = {key: preset.case() for key, preset in PRESETS.items()}


def everything_on():
    """The paper's patient with every optional section and a second return cannula."""
    case = CASES["paper"]
    for section in PATIENT_SECTIONS:
        case = connect(case, section.section)
    return turn(case, "ecmo.second_return_site", "pas")


CASES["everything"] = everything_on()
EVERY = [(key, control) for key, case in CASES.items() for control in controls(case)]


@pytest.mark.parametrize(("key", "control"), EVERY, ids=lambda v: getattr(v, "key", v))
def test_every_control_turns_and_is_read_back(key, control):
    case = CASES[key]
    choices = [control.low, control.high] if isinstance(control, Knob) else [k for k, _ in control.options]
    if key == "everything" and isinstance(control, Picker):  # most sites are taken, or gone without regions
        choices = [value_of(case, control.key)]
    for value in choices:
        shown = value_of(turn(case, control.key, value), control.key)
        assert shown == (pytest.approx(value, abs=1e-3) if isinstance(control, Knob) else value)


@pytest.mark.parametrize(("key", "control"), EVERY, ids=lambda v: getattr(v, "key", v))
def test_every_control_has_words_and_shows_a_value_it_can_take(key, control):
    assert control.label
    shown = value_of(CASES[key], control.key)
    if isinstance(control, Picker):
        assert shown in dict(control.options)
    else:
        assert control.low <= float(shown) <= control.high


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("3,425", "3,425 may mean 3.425 or 3425: type one of the two"),
        ("3.425", "3.425 may mean 3.4250 or 3425: type one of the two"),
        ("1.000", "1.000 may mean 1 or 1000: type one of the two"),
        ("1.234,5", "decimal point"),
        ("1,234,500", "thousands separator"),
        ("120/80", "two"),
        ("fast", "not a number"),
        ("", "needed"),
        ("1e400", "too large"),
        ("-3", "outside"),
        ("nan", "not a number"),
        ("3000 rpm", "did you mean 3000"),
        ("<script>alert(1)</script>", "not a number"),
    ],
)
def test_typed_values_that_cannot_be_say_why(typed, message):
    with pytest.raises(CaseError, match=message):
        turn(CASES["paper"], "ecmo.speed_rpm", typed)


@pytest.mark.parametrize(
    ("typed", "read"), [("0,76", 0.76), ("1,5", 1.5), ("0,125", 0.125), ("1,2345", 1.2345), (" 1,25 ", 1.25)]
)
def test_a_decimal_comma_that_can_be_nothing_else_is_a_point(typed, read):
    assert turn(CASES["paper"], "parameters.Rmc", typed).parameters["Rmc"] == read


def test_three_decimals_are_meant_where_a_quantity_has_decimals():
    assert turn(CASES["paper"], "parameters.Csart", "3.185").parameters["Csart"] == 3.185
    assert turn(CASES["paper"], "ecmo.speed_rpm", "3.4250").ecmo.speed_rpm == 3.425
    assert turn(CASES["paper"], "patient.heart_rate_bpm", "72.5").patient.heart_rate_bpm == 72.5


def test_typed_digits_count_as_a_number():
    assert turn(CASES["paper"], "ecmo.speed_rpm", " 3050 ").ecmo.speed_rpm == 3050


@pytest.mark.parametrize("typed", ["nan", "NaN", "Infinity", "abc"])
def test_what_is_no_number_is_called_so(typed):
    """nan "was not given", and needed "where the key is written"."""
    with pytest.raises(CaseError) as refused:
        turn(CASES["paper"], "ecmo.speed_rpm", typed)
    said = beside_knob(refused.value.mistakes[0], CASES["paper"])
    assert said == f'"{typed}": not a number; allowed: 0 to 10000 rpm'


@pytest.mark.parametrize(("typed", "meant"), [("３０５０", "3050"), ("٣٠50", "3050"), ("３ rpm", "")])
def test_digits_of_other_scripts_are_not_read_in_silence(typed, meant):
    with pytest.raises(CaseError) as refused:
        turn(CASES["paper"], "ecmo.speed_rpm", typed)
    assert refused.value.mistakes[0].message == "digits other than 0 to 9"
    assert refused.value.mistakes[0].suggestion == meant


@pytest.mark.parametrize("key", ["patient.id", "parameters.Rao", "lvad.speed_rpm", "__class__", ""])
def test_what_is_no_knob_of_the_case_cannot_be_turned(key):
    with pytest.raises(CaseError, match="cannot be changed here"):
        turn(CASES["paper"], key, 1.0)


@pytest.mark.parametrize("given", [-150.0, 0.0, 80.0, 500.0])
def test_blood_that_is_given_is_in_the_patient(given):
    case = CASES["healthy"]

    def stressed_ml(one):
        model = model_of(one)
        return float(Batch(model.circuit, model.values, 1, "patient_held").volume().target[0])

    none = stressed_ml(turn(case, VOLUME, 0.0))
    assert stressed_ml(turn(case, VOLUME, given)) - none == pytest.approx(given, abs=1e-3)


@pytest.mark.parametrize("key", CASES)
@pytest.mark.parametrize("device", connectable())
def test_devices_are_connected_and_taken_away(key, device):
    case = CASES[key]
    there = getattr(case, device) is not None
    if device == "renox" and case.ecmo is None:
        with pytest.raises(CaseError, match="RenOx replaces the oxygenator"):
            connect(case, device)
        return
    changed = connect(case, device)
    assert (getattr(changed, device) is not None) is not there


def test_renox_is_switched_on_and_its_fluids_are_turned():
    case = turn(connect(CASES["paper"], "renox"), "renox.dialysate_ml_h", 3000)
    slow, fast = (compute_beat(PageState(turn(case, "renox.dialysate_ml_h", flow))) for flow in (1500, 3000))
    assert fast.outputs["renox_clearance_urea"] == pytest.approx(50, rel=0.01), "all of 3000 mL/h"
    assert slow.outputs["renox_clearance_urea"] == pytest.approx(25, rel=0.01)
    assert connect(case, "renox") == CASES["paper"]


def test_what_cannot_be_without_ecmo_goes_with_it():
    """It was refused with "the case has no [ecmo] section", and a vent has no switch of its own."""
    vented = CASES["paper"].as_mapping() | {"vent": {"site": "lv", "fr": 15.0}}
    case = connect(connect(read_mapping(vented).case, "renox"), "ecmo")
    assert {"ecmo", "renox", "vent"}.isdisjoint(connected(case))
    assert case == connect(CASES["paper"], "ecmo")


def test_crrt_moves_to_the_patient_when_ecmo_goes():
    single = connect(CASES["paper"], "ecmo")
    assert (single.crrt.access_site, single.crrt.return_site) == ("svn", "ra")


def test_a_new_pump_starts_inside_its_own_speeds():
    case = turn(turn(CASES["paper"], "ecmo.pump", ROLLER_PUMP), "ecmo.pump", "DP3")
    assert 4000 <= case.ecmo.speed_rpm <= 8000


def test_the_oxygenator_wins_over_an_older_resistance_of_its_own():
    raw = CASES["paper"].as_mapping()
    raw["parameters"]["Recmooxy"] = 2.0
    case = type(CASES["paper"]).model_validate(raw)
    other = turn(case, "ecmo.oxygenator", "Nautilus MC3")
    assert model_of(other).values["Recmooxy"] == pytest.approx(0.6312)


@pytest.mark.slow
def test_an_oxygenator_clots_by_a_knob_and_a_new_one_has_its_own_resistance():
    case = turn(connect(CASES["paper"], "gas"), "parameters.ecmo.oxygenator.clotted_fraction", 0.8)
    assert case.parameters["ecmo.oxygenator.clotted_fraction"] == 0.8
    whole, clotted = (compute_beat(PageState(one)) for one in (connect(CASES["paper"], "gas"), case))
    assert clotted.outputs["SpostO2"] < whole.outputs["SpostO2"] - 5.0
    blocked = turn(case, "parameters.Recmooxy", "3,5")
    assert model_of(blocked).values["Recmooxy"] == 3.5
    assert value_of(turn(blocked, "ecmo.oxygenator", "Nautilus MC3"), "parameters.Recmooxy") == 0.6312


def test_the_filter_of_each_of_two_circuits_clots_by_itself():
    raw = CASES["paper"].as_mapping()
    raw["crrt"] = {"left": raw["crrt"], "right": raw["crrt"] | {"access_site": "svn", "return_site": "ra"}}
    case = turn(read_mapping(raw).case, "parameters.crrt.right.Rcrrtfil", 60.0)
    filters = [value_of(case, f"parameters.crrt.{name}.Rcrrtfil") for name in ("left", "right")]
    assert filters == [15.75, 60.0]
    knob = next(one for one in controls(case) if one.key == "parameters.crrt.right.Rcrrtfil")
    assert knob.group == "crrt.right"
    assert described(knob)["hint"] == "crrt.right.Rcrrtfil: Resistance of dialyzer"


def test_a_vent_is_drawn_with_its_flow_and_the_limits_of_it():
    """It was in the exported figure alone; its flow stood nowhere but among the outputs."""
    raw = CASES["paper"].as_mapping() | {"vent": {"site": "lv", "fr": 15}}
    drawing = drawing_of(read_mapping(raw).case)
    lines = {line["name"]: line for line in drawing["lines"]}
    vent = lines["vent"]
    assert (vent["ends"], vent["unit"], vent["outputs"]) == (["lv", "ecmodrain"], "L/min", ["vent_flow"])
    assert not vent["moves"]
    assert vent["at"] != lines["ecmodrain"]["at"]


def test_the_frame_of_a_balloon_has_the_unit_of_its_pressure():
    frames = {f["group"]: f["flows"] for f in drawing_of(connect(CASES["healthy"], "iabp"))["frames"]}
    assert frames == {"iabp": "mmHg", "patient": "mmHg, L/min"}


def test_boxes_name_the_outputs_of_their_saturation():
    boxes = {box["name"]: box["saturation"] for box in drawing_of(CASES["paper"])["boxes"]}
    assert (boxes["sart"], boxes["pas"], boxes["ecmodrain"]) == (["SaO2"], ["SvO2"], ["SpreO2"])
    assert boxes["lv"] == []


def test_boxes_of_named_devices_and_of_regions_name_their_saturations_too():
    """The box of a named ECMO's drained blood and that of the upper body had no sign of a limit."""
    raw = CASES["paper"].as_mapping()
    ecmo = {key: value for key, value in raw["ecmo"].items() if "crrt" not in key}
    named = {"format": 1, "patient": raw["patient"], "ecmo": {"b": ecmo}, "physiology": {"regional": True}}
    boxes = {box["name"]: box["saturation"] for box in drawing_of(read_mapping(named).case)["boxes"]}
    assert boxes["ecmo.b.ecmodrain"] == ["ecmo.b.SpreO2"]
    assert (boxes["upper"], boxes["lower"]) == (["SaO2"], ["SaO2_lower"])


def test_a_connection_without_a_place_is_drawn_as_in_the_figure():
    shunt = Circuit(connections=(Connection("shunt", Resistance(1.0), "sart", "ra", "own"),))
    drawing = drawing_of_circuit(circuit_of(CASES["healthy"]) + shunt)
    (line,) = [line for line in drawing["lines"] if line["name"] == "shunt"]
    boxes = {box["name"]: box for box in drawing["boxes"]}
    for (x, y), name in zip((line["path"][0], line["path"][-1]), ("sart", "ra"), strict=True):
        assert -0.1 <= x - boxes[name]["x"] <= boxes[name]["w"] + 0.1
        assert -0.1 <= y - boxes[name]["y"] <= boxes[name]["h"] + 0.1


@pytest.mark.parametrize(
    ("drained", "returned", "mode"),
    [("svn", "sart", "VA"), ("ra", "svn", "VV"), ("lv", "pas", OTHER_MODE), ("part", "ao", OTHER_MODE)],
)
def test_ecmo_takes_any_two_compartments_and_draws_them(drained, returned, mode):
    case = CASES["paper"]
    for key, site in (("ecmo.drainage_site", drained), ("ecmo.return_site", returned)):
        case = turn(case, key, site)
    assert value_of(case, "ecmo.mode") == mode
    ends = {line["name"]: line["site"] for line in drawing_of(case)["lines"]}
    assert (ends["ecmodrain"], ends["ecmoreturn"]) == (drained, returned)
    assert value_of(turn(case, "ecmo.mode", "VV"), "ecmo.return_site") == "ra"


@pytest.mark.parametrize(
    ("key", "other"), [("drainage_site", "return_site"), ("return_site", "drainage_site")]
)
def test_cannulae_change_places_where_one_is_put_to_the_other(key, other):
    ecmo = CASES["paper"].ecmo
    knobs = {control.key: control for control in controls(CASES["paper"])}
    site = getattr(ecmo, other)
    assert dict(knobs[f"ecmo.{key}"].options)[site].endswith("(swap)")
    swapped = turn(CASES["paper"], f"ecmo.{key}", site).ecmo
    assert (getattr(swapped, key), getattr(swapped, other)) == (site, getattr(ecmo, key))


def test_a_patient_in_regions_offers_its_own_sites_and_has_a_drawing():
    raw = PRESETS["paper"].case().as_mapping() | {"physiology": {"regional": True}}
    case = turn(read_mapping(raw).case, "ecmo.mode", "VV")
    sites = {c.key: [name for name, _ in c.options] for c in controls(case) if isinstance(c, Picker)}
    assert {"svc", "ivc", "lower"} <= set(sites["crrt.access_site"])
    for key in ("ecmo.drainage_site", "ecmo.return_site", "crrt.access_site"):
        assert "svn" not in sites[key]
        assert value_of(case, key) in sites[key], "what a picker shows is one of its choices"
    assert value_of(case, "ecmo.drainage_site") == "ivc"
    wires = {wire["name"]: wire["path"] for wire in drawing_of(case)["wires"]}
    assert {"ao", "archupper", "arch", "descending", "upper", "lower", "svc", "ivc"} <= set(wires)
    assert len(wires["ivc"]) == 4, "past the superior cava"


def test_sections_of_the_patient_are_switched_and_knobs_come_with_them():
    def keys(case, section):
        return {c.key.partition(".")[2] for c in controls(case) if c.group == section}

    case = CASES["paper"]
    assert keys(case, "gas") == set()
    assert not {"sweep_l_min", "fdo2"} & keys(case, "ecmo"), "without effect where no gases are computed"
    on = connect(case, "gas")
    assert {"fio2", "shunt_fraction", "haemoglobin_g_dl", "vo2_ml_min"} <= keys(on, "gas")
    assert {"sweep_l_min", "fdo2"} <= keys(on, "ecmo")
    assert value_of(on, "ecmo.sweep_l_min") == 4.0
    assert value_of(on, "gas.vo2_ml_min") == pytest.approx(126.0 * (165 * 60 / 3600) ** 0.5, rel=1e-3)
    assert turn(on, "ecmo.sweep_l_min", "2,5").ecmo.sweep_l_min == 2.5
    with pytest.raises(CaseError, match=r"0[.]4"):
        turn(on, "gas.fio2", "40")
    assert connect(on, "gas") == case


def test_a_heart_is_shown_as_paced_only_if_it_is():
    """With reflexes the knob stood at 0 (paced) while the heart rate followed them wholly."""
    case = connect(PRESETS["paper"].case(), "regulation")
    assert value_of(case, "regulation.heart_rate_response") == 1.0
    assert value_of(turn(case, "regulation.heart_rate_response", 0), "regulation.heart_rate_response") == 0.0
    assert value_of(case, "regulation.chemoreflex") == 0.0


@pytest.mark.parametrize("preset", ["healthy", "cardiogenic-shock", "right-heart-failure", "lvad"])
def test_lungs_that_nothing_helps_are_not_those_of_a_patient_on_an_oxygenator(preset):
    """Default lungs rest on ECMO; alone they gave a healthy adult a pH of 7.14 and a saturation of 83 %."""
    beat = compute_beat(PageState(connect(PRESETS[preset].case(), "gas")))
    outputs = beat.outputs
    assert 95 < outputs["SaO2"] < 99
    assert 35 < outputs["PaCO2"] < 45
    assert 7.35 < outputs["pHa"] < 7.45
    alarms = [finding.sentence for finding in beat.findings if finding.kind == "alarm"]
    assert not any("satur" in sentence or "PCO2" in sentence for sentence in alarms)


def test_lungs_beside_an_oxygenator_are_those_of_a_case_file():
    for preset in ("paper", "vv-ecmo"):
        assert connect(PRESETS[preset].case(), "gas").gas.model_dump() == Gas().model_dump()


def test_regions_are_a_choice_and_leave_no_site_that_is_gone():
    case = connect(CASES["paper"], "physiology")
    assert value_of(case, "physiology.regional") == "true"
    femoral = turn(case, "ecmo.return_site", "lower")
    with pytest.raises(CaseError, match="lower"):
        turn(femoral, "physiology.regional", "false")
    whole = turn(case, "physiology.regional", "false")
    assert whole.physiology.regional is False
    assert "physiology.upper_share" not in {c.key for c in controls(whole)}


def test_a_second_cannula_is_put_in_and_taken_out():
    case = CASES["paper"]
    there = turn(case, "ecmo.second_return_site", "pas")
    knobs = {c.key for c in controls(there)}
    assert {"ecmo.second_return_fr", "ecmo.second_return_clamp"} <= knobs
    clamped = turn(there, "ecmo.second_return_clamp", 0.5)
    assert clamped.ecmo.second_return_clamp == 0.5
    assert turn(clamped, "ecmo.second_return_site", "").ecmo == case.ecmo


def test_blood_that_runs_backwards_can_be_stopped_as_the_alarm_says():
    """The alarm said "clamp it", and no clamp was there."""
    stopped = turn(CASES["paper"], "ecmo.speed_rpm", 0)
    beat = simulate(stopped)
    assert float(beat["PF"]) < -0.1
    assert any("clamp it" in warning for warning in beat.attrs["warnings"])
    assert value_of(stopped, "ecmo.return_clamp") == 0.0
    clamped = simulate(turn(stopped, "ecmo.return_clamp", 1))
    assert float(clamped["PF"]) == pytest.approx(0.0, abs=1e-3)


def test_sites_are_shown_where_drainage_and_return_share_a_compartment():
    case = read_case(EXAMPLE).case
    knobs = {control.key: control for control in controls(case)}
    assert "ra" in dict(knobs["ecmo.drainage_site"].options)
    assert "ra" in dict(knobs["ecmo.return_site"].options)
    assert turn(case, "ecmo.drainage_mixing", 0.4).ecmo.drainage_mixing == 0.4
    apart = turn(case, "ecmo.drainage_site", "svn")
    assert "ecmo.drainage_mixing" not in {control.key for control in controls(apart)}


def test_second_cannulae_and_bronchial_return_are_drawn():
    case = turn(connect(CASES["paper"], "physiology"), "physiology.bronchial_fraction", 0.02)
    case = turn(case, "ecmo.second_return_site", "pas")
    drawing = drawing_of(case)
    lines = {line["name"]: line for line in drawing["lines"]}
    assert lines["ecmoreturn2"]["ends"] == ["ecmoreturn", "pas"]
    assert lines["ecmoreturn2"]["at"] != lines["ecmoreturn"]["at"]
    (bronchial,) = [wire for wire in drawing["wires"] if wire["name"] == "bronchial"]
    assert bronchial["ends"] == ["descending", "pvn"]


def test_labels_of_knobs_are_short_and_units_are_written_as_usual():
    every = [(one, name) for one in PATIENT_SECTIONS for name in one.fields()]
    turned = [f"{one.section}.{name}" for one, name in every if plain_control(one.fields()[name])]
    long = [key for key in turned if len(ENGLISH.get(key, "?" * 99)) > 34]
    assert long == []
    units = [described(control).get("unit") for control in controls(everything_on())]
    assert {"°C", "cm²", "µg/kg/min", "µmol/L"} <= set(units)
    assert not {"C", "cm2"} & set(units)
    assert not [unit for unit in units if unit and unit.startswith("u")]


VV, VV_GAS = CASES["vv-ecmo"], connect(CASES["vv-ecmo"], "gas")


def cannulae_of(case):
    one = case.ecmo
    lines = ("drainage", "return")
    return [tuple(getattr(one, f"{line}_{what}") for what in ("cannula", "fr", "site")) for line in lines]


@pytest.mark.parametrize(
    ("case", "chosen", "stem", "size", "sites", "mixing"),
    [
        (VV_GAS, "avalon", "avalon", 27.0, ("ra", "ra"), 0.15),
        (VV_GAS, "protek", "protek", 29.0, ("ra", "pas"), None),
        (VV, "crescent", "crescent", 26.0, ("svn", "ra"), None),
    ],
)
def test_a_dual_lumen_cannula_is_chosen_with_both_lumens_and_its_sites(
    case, chosen, stem, size, sites, mixing
):
    """No knob of the page led to one."""
    assert value_of(case, "ecmo.cannulae") == "two"
    changed = turn(turn(case, "ecmo.drainage_fr", 26), "ecmo.cannulae", chosen)
    lines = zip(("drainage", "return"), sites, strict=True)
    assert cannulae_of(changed) == [(f"{stem}_{line}", size, site) for line, site in lines]
    assert changed.ecmo.drainage_mixing == mixing
    assert value_of(changed, "ecmo.cannulae") == chosen
    back = turn(changed, "ecmo.cannulae", "two")
    assert cannulae_of(back) == [("venous", 25.0, sites[0]), ("venous", 21.0, sites[1])]
    assert back.ecmo.drainage_mixing == (None if mixing is None else 0.33)


def test_both_lumens_of_a_cannula_have_one_size():
    """Lumens of 27 and 31 Fr were accepted."""
    case = turn(turn(VV_GAS, "ecmo.cannulae", "avalon"), "ecmo.return_fr", 31)
    assert [size for _, size, _ in cannulae_of(case)] == [31.0, 31.0]
    two = turn(VV_GAS, "ecmo.drainage_fr", 29)
    assert [size for _, size, _ in cannulae_of(two)] == [29.0, 21.0]


def test_veno_venous_cannulae_share_the_right_atrium_only_where_recirculation_is_computed():
    """The return went to the systemic veins when drainage from the right atrium was chosen."""
    both = turn(VV_GAS, "ecmo.drainage_site", "ra")
    assert (both.ecmo.drainage_site, both.ecmo.return_site) == ("ra", "ra")
    assert value_of(both, "ecmo.drainage_mixing") == 0.33
    with pytest.raises(CaseError, match=r"pump in a circle; in a vein only with \[gas\]"):
        connect(both, "gas")
    apart = turn(both, "ecmo.drainage_site", "svn")
    assert (apart.ecmo.return_site, apart.ecmo.drainage_mixing) == ("ra", None)
    swapped = turn(VV, "ecmo.drainage_site", "ra")
    assert (swapped.ecmo.drainage_site, swapped.ecmo.return_site) == ("ra", "svn")
    words = [
        dict(control.options)["ra"] for case in (VV, VV_GAS) for control in controls(case)
        if control.key == "ecmo.drainage_site"
    ]  # fmt: skip
    assert words == ["right atrium (swap)", "right atrium (both)"]


def test_cannulae_that_are_none_are_refused():
    with pytest.raises(CaseError, match="cannulae"):
        turn(VV, "ecmo.cannulae", "straw")
