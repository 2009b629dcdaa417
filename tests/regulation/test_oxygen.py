"""Chemoreflex and organs: curves against the closed forms, signs, rest, regions."""

import math

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.circuit.network import HEART_RATE
from eclsim.orbit.model import model_of
from eclsim.parameters.regulation import (
    CARBON_DIOXIDE,
    CHEMOREFLEX,
    PARAMETERS,
    SENSED_PACO2,
    SENSED_PAO2,
    SET_POINT,
)
from eclsim.regulation.oxygen import (
    ORGANS,
    OUTFLOWS,
    Chemoreflex,
    Gases,
    chemoreceptor_firing,
    gas_drives,
    local_factor,
    local_law,
    measured_factor,
    organ_conductance,
    sympathetic_input,
)
from eclsim.regulation.ursino1998 import URSINO_1998

NORMAL = Gases(95.0, 40.0)
PATIENT = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}
LUNGS = {"haemoglobin_g_dl": 12, "fio2": 0.21, "alveolar_ventilation_l_min": 5, "shunt_fraction": 0.05}


@pytest.mark.parametrize(("po2", "pco2"), [(95.0, 40.0), (60.0, 45.0), (39.0, 30.0), (30.0, 55.0)])
def test_chemoreceptors_fire_as_printed(po2, pco2):
    rise = math.exp((po2 - 45.0) / 29.27)
    gain = 3.0 if po2 > 80.0 else 3.0 - 1.2 * (po2 - 80.0) / 30.0 if po2 > 40.0 else 4.6
    expected = (12.3 + 0.835 * rise) / (1.0 + rise) * (gain * math.log(pco2 / 40.0) + 1.4)
    assert float(chemoreceptor_firing(Gases(po2, pco2))) == pytest.approx(expected, rel=1e-6)


def test_they_fire_3_6_times_a_second_in_normal_blood():
    assert float(chemoreceptor_firing(NORMAL)) == pytest.approx(3.63, abs=0.01)


def test_sympathetic_drive_is_the_closed_form():
    now = Gases(50.0, 44.0)
    drives = gas_drives(-5.0, 1.0, now, NORMAL)
    carotid = (2.52 + 47.78 * math.exp(-5.0 / 11.758)) / (1.0 + math.exp(-5.0 / 11.758))
    more = 1.716 * float(chemoreceptor_firing(now) - chemoreceptor_firing(NORMAL)) + 1.5 * 4.0
    more += 6.0 / (1.0 + math.exp(20.0 / 2.0)) - 6.0 / (1.0 + math.exp(65.0 / 2.0))
    firing = [2.10 + 14.01 * math.exp(0.0675 * (-carotid + x)) for x in (0.0, more)]
    expected = math.log(firing[1] - 1.66) - math.log(firing[0] - 1.66)
    assert float(drives[1]) == pytest.approx(expected, rel=1e-6)
    assert float(drives[4]) == pytest.approx(
        0.2 * float(chemoreceptor_firing(now) - chemoreceptor_firing(NORMAL)), rel=1e-9
    )


def test_nothing_happens_at_the_set_point_and_nerves_saturate():
    assert not any(float(drive) for drive in gas_drives(7.0, 1.0, NORMAL, NORMAL))
    worst = gas_drives(0.0, 1.0, Gases(20.0, 100.0), NORMAL)
    limit = math.log(60.0 - 1.66) - math.log(4.669 - 1.66)
    assert [float(d) for d in worst[:4]] == pytest.approx([limit] * 4, abs=0.01)


def test_hypoxia_constricts_and_speeds_the_heart_hypercapnia_constricts():
    def factors(gases):
        drives = gas_drives(0.0, 1.0, gases, NORMAL)
        return dict(zip(URSINO_1998.acts_on, map(float, URSINO_1998.effects(drives, 5300.0)), strict=True))

    hypoxia, hypercapnia = factors(Gases(40.0, 40.0)), factors(Gases(95.0, 55.0))
    assert hypoxia["Rmc"] > 1.05
    assert hypoxia[HEART_RATE] > 1.1
    assert hypoxia["unstressed_volume_ml"] < -50.0
    assert hypercapnia["Rmc"] > 1.05
    assert hypercapnia["Emaxlv"] > 1.0
    # Without the brain's hypoxia chemoreceptors alone slow the heart.
    assert factors(Gases(65.0, 40.0))[HEART_RATE] < 1.0
    assert all(float(sympathetic_input(o, Gases(40.0, 40.0))) > 0.0 for o in OUTFLOWS)


def test_organs_dilate_as_printed():
    rest, content, pco2 = (15.0, 40.0), 11.0, 48.0
    brain, heart, muscle = (float(organ_conductance(o, content, pco2, rest)) for o in ORGANS)
    reivich = [20.9 + 92.8 / (1.0 + 10570.0 * math.exp(-5.251 * math.log10(p))) for p in (48.0, 40.0)]
    assert brain == pytest.approx(1.0 + 10.0 * 0.04 + reivich[0] / reivich[1] - 1.0, rel=1e-6)

    def carbon_dioxide(scale):
        return (1.0 - math.exp(8.0 / scale)) / (1.0 + math.exp(8.0 / scale))

    assert heart == pytest.approx((1.0 + 35.0 * 0.04) / (1.0 + carbon_dioxide(11.11)), rel=1e-6)
    assert muscle == pytest.approx((1.0 + 30.0 * 0.04) / (1.0 + carbon_dioxide(142.8)), rel=1e-6)
    shares = [o.share for o in ORGANS]
    assert shares == pytest.approx([0.146, 0.049, 0.214], abs=1e-3)
    total = 1.0 + sum(s * (c - 1.0) for s, c in zip(shares, (brain, heart, muscle), strict=True))
    assert float(local_factor(content, pco2, rest, 1.0)) == pytest.approx(1.0 / total, rel=1e-6)
    assert float(local_factor(content, pco2, rest, 0.0)) == 1.0
    assert float(local_factor(15.0, 40.0, rest, 1.0)) == 1.0


def test_the_hearts_vessels_open_no_further_than_their_reserve():
    """The published law multiplied the flow through the heart by 114 at a PCO2 of 100 mmHg."""
    heart = ORGANS[1]
    opened = [float(organ_conductance(heart, 10.0, pco2, (10.0, 40.0))) for pco2 in (45.0, 60.0, 100.0)]
    assert opened[0] == pytest.approx(1.0 / (1.0 - math.tanh(2.5 / 11.11)), rel=1e-6)
    assert opened[1] < opened[2] == 5.0
    factor = float(local_factor(10.0, 100.0, (10.0, 40.0), 1.0))
    assert 1.0 / factor < 1.7


def test_the_measured_answer_to_carbon_dioxide_is_its_closed_form_and_ends():
    expected = math.exp(-0.022 * 40.0 * math.tanh(19.0 / 40.0))
    assert float(measured_factor(59.0, 40.0, 1.0)) == pytest.approx(expected, rel=1e-12)
    assert float(measured_factor(59.0, 40.0, 0.5)) == pytest.approx(math.sqrt(expected), rel=1e-12)
    assert float(measured_factor(40.0, 40.0, 1.0)) == 1.0 < float(measured_factor(30.0, 40.0, 1.0))
    assert float(measured_factor(300.0, 40.0, 1.0)) == pytest.approx(math.exp(-0.88), rel=1e-3)


def test_published_answers_to_carbon_dioxide_give_way_to_the_measured_one_and_those_to_oxygen_stay():
    contents = [18.0, 1000.0, -350.0]  # arterial content, supply, uptake: 11.7 mL/dL leave
    rest = [1.0, 14.0, 40.0]  # strength, both set points
    whole = [float(local_law(np.array([*contents, pco2, *rest, 1.0]))[0]) for pco2 in (40.0, 55.0)]
    assert whole[0] < 1.0
    assert whole[1] / whole[0] == pytest.approx(float(measured_factor(55.0, 40.0, 1.0)), rel=1e-12)
    published = float(local_law(np.array([*contents, 55.0, *rest, 0.0]))[0])
    assert published == pytest.approx(float(local_factor(11.7, 55.0, (14.0, 40.0), 1.0)), rel=1e-12)

    law = Chemoreflex(URSINO_1998)
    values = {key: one.value for key, one in PARAMETERS.items()} | {"total_blood_volume_ml": 5000.0}
    values |= {CHEMOREFLEX: 1.0, SENSED_PAO2: 95.0, SENSED_PACO2: 60.0, SET_POINT: 90.0}

    def drives(response):
        return list(map(float, law.steady_states([90.0], law.constants(values | {CARBON_DIOXIDE: response}))))

    assert drives(1.0) == [0.0] * 5
    assert 0.0 < drives(0.5)[1] < drives(0.0)[1]


def model(gas=LUNGS, **keys):
    case = {"format": 1, "patient": PATIENT, "regulation": keys} | ({"gas": gas} if gas else {})
    return model_of(read_mapping(case).case)


def test_a_case_without_gases_says_that_nothing_answers_and_keeps_its_circuit():
    keys = {"hypoxic_vasodilation": 1}
    reading = read_mapping({"format": 1, "patient": PATIENT, "regulation": keys})
    assert any("add a section [gas]" in str(w) for w in reading.warnings)
    assert model(gas=None, **keys).circuit == model(gas=None).circuit


@pytest.mark.slow
def test_set_points_are_those_of_the_patient_or_the_ones_given():
    own = model(chemoreflex=1, hypoxic_vasodilation=1, hypoxic_vasoconstriction=1).values
    assert own["regulation.set_point_pao2_mmHg"] == pytest.approx(90.6, abs=0.5)
    assert 8.0 < own["regulation.set_point_venous_o2_ml_dl"] < 15.0
    assert 1.0 < own["regulation.hypoxic_resistance_at_rest"] < 2.0
    given = model(chemoreflex=1, hypoxic_vasodilation=1, set_point_pao2_mmHg=95, set_point_venous_o2_ml_dl=15)
    assert given.values["regulation.set_point_pao2_mmHg"] == 95.0
    assert given.values["regulation.lower_set_point_venous_o2_ml_dl"] == 15.0
    assert given.values["regulation.baroreflex"] == 0.0
