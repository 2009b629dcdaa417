import pytest

from eclsim.cases.reading import read_mapping
from eclsim.devices.crrt import CRRT, crrt
from eclsim.devices.description import Limit
from eclsim.devices.ecmo import ecmo
from eclsim.devices.lvad import lvad
from eclsim.devices.vent import VENT, Vent
from eclsim.outputs.alarms import assumptions, breach, findings, impossible, watched_signals
from eclsim.outputs.cautions import cautions
from eclsim.patient.circulation import circulation
from eclsim.simulation.single import simulate

LIMITS = {
    "access alarm below -250": ({"crrt_access_pressure": -260.0}, "alarm"),
    "access alarm above 250": ({"crrt_access_pressure": 251.0}, "alarm"),
    "access warning above 190": ({"crrt_access_pressure": 200.0}, "warning"),
    "return alarm below -50": ({"crrt_return_pressure": -51.0}, "alarm"),
    "return alarm above 350": ({"crrt_return_pressure": 351.0}, "alarm"),
    "suction": ({"lowest_drainage_pressure": -120.0}, "warning"),
    "collapse of the drained vessel": ({"lowest_drainage_pressure": -350.0}, "collapse"),
    "flow back through the LVAD": ({"lvad_flow": -1.06}, "alarm"),
    "no ejection": ({"aortic_valve_flow": 0.001}, "warning"),
}


@pytest.mark.parametrize(("outputs", "kind"), LIMITS.values(), ids=LIMITS)
def test_a_broken_limit_is_said_with_value_and_unit(outputs, kind):
    (only,) = findings(outputs, {})
    (value,) = outputs.values()
    assert only.kind == kind
    assert only.value == value
    written = (f"{value:.1f} mmHg", f"{value:.2f} L/min", f"{value:.3f} L/min")
    assert any(number in only.sentence for number in written)


def test_nothing_is_said_within_the_limits():
    within = {
        "crrt_access_pressure": 189.0,
        "crrt_return_pressure": 349.0,
        "lowest_drainage_pressure": -99.0,
        "aortic_valve_flow": 1.2,
    }
    assert findings(within, {"Vlv": (30.0, 90.0), "Psvn": (2.0, 6.0)}) == []


def test_an_empty_chamber_and_an_impossible_vein_collapse():
    result = findings({}, {"Vra": (-1.0, 10.0), "Psvn": (-400.0, 5.0), "Vao": (-5.0, 5.0)})
    assert {finding.quantity for finding in result if finding.kind == "collapse"} == {"Vra", "Psvn"}
    assert impossible(result)
    assert {"EDVRA", "ESVRA"} == {name for finding in result for name in finding.concerns}


def test_collapsed_veins_need_no_pump():
    """The sentence told patients who bleed, without any device, what a pump would not reach."""
    (only,) = findings({"venous_pressure": -1.0}, {})
    assert "the great veins collapse: this flow would not reach the heart or a pump" in only.sentence


def test_an_assist_pump_may_carry_the_output_past_a_closed_valve():
    (carried,) = findings({"aortic_valve_flow": 0.0, "lvad_flow": 4.2}, {})
    assert "the LVAD carries the left ventricle's output (4.20 L/min)" in carried.sentence
    (stopped,) = findings({"aortic_valve_flow": 0.0, "lvad_flow": 0.0}, {})
    assert "does not eject" in stopped.sentence


def test_a_valve_that_leaks_more_than_it_lets_through_is_not_called_closed():
    leaks = {"aortic_valve_flow": -2.414, "peak_aortic_valve_flow": 4.0, "lvad_flow": 5.94}
    (leaking,) = findings(leaks, {})
    assert leaking.kind == "alarm"
    assert leaking.sentence == (
        "aortic valve flow -2.414 L/min: the valve stays closed and leaks 2.41 L/min more than it "
        "lets through: of the 5.94 L/min of the LVAD the organs get 3.53"
    )
    (opening,) = findings(
        {"aortic_valve_flow": -0.066, "peak_aortic_valve_flow": 662.7, "lvad_flow": 4.44}, {}
    )
    assert "the valve opens (peak flow 663 mL/s) and leaks 0.07 L/min more" in opening.sentence
    (even,) = findings({"aortic_valve_flow": 0.0, "peak_aortic_valve_flow": 505.0}, {})
    assert even.kind == "warning"
    assert even.sentence.endswith(
        "the valve opens (peak flow 505 mL/s), and as much as it lets through leaks back"
    )


def test_a_leak_beside_ecmo_takes_from_the_lvad_alone():
    leaks = {"aortic_valve_flow": -5.09, "peak_aortic_valve_flow": 4.0, "lvad_flow": 5.59}
    for organs in ({"systemic_flow": 4.1}, {"upper_body_flow": 1.4, "lower_body_flow": 2.7}):
        (leaking,) = findings(leaks | organs, {})
        assert leaking.sentence.endswith("of the 5.59 L/min of the LVAD the organs get 0.50")
    (all_of_it,) = findings(leaks | {"aortic_valve_flow": -6.0}, {})
    assert all_of_it.sentence.endswith("of the 5.59 L/min of the LVAD the organs get nothing")


def test_co_beside_a_leak_names_no_ejection_below_zero():
    (found,) = findings({"CO": 4.4, "LVO": -0.07}, {})
    assert "the aortic valve leaks more than it lets through, net -0.07 L/min (LVO)" in found.sentence


VA = circulation() + ecmo("ra", "ao")


def said(outputs, circuit=None):
    return [(finding.kind, finding.sentence) for finding in findings(outputs, {}, circuit)]


def test_mean_pressure_without_pulse_is_said_with_its_source():
    (pulse, mean) = sorted(said({"MAP": 43.0, "pulse_pressure": 1.2}))[::-1]
    assert mean[0] == "alarm"
    assert "43.0 mmHg is below 55 mmHg" in mean[1]
    assert "Walsh" in mean[1]
    assert pulse[0] == "warning"
    assert "1.2 mmHg is below 10 mmHg" in pulse[1]
    assert "empty" in pulse[1], "also a patient who bled, without ECMO"
    assert "(a convention of this project" in pulse[1]
    assert said({"pulse_pressure": 1.2, "lvad_flow": 4.0}) == []
    assert said({"MAP": 137.0})[0][0] == "alarm"


def test_a_circuit_above_400_mmhg_is_an_alarm_told_once():
    ((kind, sentence),) = said({"post_pump_pressure": 734.0, "pre_oxygenator_pressure": 720.0})
    assert kind == "alarm"
    assert "734.0 mmHg is above 400 mmHg" in sentence


def test_backflow_and_impossible_ejection_are_named():
    assert "runs backwards" in said({"PF": -0.78})[0][1]
    kind, sentence = said({"ejection_fraction_lv": -2995.0})[0]
    assert kind == "collapse"
    assert "-2995.0 %" in sentence


def test_the_left_side_on_arterial_return_is_a_caution_whether_the_ventricle_ejects_or_not():
    outputs = {"EDVLV": 158.0, "PCWP": 11.0, "end_diastolic_pressure_lv": 14.0, "aortic_valve_flow": 2.0}
    (caution,) = findings(outputs, {}, VA)
    assert caution.kind == "caution"
    assert "EDVLV, LVEDP and PCWP" in caution.sentence
    assert caution.concerns == ("PCWP", "EDVLV", "end_diastolic_pressure_lv")
    assert findings(outputs, {}, circulation() + ecmo("svn", "ra")) == []
    assert findings(outputs, {}, circulation()) == []


def test_output_of_lungs_and_ventricle_are_told_apart_where_devices_part_them():
    ((kind, sentence),) = said({"CO": 5.8, "LVO": 0.0, "systemic_flow": 5.8})
    assert kind == "caution"
    assert "flow through the lungs" in sentence
    assert "0.00 L/min (LVO)" in sentence
    assert said({"CO": 5.8, "LVO": 5.7}) == []
    ((_, of_regions),) = said({"CO": 5.8, "LVO": 0.0, "upper_body_flow": 2.0, "lower_body_flow": 3.8})
    assert of_regions.endswith("the organs get 5.80 L/min")


def test_a_return_behind_the_right_ventricle_tells_what_co_is():
    behind = {"CO": 2.7, "LVO": 8.2, "pulmonary_valve_flow": 2.7, "pulmonary_flow": 8.2, "systemic_flow": 8.2}
    ((kind, sentence),) = said(behind, circulation() + ecmo("ra", "pas"))
    assert kind == "caution"
    assert "CO 2.70 L/min is the flow through the pulmonary artery before the ECMO return" in sentence
    assert "the left ventricle itself ejects 8.20 L/min (LVO), the lungs get 8.20 L/min" in sentence
    ((_, sentence),) = said({"CO": 7.8, "LVO": 7.8, "pulmonary_valve_flow": 2.5, "pulmonary_flow": 7.8})
    assert "flow through the lungs; the right ventricle itself ejects 2.50 L/min" in sentence


def test_dialysis_above_the_flow_of_its_ecmo_is_an_alarm():
    inside, outside = crrt("ecmooxy", "ecmotuor"), crrt("svn", "svn")
    outputs = {"crrt_flow": 0.6, "PF": 0.4}
    assert [kind for kind, text in said(outputs, VA + inside) if "CRRT flow 0.60" in text] == ["alarm"]
    assert said(outputs, VA + outside) == []
    assert said({"crrt_flow": 0.2, "PF": 0.4}, VA + inside) == []


@pytest.mark.parametrize(
    ("access", "back", "carried", "alarm"),
    [
        ("ecmooxy", "ecmotudp", 0.30, True), ("ecmooxy", "ecmotudp", 0.41, False),
        ("ecmotudp", "ecmoreturn", 0.10, False), ("ecmotuor", "ecmooxy", 0.19, True),
    ],
)  # fmt: skip
def test_dialysis_is_compared_with_the_flow_that_reaches_the_patient(access, back, carried, alarm):
    """The pump between return and access carries the CRRT flow in a circle, which hid that none arrived."""
    outputs = {"crrt_flow": 0.2, "PF": carried}
    assert [kind for kind, text in said(outputs, VA + crrt(access, back)) if "CRRT flow" in text] == (
        ["alarm"] * alarm
    )


def test_dialysis_in_a_circle_doubts_its_clearance_on_an_ecmo_whose_returns_are_clamped():
    """Of a clearance of 25 mL/min 2 were left, without a word."""
    outputs = {
        "crrt_flow": 0.18, "PF": 0.18, "first_return_flow": 0.0, "second_return_flow": 0.0,
        "effective_clearance_urea": 2.25,
    }  # fmt: skip
    (only,) = (
        one
        for one in findings(outputs, {}, VA + crrt("ecmooxy", "ecmotudp"))
        if one.quantity == "crrt_flow" and one.kind == "alarm"
    )
    assert (
        "CRRT flow 0.18 L/min is above the 0.00 L/min that the ECMO returns to the patient" in only.sentence
    )
    assert "effective_clearance_urea" in only.concerns


def test_a_collapse_names_the_device_that_drains_that_side():
    both = VA + lvad("lv", "ao")
    result = findings({}, {"Vra": (-1.0, 10.0), "Vlv": (-2.0, 10.0), "Prv": (-400.0, 9.0)}, both)
    sentences = {finding.quantity: finding.sentence for finding in result}
    assert "the LVAD drains more than flows in" in sentences["Vlv"]
    assert "the ECMO drains more than flows in" in sentences["Vra"]
    assert "right ventricle -400.0 mmHg" in sentences["Prv"]
    (single,) = findings({}, {"Vlv": (-2.0, 10.0)}, circulation())
    assert single.sentence.endswith("the chamber collapses")


@pytest.mark.parametrize(
    ("flow", "values", "reason"),
    [
        (0.0, {"ecmo.return_clamp": 1.0}, "the ECMO carries 0.00 L/min, and against the clamp"),
        (0.6, {"ecmo.return_clamp": 0.9}, "the ECMO carries 0.60 L/min, and against the clamp"),
        (0.0, {}, "too little blood is left in the patient, as the ECMO drains nothing: give blood"),
        (3.0, {"ecmo.return_clamp": 0.1}, "the ECMO drains more than flows in: lower its flow or give blood"),
    ],
)
def test_a_device_that_is_clamped_is_not_said_to_drain_too_much(flow, values, reason):
    found = findings({"PF": flow}, {"Vra": (-2.0, 10.0)}, VA, values)
    (empty,) = (one for one in found if one.kind == "collapse")
    assert f"the chamber collapses; {reason}" in empty.sentence


@pytest.mark.parametrize(
    ("sites", "warned"), [(("svn", "ra"), True), (("ra", "ao"), False), (("tvc", "ra"), True)]
)
def test_venovenous_flow_above_the_venous_return_is_named(sites, warned):
    circuit = circulation() + ecmo(*sites)
    high, low = (findings({"PF": flow, "CO": 6.3}, {}, circuit) for flow in (9.0, 6.0))
    assert [one.quantity for one in high if "recirculation" in one.sentence] == ["PF"] * warned
    assert not [one for one in low if "recirculation" in one.sentence]


def test_an_ejection_fraction_is_read_with_care_where_an_lvad_empties_the_ventricle():
    outputs = {"ejection_fraction_lv": 62.0}
    (only,) = findings(outputs, {}, circulation() + lvad("lv", "ao"))
    assert only.kind == "caution"
    assert "ejection_fraction_lv" in only.concerns
    assert findings(outputs, {}, circulation()) == []


@pytest.mark.parametrize(("wedge", "dose", "said"), [(6.0, 0.5, 1), (20.0, 0.5, 0), (6.0, 0.0, 0)])
def test_drugs_fitted_to_congested_hearts_are_read_with_care_in_others(wedge, dose, said):
    found = findings({"PCWP": wedge, "CO": 3.0, "MAP": 60.0}, {}, None, {"drugs.milrinone": dose})
    assert len([one for one in found if "milrinone: fitted to failing hearts" in one.sentence]) == said


SEPTIC = {"MAP": 70.0, "right_atrial_pressure": 8.0, "CO": 7.0}


def test_a_beat_that_has_not_settled_is_named_where_no_device_parts_the_flows():
    """The first beat of a faster heart had its CO "before the return", of no device at all."""
    flows = {"CO": 11.8, "LVO": 12.0, "pulmonary_flow": 9.7}
    (sentence,) = [one.sentence for one in findings(flows, {}, circulation()) if one.quantity == "CO"]
    assert "through the pulmonary artery in a beat that has not settled; the lungs get 9.70" in sentence


def test_a_device_that_drains_the_pulmonary_artery_is_named():
    """A steady beat with such a device was called one that had not settled."""
    flows = {"CO": 8.14, "LVO": 6.58, "pulmonary_flow": 6.58}
    circuit = circulation() + ecmo("part", "ao")
    (sentence,) = [one.sentence for one in findings(flows, {}, circuit) if one.quantity == "CO"]
    assert "through the pulmonary artery before the ECMO drains it; the left ventricle" in sentence


CAUTIONS = {
    "levosimendan in an empty heart": ({"PCWP": 6.0}, {"drugs.levosimendan": 0.1}, "levosimendan: fitted to"),
    "vasopressin without sepsis": (
        SEPTIC | {"MAP": 105.0, "CO": 4.0}, {"drugs.vasopressin": 0.03}, "644 dyn s",
    ),
    "vasopressin in sepsis on V-A ECMO": (
        SEPTIC | {"CO": 1.7, "systemic_flow": 6.7}, {"drugs.vasopressin": 0.03}, "",
    ),
    "the same in a patient with regions": (
        SEPTIC | {"CO": 1.7, "upper_body_flow": 2.3, "lower_body_flow": 4.4}, {"drugs.vasopressin": 0.03}, "",
    ),
    "vasopressin in sepsis": (SEPTIC, {"drugs.vasopressin": 0.03}, ""),
    "felt as much more": (
        {}, {"drugs.noradrenaline": 1.0, "drugs.noradrenaline_sensitivity": 40.0},
        "dose times sensitivity is 40 ug/kg/min",
    ),
    "usual dose": ({}, {"drugs.noradrenaline": 1.0, "drugs.noradrenaline_sensitivity": 1.0}, ""),
    "three at usual doses": (
        {}, {"drugs.noradrenaline": 1.0, "drugs.adrenaline": 0.15, "drugs.vasopressin": 0.04},
        "noradrenaline, adrenaline, vasopressin together (contractility x 5.",
    ),
    "vasopressin on noradrenaline": (
        {}, {"drugs.noradrenaline": 0.3, "drugs.vasopressin": 0.03},
        "vasopressin on noradrenaline: their factors",
    ),
    "two that add a quarter": (
        {}, {"drugs.noradrenaline": 0.3, "drugs.adrenaline": 0.1}, "no combination was fitted",
    ),
    "adrenaline that would constrict": ({}, {"drugs.adrenaline": 0.3}, "larger doses constrict in patients"),
    "adrenaline as fitted": ({}, {"drugs.adrenaline": 0.15}, ""),
    "hypoxia without an answer": ({"SaO2": 60.0, "PaCO2": 40.0}, {}, "responds to these blood gases"),
    "hypoxia with a reflex": ({"SaO2": 60.0}, {"regulation.chemoreflex": 1.0}, ""),
    "two small doses": ({}, {"drugs.noradrenaline": 0.02, "drugs.vasopressin": 0.03}, ""),
    "two that pull apart": ({}, {"drugs.vasopressin": 0.04, "drugs.nitroprusside": 1.0}, ""),
    "hypercapnia with nerves": (
        {"PaCO2": 60.0}, {"regulation.set_point_paco2_mmHg": 40.0, "regulation.chemoreflex": 1.0},
        "20 above the set point: with the chemoreflex",
    ),
    "hypercapnia with organs": (
        {"PaCO2": 60.0}, {"regulation.set_point_paco2_mmHg": 40.0, "regulation.hypoxic_vasodilation": 1.0},
        "published for small changes",
    ),
    "hypercapnia with the measured answer": (
        {"PaCO2": 60.0},
        {"regulation.set_point_paco2_mmHg": 40.0, "regulation.chemoreflex": 1.0,
         "regulation.carbon_dioxide_response": 1.0}, "mean arterial pressure falls (9 % for 19 mmHg)",
    ),
    "half of the measured answer": (
        {"PaCO2": 55.0, "MAP": 60.0},
        {"regulation.set_point_paco2_mmHg": 40.0, "regulation.carbon_dioxide_response": 0.5},
        "probably too low",
    ),
    "beyond the measured answer": (
        {"PaCO2": 70.0},
        {"regulation.set_point_paco2_mmHg": 40.0, "regulation.carbon_dioxide_response": 1.0}, "extrapolated",
    ),
    "hypocapnia with nerves": (
        {"PaCO2": 44.5}, {"regulation.set_point_paco2_mmHg": 103.0, "regulation.chemoreflex": 1.0},
        "58 below the set point: with the chemoreflex, resistance and arterial pressure fall",
    ),
    "hypocapnia with organs": (
        {"PaCO2": 25.0}, {"regulation.set_point_paco2_mmHg": 40.0, "regulation.hypoxic_vasodilation": 1.0},
        "published for small changes",
    ),
    "hypocapnia with the measured answer": (
        {"PaCO2": 44.0, "CO": 4.3},
        {"regulation.set_point_paco2_mmHg": 103.0, "regulation.carbon_dioxide_response": 1.0},
        "extrapolated below it",
    ),
    "hypocapnia without an answer": ({"PaCO2": 31.0}, {"regulation.set_point_paco2_mmHg": 45.0}, ""),
    "little less than at rest": (
        {"PaCO2": 36.0}, {"regulation.set_point_paco2_mmHg": 45.0, "regulation.chemoreflex": 1.0}, "",
    ),
    "little more than at rest": (
        {"PaCO2": 48.0}, {"regulation.set_point_paco2_mmHg": 40.0, "regulation.chemoreflex": 1.0}, "",
    ),
    "blood of no law": ({"pHa": 7.88}, {}, "pH 7.88 of the arterial blood is outside 6.8 to 7.7"),
    "blood of hardly any law": ({"pHa": 6.797}, {}, "pH 6.797 of the arterial blood is outside 6.8"),
    "cold blood": (
        {"PaCO2": 38.0}, {"gas.temperature_c": 33.0}, "PCO2 of 45.3 in place of 38.0 mmHg, and a higher PO2",
    ),
    "hot blood": (
        {"PaCO2": 42.0, "pHa": 7.38}, {"gas.temperature_c": 39.5},
        "PCO2 of 37.6 in place of 42.0 mmHg, a pH of 7.42 in place of 7.38, and a lower PO2",
    ),
    "slow heart": ({"CO": 2.4, "heart_rate": 25.0}, {"heart_rate_bpm": 60.0}, "lasts 1.1 s, a patient's"),
    "fast heart": ({"CO": 8.7}, {"heart_rate_bpm": 180.0}, "a patient's fills less the faster it beats"),
    "fast heart for the age": (
        {"CO": 6.0}, {"heart_rate_bpm": 148.0, "patient.age_years": 90.0}, "fills less the faster it beats",
    ),
    "heart at rest": ({"CO": 5.0}, {"heart_rate_bpm": 95.0, "patient.age_years": 60.0}, ""),
    "warm blood": ({"PaCO2": 38.0}, {"gas.temperature_c": 38.0}, ""),
    "hypercapnia without an answer": ({"PaCO2": 60.0}, {"regulation.set_point_paco2_mmHg": 40.0}, ""),
}  # fmt: skip


@pytest.mark.parametrize(("outputs", "values", "said"), CAUTIONS.values(), ids=CAUTIONS)
def test_what_drugs_and_reflexes_do_beyond_their_measurements_is_a_caution(outputs, values, said):
    found = [one for one in findings(outputs, {}, None, values) if one.kind == "caution"]
    assert [said in one.sentence for one in found] == ([True] if said else [])
    assert all(one.concerns for one in found), "else it is said nowhere"


@pytest.mark.parametrize(
    ("pericardial", "right", "left", "named"),
    [
        (5.7, 8.9, 9.7, True),
        (15.0, 16.0, 17.0, True),
        (2.9, 5.0, 6.0, False),  # hardly above the usual pressure
        (3.5, 9.0, 10.0, False),  # a full right atrium
        (5.7, 8.9, 13.5, False),  # a failing left heart
        (-2.0, 1.0, 2.0, False),
    ],
)
def test_a_pericardium_that_constrains_filling_is_named(pericardial, right, left, named):
    outputs = {
        "pericardial_pressure": pericardial,
        "right_atrial_pressure": right,
        "PCWP": left,
        "CVP": right,
    }
    found = [one for one in cautions(outputs, {}) if one.quantity == "pericardial_pressure"]
    assert bool(found) == named
    for one in found:
        assert one.kind == "caution"
        assert {"CVP", "PCWP"} <= set(one.concerns)
    del outputs["pericardial_pressure"]
    assert not [one for one in cautions(outputs, {}) if one.quantity == "pericardial_pressure"]


def test_an_lvad_that_empties_the_left_ventricle_is_warned_of():
    circuit = circulation() + lvad()
    filled = {"ejection_fraction_lv": 23.0, "ESVLV": 130.0, "end_diastolic_pressure_lv": 13.5}
    empty = {"ejection_fraction_lv": 71.0, "ESVLV": 18.0, "end_diastolic_pressure_lv": 2.9}
    assert not any("suction" in sentence for _, sentence in said(filled, circuit))
    (found,) = (f for f in findings(empty, {}, circuit) if "suction" in f.sentence)
    assert found.kind == "warning"
    assert "empties the left ventricle to 18 mL (end-diastolic pressure 2.9 mmHg): suction is likely" in (
        found.sentence
    )
    assert "lvad_flow" in found.concerns
    assert not any("suction" in sentence for _, sentence in said(empty, circulation() + lvad("la")))


def test_an_ejection_fraction_is_read_with_care_where_a_vent_or_ecmo_drains_the_ventricle():
    outputs = {"ejection_fraction_lv": 18.0, "LVO": 0.0, "vent_flow": 3.9}
    vent = VENT.circuit(Vent(site="lv", fr=23))
    drained = {"vent": circulation() + ecmo("ra", "ao") + vent, "ECMO": circulation() + ecmo("lv", "ao")}
    for name, circuit in drained.items():
        said = [f for f in findings(outputs, {}, circuit) if f.quantity == "ejection_fraction_lv"]
        assert [f.kind for f in said] == ["caution"]
        assert said[0].sentence.lower().startswith(f"the {name} empties the left ventricle".lower())
    beside = circulation() + ecmo("ra", "ao") + VENT.circuit(Vent(site="la", fr=15))
    assert not [f for f in findings(outputs, {}, beside) if f.quantity == "ejection_fraction_lv"]


def test_a_right_ventricle_that_a_pump_empties_is_warned_of():
    circuit = circulation() + lvad("rv", "pas")
    empty = {"ejection_fraction_rv": 80.0, "ESVRV": 12.0, "end_diastolic_pressure_rv": 1.0}
    found = findings(empty, {}, circuit)
    assert [(one.kind, one.quantity) for one in found] == [
        ("warning", "ESVRV"),
        ("caution", "ejection_fraction_rv"),
    ]
    assert "empties the right ventricle to 12 mL (end-diastolic pressure 1.0 mmHg): suction" in (
        found[0].sentence
    )
    assert "do not describe ejection through the pulmonary valve" in found[1].sentence
    (only,) = findings(empty | {"ESVRV": 45.0}, {}, circuit)
    assert only.kind == "caution"
    names = ("right_atrial_pressure", "caval_filling", "EDVRV")
    sucked = findings(empty | dict(zip(names, (-33.0, 60.0, 13.0), strict=True)), {}, circuit)
    suction = next(one for one in sucked if one.quantity == "ESVRV")
    assert "(right atrial pressure -33.0 mmHg)" in suction.sentence
    assert {"right_atrial_pressure", "EDVRV"} <= set(suction.concerns)


def test_a_pump_that_lets_blood_back_is_not_said_to_empty_the_ventricle():
    outputs = {"ejection_fraction_lv": 31.0, "lvad_flow": -2.7}
    (caution,) = (one for one in findings(outputs, {}, circulation() + lvad()) if one.kind == "caution")
    assert "the LVAD lets blood back into the left ventricle" in caution.sentence


def test_a_collapse_beside_crrt_names_the_pump_that_takes_the_blood_away():
    beside = circulation() + crrt("svn", "ra") + lvad("rv", "pas")
    places = {"Vra": (-2.6, 10.0), "Vrv": (-34.0, 9.0), "Psvn": (-400.0, 5.0)}
    for found in findings({}, places, beside):
        assert "the LVAD drains more than flows in" in found.sentence
    drained = circulation() + crrt("svn", "ra") + ecmo("svn", "ra", return_cannula="venous")
    (vein,) = findings({}, {"Psvn": (-400.0, 5.0)}, drained)
    assert "the ECMO drains more than flows in" in vein.sentence
    (alone,) = findings({}, {"Psvn": (-400.0, 5.0)}, circulation() + crrt("svn", "ra"))
    assert "the CRRT drains more than flows in" in alone.sentence


def test_an_assumed_membrane_is_said_until_the_case_has_its_own():
    circuit, names = circulation() + crrt("ra", "svn"), ("transmembrane_pressure", "MAP")
    assumed = {one.parameter: one.value for one in CRRT.assumptions}
    said = assumptions(names, circuit, assumed)
    assert [one.concerns for one in said] == [("transmembrane_pressure",)]
    assert said[0].kind == "caution"
    own = {key: 1.2 * value for key, value in assumed.items()}
    assert assumptions(names, circuit, own) == []
    assert assumptions(("MAP",), circuit, assumed) == []


def test_volumes_of_chambers_and_pressures_of_thin_walls_are_watched():
    signals = ("Vlv", "Plv", "Vao", "Pao", "Psvn", "Psart", "Qlv", "Vecmooxy", "Pecmooxy", "Pra")
    assert set(watched_signals(signals)) == {"Vlv", "Plv", "Psvn", "Pra"}


def test_flows_that_hardly_differ_are_one_output():
    outputs = {"CO": 4.0, "pulmonary_flow": 4.0, "pulmonary_valve_flow": 4.0}
    assert findings(outputs | {"LVO": 3.71}, {}) == []
    (apart,) = findings(outputs | {"LVO": 3.69}, {})
    assert "ejects 3.69 L/min" in apart.sentence


@pytest.mark.parametrize(("value", "said"), [(29.972, "29.97"), (28.6, "28.6"), (29.9999999, "30.000000")])
def test_a_value_is_told_apart_from_the_limit_that_it_breaks(value, said):
    """A PCO2 of 29.97 mmHg was said to be 30.0 mmHg and below 30 mmHg."""
    limit = Limit("PaCO2", "alarm", "below", 30.0, "brain", "source")
    assert breach(limit, value, "PCO2", "mmHg").sentence.startswith(f"PCO2 {said} mmHg is below 30 mmHg: ")


@pytest.mark.parametrize("regional", [False, True])
def test_veins_that_give_blood_below_zero_pressure_are_said(regional):
    """With soft veins and a reflex V-A ECMO held flow and pressure through a loss of 2 L, without a word."""
    patient = {"id": "x", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}
    cannulae = {"mode": "VA"} | ({"return_site": "lower"} if regional else {})
    ecmo = {"pump": "Rotaflow", "oxygenator": "Quadrox-i Adult", "speed_rpm": 3500, **cannulae}
    raw = {
        "format": 1, "patient": patient, "ecmo": ecmo, "parameters": {"Csvn": 95, "P0svn": 7, "Emaxlv": 0.6},
        "physiology": {"collapsible_veins": True, "regional": regional},
        "regulation": {"model": "heldt2010", "baroreflex": 1.0},
    }  # fmt: skip
    usual, bled = (
        simulate(read_mapping({**raw, "fluid": {"extra_volume_ml": ml}}).case).attrs["warnings"]
        for ml in (0.0, -2000.0)
    )
    assert not any("veins behind the vena cava" in sentence for sentence in usual)
    assert any("veins behind the vena cava" in sentence for sentence in bled)
