"""Drugs: dose to effect, several at once, with and without reflex, exact derivatives; what a case takes."""

import math
from dataclasses import replace

import jax
import numpy as np
import pytest

from eclsim.cases import CaseError
from eclsim.cases.reading import read_mapping
from eclsim.circuit.network import HEART_RATE
from eclsim.drugs.law import ACTS_ON
from eclsim.drugs.published import PUBLISHED
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.cautions import cautions
from eclsim.outputs.results import derivatives
from eclsim.outputs.steady_beat import steady_beat
from eclsim.parameters.regulation import DRUG_DOSES, DRUGS, UNSTRESSED, dose, sensitivity

ACCURATE = OrbitOptions(tolerance=1e-11, error_tolerance=1e-10)
PATIENT = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}
REFLEX = {"baroreflex": 1.0, "set_point_mmHg": 66.0}
OUTPUTS = ("MAP", "CO", "EDVLV", "PCWP", "heart_rate")


def read(**sections):
    return read_mapping({"format": 1, "patient": PATIENT} | sections)


def model(**sections):
    return model_of(read(**sections).case)


def beat(patient, names=OUTPUTS):
    return steady_beat(Batch.of(patient), names, options=ACCURATE)


def test_without_a_dose_nothing_changes():
    """The circuit with drugs is another program, which the compiler of JAX 0.12 rounds differently."""
    plain, offered, given = (
        steady_beat(Batch.of(model(**s))) for s in ({}, {"drugs": {}}, {"drugs": {"dobutamine": 0.0}})
    )
    for result in (offered, given):
        for name in plain.names:
            np.testing.assert_allclose(plain.output(name), result.output(name), rtol=1e-12)
    assert plain.batch.circuit == model().circuit
    assert not model().circuit.controllers


def test_effects_are_the_curves_and_multiply():
    """What is in effect during the beat against the equations written out."""
    doses = {"noradrenaline": 0.2, "milrinone": 0.4, "dobutamine": 5.0}
    patient = model(drugs=doses | {"milrinone_sensitivity": 2.0})
    felt = {"noradrenaline": 0.2, "milrinone": 0.8, "dobutamine": 5.0}
    total = np.zeros(5)
    for name, amount in felt.items():
        drug = PUBLISHED[name]
        part = amount**drug.steepness / (amount**drug.steepness + drug.half_dose**drug.steepness)
        total += part * np.array(drug.at_most)
    acted = beat(patient).values_in_effect()
    heart, systemic, pulmonary, rate = np.exp(total[:4])
    expected = dict(zip(ACTS_ON, (heart, heart, systemic, pulmonary, rate), strict=False))
    for name, factor in expected.items():
        assert float(acted[name]) == pytest.approx(patient.values[name] * factor, rel=1e-12), name
    shift = total[4] * patient.values["total_blood_volume_ml"]
    assert float(acted[UNSTRESSED]) == pytest.approx(shift, rel=1e-12)


def test_drug_and_reflex_act_in_either_order():
    patient = model(drugs={"noradrenaline": 0.2, "nitroprusside": 1.0}, regulation=REFLEX)
    first, second = patient.circuit.controllers
    assert {first.name, second.name} == {"regulation", DRUGS}
    other = replace(patient, circuit=replace(patient.circuit, controllers=(second, first)))
    np.testing.assert_allclose(beat(other).values, beat(patient).values, rtol=1e-9)


def test_the_reflex_answers_to_a_drug():
    """Noradrenaline raises pressure, so the reflex slows the heart and takes back part of it."""
    without, withs = (
        [beat(model(drugs={"noradrenaline": d}, **more)).outputs() for d in (0.0, 0.3)]
        for more in ({}, {"regulation": REFLEX})
    )
    rise, regulated = (after["MAP"] - before["MAP"] for before, after in (without, withs))
    assert 0.0 < regulated < 0.9 * rise
    assert withs[1]["heart_rate"] < withs[0]["heart_rate"] - 2.0


@pytest.mark.slow
def test_derivatives_match_central_differences():
    patient = model(drugs={"noradrenaline": 0.2, "dobutamine": 4.0}, regulation=REFLEX)
    parameters = (dose("noradrenaline"), sensitivity("noradrenaline"), dose("dobutamine"), dose("milrinone"))
    exact = derivatives(patient, OUTPUTS, parameters)
    for name in parameters:
        own, step = patient.values[name], 1e-4 * max(patient.values[name], 0.5)
        shifts = (step, -step) if own else (step, 0.0)
        high, low = (beat(patient.with_values({name: own + s})).values[: len(OUTPUTS), 0] for s in shifts)
        numeric = (high - low) / (shifts[0] - shifts[1])
        np.testing.assert_allclose(exact.sel(parameter=name), numeric, rtol=2e-3, atol=1e-6, err_msg=name)


def test_a_sensitive_patient_needs_less():
    usual, sensitive = (
        beat(model(drugs=d)).values
        for d in ({"noradrenaline": 0.2}, {"noradrenaline": 0.1, "noradrenaline_sensitivity": 2.0})
    )
    np.testing.assert_allclose(usual, sensitive, rtol=1e-12)


@pytest.mark.parametrize("drug", PUBLISHED.values(), ids=PUBLISHED)
def test_published_drugs_are_parameters_with_sources_and_sane_at_any_dose(drug):
    assert drug.name in DRUG_DOSES
    assert all((drug.source, drug.shape_source, drug.half_life_source))
    largest, usual, _ = DRUG_DOSES[drug.name]
    assert 0.0 < usual <= largest
    assert float(drug.share(0.0)) == 0.0
    assert float(drug.share(drug.half_dose)) == pytest.approx(0.5)
    assert 0.2 < math.exp(min(drug.at_most[:4])) <= math.exp(max(drug.at_most[:4])) < 5.0
    assert abs(drug.at_most.veins) < 0.2
    assert set(PUBLISHED) == set(DRUG_DOSES)
    assert HEART_RATE in ACTS_ON


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"noradrenaline": 100}, "drugs.noradrenaline = 100: outside the allowed range; allowed: 0 to 3 "
         "ug/kg/min; did you mean 100 ng/kg/min = 0.1 ug/kg/min?"),
        ({"dobutamine": -2}, "drugs.dobutamine = -2: outside the allowed range; allowed: 0 to 40 ug/kg/min"),
        ({"milrinone": 500.0}, "drugs.milrinone = 500: outside the allowed range; allowed: 0 to 2 "
         "ug/kg/min; did you mean 500 ng/kg/min = 0.5 ug/kg/min?"),
        ({"adrenaline": 50}, "drugs.adrenaline = 50: outside the allowed range; allowed: 0 to 2 "
         "ug/kg/min; did you mean 50 ng/kg/min = 0.05 ug/kg/min?"),
        ({"vasopressin": 2.4}, "drugs.vasopressin = 2.4: outside the allowed range; allowed: 0 to 0.4 U/min; "
         "did you mean 2.4 U/h = 0.04 U/min?"),
        ({"vasopressin": 40}, "drugs.vasopressin = 40: outside the allowed range; allowed: 0 to 0.4 U/min; "
         "did you mean 40 mU/min = 0.04 U/min?"),
        ({"milrinone_sensitivity": 0},
         "drugs.milrinone_sensitivity = 0: must be above 0; allowed: 0.02 to 50 "),
    ],
)  # fmt: skip
def test_bad_doses_are_refused_in_one_line(values, line):
    with pytest.raises(CaseError) as caught:
        read(drugs=values)
    (mistake,) = caught.value.mistakes
    assert str(mistake).rstrip() == line.rstrip()


def test_an_unknown_drug_names_its_neighbour_and_a_large_dose_is_doubted():
    with pytest.raises(CaseError) as caught:
        read(drugs={"noradrenalin": 0.1})
    assert str(caught.value.mistakes[0]).endswith("did you mean noradrenaline?")
    with pytest.raises(CaseError) as caught:
        read(parameters={dose("milrinone"): 0.1})
    assert str(caught.value.mistakes[0]).endswith("did you mean drugs.milrinone?")
    (warning,) = read(drugs={"noradrenaline": 2.0}).warnings
    assert "extrapolated" in str(warning)
    (warning,) = read(drugs={"vasopressin": 0.2}).warnings
    assert "beyond the usual 0.1 U/min" in str(warning)


@pytest.mark.parametrize("drug", PUBLISHED.values(), ids=lambda d: d.name)
def test_a_dose_that_rounding_makes_negative_is_none(drug):
    """Ramps up from nothing pass such doses; a steepness that is no whole number made them NaN."""
    share, slope = jax.jvp(drug.share, (-1e-20,), (1.0,))
    assert (float(share), float(slope)) == (0.0, 0.0)
    assert np.isfinite(jax.jvp(drug.share, (0.0,), (1.0,))[1])


def test_an_infusion_that_settles_at_a_bound_is_not_beyond_it():
    """In a course with 0.15 ug/kg/min the remark on larger doses came and went with the last digits."""
    beat = {"MAP": 65.0, "PCWP": 15.0, "CO": 5.0, "right_atrial_pressure": 5.0, "systemic_flow": 5.0}

    def said(adrenaline):
        return [
            one.sentence
            for one in cautions(beat, {dose("adrenaline"): adrenaline})
            if "adrenaline" in one.sentence
        ]

    assert said(0.15 * (1.0 + 1e-6)) == []
    assert len(said(0.16)) == 1
    usual = DRUG_DOSES["adrenaline"].usual
    assert not any("extrapolated" in text for text in said(usual * (1.0 + 1e-6)))
    assert any("extrapolated" in text for text in said(1.1 * usual))


def test_what_is_left_of_a_drug_that_was_washed_out_raises_no_caution():
    """An hour after its pump was stopped, 6e-9 ug/kg/min of dobutamine "made pressures too low"."""
    beat = {"MAP": 65.0, "PCWP": 5.0, "CO": 5.0, "right_atrial_pressure": 5.0, "systemic_flow": 5.0}
    kept, gone = ([one.sentence for one in cautions(beat, {dose("dobutamine"): d})] for d in (0.1, 1e-5))
    assert any("dobutamine" in text for text in kept)
    assert gone == []
