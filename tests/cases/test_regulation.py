"""The sections [regulation], [fluid] and [solutes]: what they take, refuse and pass on, and what rest is."""

import re

import pytest

import eclsim
from eclsim.beat.heartbeat import BeatProgram
from eclsim.cases import CaseError, read_case
from eclsim.cases.reading import read_mapping, write_case
from eclsim.cases.resolve import circuit_of
from eclsim.devices.dialysed_blood import CARBON_DIOXIDE_FROM_GASES, HAEMATOCRIT_OF_PATIENT
from eclsim.orbit import rest
from eclsim.orbit.model import model_of, values_of
from eclsim.parameters.regulation import (
    EXTRA_VOLUME,
    GAIN,
    PAO2_SET_POINT,
    SET_POINT,
    UNSTRESSED,
    VENOUS_SET_POINT,
)

PATIENT = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}

CRRT = {"flow_ml_min": 200, "access_site": "svn", "return_site": "ra", "net_ultrafiltration_ml_h": 100}


def read(**sections):
    return read_mapping({"format": 1, "patient": PATIENT} | sections)


@pytest.mark.parametrize(
    ("section", "values", "line"),
    [
        ("regulation", {"baroreflex": -1},
         "regulation.baroreflex = -1: outside the allowed range; allowed: 0 to 1.2: 1 is the published "
         "reflex, less is sedation, 0 is off"),
        ("regulation", {"baroreflex": 1, "model": "urisno1998"},
         'regulation.model = "urisno1998": unknown name; allowed: ursino1998, heldt2004, heldt2010; did you '
         "mean ursino1998?"),
        ("regulation", {"baroreflex": 1, "set_point_mmHg": 12},
         "regulation.set_point_mmHg = 12: outside the allowed range; allowed: 20 to 160 mmHg; did you mean "
         "12 kPa = 90.01 mmHg?"),
        ("regulation", {"baroreflex": 1, "set_point": 90},
         "regulation.set_point = 90: unknown key; allowed: baroreflex, model, set_point_mmHg, "
         "venous_set_point_mmHg, heart_rate_response, hypoxic_vasoconstriction, chemoreflex, "
         "hypoxic_vasodilation, carbon_dioxide_response, set_point_pao2_mmHg, set_point_paco2_mmHg, "
         "lower_set_point_paco2_mmHg, "
         "set_point_venous_o2_ml_dl, upper_set_point_venous_o2_ml_dl, lower_set_point_venous_o2_ml_dl, "
         "hypoxic_resistance_at_rest; did you mean set_point_mmHg or set_point_pao2_mmHg or "
         "set_point_paco2_mmHg?"),
        ("regulation", {"chemoreflex": 1, "model": "heldt2004"},
         "regulation.chemoreflex = 1: acts on the firing rate of nerves, which heldt2004 does not model; "
         'allowed: model = "ursino1998"'),
        ("regulation", {"hypoxic_vasodilation": 2},
         "regulation.hypoxic_vasodilation = 2: outside the allowed range; allowed: 0 to 1.5: 1 is as "
         "published; with [gas]"),
        ("fluid", {"extra_volume_ml": -5000},
         "fluid.extra_volume_ml = -5000: outside the allowed range; allowed: -3000 to 5000 mL"),
        ("fluid", {"extra_volume_l": 1},
         "fluid.extra_volume_l = 1: unknown key; allowed: extra_volume_ml, capillary_refill, haematocrit, "
         "reference_haematocrit, plasma_protein_g_dl, interstitial_protein_g_dl, interstitial_volume_ml, "
         "filtration_ml_min_mmHg, reflection, lymph_ml_min, lymph_pump, pericapillary_share, venular_tone; "
         "did you mean "
         "extra_volume_ml?"),
        ("fluid", {"haematocrit": 30},
         "fluid.haematocrit = 30: a percentage; a fraction belongs here; allowed: 0.05 to 0.7; did you "
         "mean 0.3?"),
        ("fluid", {"capillary_refill": "on"},
         'fluid.capillary_refill = "on": true or false belongs here, without quotes; allowed: true, false'),
        ("fluid", {"plasma_protein_g_dl": 60},
         "fluid.plasma_protein_g_dl = 60: outside the allowed range; allowed: 2 to 10 g/dL; did you mean "
         "60 g/L = 6 g/dL?"),
        ("fluid", {"plasma_protein_g_dl": 4, "interstitial_protein_g_dl": 4.5},
         "fluid.interstitial_protein_g_dl = 4.5: not below that of the plasma, 4 g/dL: nothing would hold "
         "water in the vessels; allowed: below 4 g/dL"),
        ("solutes", {"potassium_mmol_l": 45},
         "solutes.potassium_mmol_l = 45: outside the allowed range; allowed: 1.5 to 10 mmol/L"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_one_line(section, values, line):
    with pytest.raises(CaseError) as caught:
        read(**{section: values})
    assert [str(mistake) for mistake in caught.value.mistakes] == [line]


def test_settings_without_effect_are_said():
    (warning,) = read(regulation={"model": "heldt2004"}).warnings
    assert "nothing is regulated" in str(warning)
    (warning,) = read(regulation={"baroreflex": 1, "venous_set_point_mmHg": 5}).warnings
    assert "ursino1998 does not read right atrial pressure" in str(warning)


def test_without_the_sections_the_circuit_is_the_published_one():
    plain = circuit_of(read().case)
    assert not plain.controllers
    assert UNSTRESSED not in plain.parameter_names()
    assert circuit_of(read(regulation={"model": "heldt2004"}).case) == plain


def test_sections_become_tables_and_values():
    case = read(regulation={"baroreflex": 0.5, "set_point_mmHg": 80}, fluid={"extra_volume_ml": 250}).case
    model = model_of(case)
    assert [control.name for control in model.circuit.controllers] == ["regulation"]
    assert {GAIN: 0.5, SET_POINT: 80.0, EXTRA_VOLUME: 250.0}.items() <= model.values.items()
    assert EXTRA_VOLUME in model_of(read(parameters={UNSTRESSED: -100}).case).circuit.parameter_names()


def test_what_is_assumed_of_solutes_is_named_and_at_a_high_potassium_warned_of():
    """A day of dialysis against 4 mmol/L, which nobody had given, hardly lowered 6.8."""
    named = {str(one) for one in read(solutes={"potassium_mmol_l": 4.2}, crrt=CRRT).notes}
    assert any("left out, so 4 mmol/L are assumed in the fluids of a filter" in one for one in named)
    assert any("potassium_generation_mmol_h = 0, potassium_store_l = 150" in one for one in named)
    high = read(solutes={"potassium_mmol_l": 6.8}, crrt=CRRT)
    (warned,) = (str(one) for one in high.warnings if "fluid_potassium_mmol_l" in str(one))
    assert "lower 6.8 mmol/L slowly; write what the bags hold (often 0 to 2)" in warned
    given = read(solutes={"potassium_mmol_l": 6.8, "fluid_potassium_mmol_l": 4.0}, crrt=CRRT)
    assert not any("fluid_potassium" in str(one) for one in (*given.warnings, *given.notes))


def test_what_fluid_and_solutes_leave_out_follows_from_the_patient():
    values = values_of(read(fluid={}, solutes={}, gas={"haemoglobin_g_dl": 9.99}).case)
    assert values["fluid.haematocrit"] == values["fluid.reference_haematocrit"] == pytest.approx(0.3)
    assert values["fluid.interstitial_volume_ml"] == pytest.approx(
        2.587 * values["total_blood_volume_ml"], rel=1e-3
    )
    assert values["fluid.interstitial_protein_g_dl"] == pytest.approx(2.4)
    assert 40000 < values["solutes.body_water_ml"] < 48000
    given = read(fluid={"haematocrit": 0.4}, crrt=CRRT).case
    assert values_of(given)["fluid.haematocrit"] == 0.4
    assert values_of(given)["crrt.haematocrit_in"] == HAEMATOCRIT_OF_PATIENT
    acid = {"bicarbonate_mmol_l": 16}
    without_gas = values_of(read(solutes=acid, crrt=CRRT).case)
    assert without_gas["crrt.plasma_bicarbonate_mmol_l"] == pytest.approx(16 + 0.0307 * 40)
    start = values_of(read(solutes=acid, gas={}, crrt=CRRT).case)
    assert start["crrt.plasma_bicarbonate_mmol_l"] == CARBON_DIOXIDE_FROM_GASES
    assert -12 < start["gas.base_excess_mmol_l"] < -8
    excess = values_of(read(solutes={}, gas={"base_excess_mmol_l": start["gas.base_excess_mmol_l"]}).case)
    assert excess["solutes.bicarbonate_mmol_l"] == pytest.approx(16)
    given = read(fluid={}, crrt=CRRT | {"haematocrit_in": 0.2}).case
    assert values_of(given)["fluid.haematocrit"] == 0.2 == values_of(given)["crrt.haematocrit_in"]


def test_base_that_is_stated_twice_is_said_to_be():
    """A bicarbonate and a base excess are the same number in other words."""
    acid, plain = {"bicarbonate_mmol_l": 18}, {"haemoglobin_g_dl": 9}
    message = [str(note) for note in read(solutes=acid, gas=plain).notes]
    assert any("base_excess_mmol_l is set to -8.5, its equivalent" in note for note in message)
    assert not any("assumed" in note and "base_excess" in note for note in message)
    assert any("base_excess_mmol_l = 0" in str(note) for note in read(gas=plain).notes)
    agreeing, apart = (
        [str(w) for w in read(solutes=acid, gas=plain | {"base_excess_mmol_l": excess}).warnings]
        for excess in (-8.0, 2.0)
    )
    assert agreeing == []
    (warning,) = apart
    assert (
        "bicarbonate_mmol_l = 18: gas.base_excess_mmol_l = 2 corresponds to another bicarbonate, 26.1"
        in warning
    )
    assert "use the base excess" in warning
    assert "write base_excess_mmol_l = -8.5" in warning
    values = values_of(read(solutes=acid, gas=plain | {"base_excess_mmol_l": 2.0}).case)
    assert (values["gas.base_excess_mmol_l"], values["solutes.bicarbonate_mmol_l"]) == (2.0, 18.0)


def test_an_open_set_point_is_the_pressure_of_the_case_as_it_was_written(tmp_path):
    """So a patient who is at rest in the file answers to what is set over it."""
    file = tmp_path / "case.toml"
    write_case(read(regulation={"baroreflex": 1, "model": "heldt2004"}).case, file)
    own, failing = (values_of(read_case(file, s).case) for s in ((), ["parameters.Emaxlv=0.3"]))
    assert own[SET_POINT] == failing[SET_POINT]
    assert own[VENOUS_SET_POINT] == failing[VENOUS_SET_POINT]
    unregulated = read(parameters={"Emaxlv": 0.3}, regulation={"baroreflex": 1, "model": "heldt2004"}).case
    assert values_of(unregulated)[SET_POINT] < 0.5 * own[SET_POINT]
    bled = read_case(file, ["fluid.extra_volume_ml=-500"]).case
    assert values_of(bled)[SET_POINT] == own[SET_POINT]


@pytest.mark.slow
def test_a_set_point_that_rest_does_not_determine_is_asked_for(tmp_path):
    """Valves that stay shut at rest leave the pressure open; a recovered heart was regulated to it unsaid."""
    ecmo = {"pump": "Rotaflow", "speed_rpm": 4200, "oxygenator": "Quadrox-i Adult", "mode": "VA"}
    file = tmp_path / "case.toml"
    stunned = {"Emaxlv": 0.06, "Emaxrv": 0.05}
    write_case(read(ecmo=ecmo, parameters=stunned, regulation={"baroreflex": 1}).case, file)
    recovered = ["Emaxlv=1.5", "Emaxrv=0.5"]
    asked = eclsim.simulate(read_case(file, recovered))
    assert asked.attrs["status"] == "invalid_input"
    assert "regulation.set_point_mmHg: the case at rest does not determine it" in asked.attrs["message"]
    given = eclsim.simulate(read_case(file, [*recovered, "regulation.set_point_mmHg=80"]))
    assert given.attrs["status"] == "converged"


def test_what_reflexes_read_at_rest_asks_for_no_program_but_that_of_the_search(monkeypatch):
    def compiled_for_it(program, signals):
        raise AssertionError(f"a program that records {signals} alone")

    monkeypatch.setattr(BeatProgram, "trace", compiled_for_it)
    rest._means.cache_clear()
    at_rest = model_of(read(regulation={"baroreflex": 1}).case).values
    assert at_rest[SET_POINT] > 60.0


def test_gases_at_rest_of_a_case_written_without_gas_are_those_of_the_section_it_was_given(tmp_path):
    """`--set gas.fio2=0.5 --set regulation.chemoreflex=1` ended with an IndexError."""
    file = tmp_path / "patient.toml"
    write_case(read().case, file)
    changed = read_case(file, ["gas.fio2=0.5", "regulation.chemoreflex=1"]).case
    assert 20.0 < model_of(changed).values[PAO2_SET_POINT] < 600.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0.2 mg/kg/min", "in mg/kg/min, but noradrenaline is in ug/kg/min: 0.2 mg/kg/min = 200 ug/kg/min;"),
        ("5 ml/h", "in mL/h, but noradrenaline is in ug/kg/min; allowed: 0 to 3 ug"),
        ("0.3 mg/h", "in mg/h, but noradrenaline is in ug/kg/min; allowed: 0 to 3 ug"),
        ("6 mcg/kg/h", "did you mean 6 ug/kg/h = 0.1 ug/kg/min"),
        ("0.2 gamma", "did you mean 0.2"),
        ("0.2 mg/kg/Tag", "allowed: 0 to 3 ug"),
        ("0.2 µg/kg/min", "did you mean 0.2"),
        ("0.2 mcg/kg/min", "did you mean 0.2"),
    ],
)
def test_a_dose_in_another_unit_is_not_offered_as_a_number_of_this_one(text, message):
    """For 0.2 mg/kg/min, 0.2 ug/kg/min was offered, a thousandth of it."""
    with pytest.raises(CaseError, match=message) as caught:
        read(drugs={"noradrenaline": text})
    assert ("did you mean" in str(caught.value)) == ("mean" in message)


MEASURED = {"SP": 110, "DP": 60, "CO": 5}


def remarks_about_rate(reading):
    return [
        [one for one in remarks if one.key == "patient.heart_rate_bpm" and "before the drugs" in one.message]
        for remarks in (reading.warnings, reading.notes)
    ]


def test_a_heart_rate_measured_on_drugs_is_said_to_be_raised_again_and_what_to_write_instead():
    drugs = {"adrenaline": 0.1, "dobutamine": 5, "dobutamine_sensitivity": 2}
    (warning,), notes = remarks_about_rate(read(drugs=drugs, measurements=MEASURED))
    raised, instead = re.search(r"has ([\d.]+) bpm.*write ([\d.]+) instead", warning.message).groups()
    reading = read(drugs=drugs)
    assert not notes
    assert warning.value == "75"
    assert float(raised) == pytest.approx(float(eclsim.simulate(reading.case)["heart_rate"]), abs=0.05)
    lowered = reading.case.model_copy(
        update={"patient": reading.case.patient.model_copy(update={"heart_rate_bpm": float(instead)})}
    )
    assert float(eclsim.simulate(lowered)["heart_rate"]) == pytest.approx(75.0, abs=0.1)


def test_a_heart_rate_that_drugs_will_raise_is_a_note_without_measurements():
    warnings, notes = remarks_about_rate(read(drugs={"adrenaline": 0.1}))
    assert (len(warnings), len(notes)) == (0, 1)


def test_half_a_heart_rate_response_halves_the_rise_that_is_said():
    whole, half = (
        read(drugs={"adrenaline": 0.1}, regulation={"heart_rate_response": share}) for share in (1, 0.5)
    )
    rises = [
        float(re.search(r"has ([\d.]+) bpm", remarks_about_rate(r)[1][0].message)[1]) - 75.0
        for r in (whole, half)
    ]
    assert rises[1] == pytest.approx(0.5 * rises[0], abs=0.1)


@pytest.mark.parametrize(
    "sections",
    [
        {"drugs": {"adrenaline": 0.1}, "regulation": {"heart_rate_response": 0}},
        {"drugs": {"milrinone": 0.5, "vasopressin": 0.03}},
        {"drugs": {"adrenaline": 0}},
        {"drugs": {"adrenaline_sensitivity": 2}},
        {},
    ],
)
def test_nothing_is_said_of_a_heart_rate_that_no_drug_changes(sections):
    assert remarks_about_rate(read(**sections, measurements=MEASURED)) == [[], []]
