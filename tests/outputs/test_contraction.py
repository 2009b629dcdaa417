"""Ventricles that soften as they contract are named, and only those."""

import numpy as np
import pytest

from eclsim.cases.quantities import with_values
from eclsim.cases.reading import read_mapping
from eclsim.components.chambers import Ventricle
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate, simulate_many
from eclsim.parameters.thiel2025 import PARAMETERS
from eclsim.validation.reference_cases import reference_model
from shock_patient import SHOCK

CASE = read_mapping(SHOCK).case


def too_weak(result):
    return [w for w in result.attrs["warnings"] if "is too weak for the" in w]


@pytest.mark.parametrize("contractility", [0.466, 0.2, 0.05])
def test_a_ventricle_that_loses_pressure_as_it_contracts_is_named(contractility):
    """With less contractility output rose from 1.9 to 4.0 L/min, and the page's light turned green."""
    beat = simulate(model_of(with_values(CASE, {"Emaxlv": contractility})))
    pressure = beat["Plv"].values
    at_end_diastole, contracted = np.interp([0.0, 0.3], beat["phase"].values, pressure)
    assert bool(too_weak(beat)) == (contracted < at_end_diastole) == (contractility == 0.05)
    if contractility == 0.05:
        assert float(beat["CO"]) > 3.5
        assert too_weak(beat)[0].startswith("alarm: the left ventricle is too weak for the 248 mL in it")
        assert beat.attrs["warnings"][0].startswith("alarm: ")


def test_each_member_of_a_batch_is_judged_even_if_only_its_output_is_asked_for():
    result = simulate_many(model_of(CASE), {"Emaxlv": [0.466, 0.2, 0.05]}, ["CO"])
    assert ["too weak" in w for w in result["warnings"].values.tolist()] == [False, False, True]


def test_drugs_and_reflexes_count():
    """The contractility of the case is too small, that in effect is not."""
    weak = {**SHOCK, "parameters": {**SHOCK["parameters"], "Emaxlv": 0.15}}
    assert too_weak(simulate(model_of(read_mapping(weak).case)))
    helped = simulate(model_of(read_mapping({**weak, "drugs": {"dobutamine": 10.0}}).case))
    assert float(helped["contractility_lv_factor"]) > 1.3
    assert not too_weak(helped)


def test_the_right_ventricle_is_judged_where_it_can_collapse_too():
    dying = with_values(CASE, {"Emaxlv": 0.05, "Emaxrv": 0.02})
    raw = {**SHOCK, "parameters": dict(dying.parameters), "physiology": {"collapsible_veins": True}}
    named = too_weak(simulate(model_of(read_mapping(raw).case)))
    assert sorted(w.partition(" is too")[0] for w in named) == [
        "alarm: the left ventricle",
        "alarm: the right ventricle",
    ]


def test_an_all_but_empty_ventricle_is_not_called_too_weak():
    """Its filling curve begins at 2.5 mmHg, above the line of systole near a volume of 0."""
    assert not too_weak(simulate(reference_model("s4_crrt_g_5000")))
    ventricle = Ventricle("Emaxlv", "LV_Pd_alpha", "LV_Pd_kappa", "LV_Pd_beta")
    values = {name: PARAMETERS[name].value for name in ventricle.parameter_names()}
    judged = {
        volume: ventricle.softens(volume, values | {"Emaxlv": 0.1}) for volume in (-1.0, 0.01, 60.0, 190.0)
    }
    assert judged == {-1.0: False, 0.01: False, 60.0: False, 190.0: True}


@pytest.mark.parametrize(
    ("parameters", "named"),
    [({"P0svn": 20.0, "Rpmc": 0.3, "Emaxrv": 0.1}, True), ({"RV_Pd_alpha": 5.0}, True), ({}, False)],
)
def test_a_ventricle_that_blood_runs_through_has_no_ejection_fraction_to_read(parameters, named):
    """A right ventricle of 6 mL a beat carried 5.2 L/min at 75 bpm, and an ejection fraction stood there."""
    man = {**SHOCK, "patient": {**SHOCK["patient"], "heart_rate_bpm": 75}, "parameters": parameters}
    beat = simulate(model_of(read_mapping(man).case))
    explained = float(beat["stroke_volume_rv"]) * 75 / 1000 / float(beat["pulmonary_valve_flow"])
    assert (explained < 0.7) == named
    assert any("blood runs through the right ventricle" in w for w in beat.attrs["warnings"]) == named
    assert beat["ejection_fraction_rv"].attrs.get("read_with_care", 0) == int(named)
    assert not any("blood runs through the left" in w for w in beat.attrs["warnings"])
