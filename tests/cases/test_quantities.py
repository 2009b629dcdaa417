import pytest

from eclsim.cases.quantities import quantity, stated, with_values
from eclsim.cases.reading import read_mapping
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.model import values_of

ECMO = {
    "pump": "Rotaflow", "speed_rpm": 3300, "oxygenator": "Quadrox-i Adult", "mode": "VV", "drainage_fr": 25,
    "return_fr": 21, "sweep_l_min": 4.0,
}  # fmt: skip
RAW = {
    "format": 1,
    "patient": {"id": "P", "sex": "male", "age_years": 50, "heart_rate_bpm": 90},
    "gas": {"haemoglobin_g_dl": 10.0, "shunt_fraction": 0.5},
    "ecmo": ECMO,
    "lvad": {"left": {"pump": "HVAD", "speed_rpm": 2500, "inlet_site": "lv", "outlet_site": "ao"}},
}


@pytest.fixture(scope="module")
def case():
    return read_mapping(RAW).case


def test_every_number_goes_back_to_where_a_case_file_holds_it(case):
    values = {
        "gas.vo2_ml_min": 180.0, "ecmo.sweep_l_min": 6.0, "ecmo.drainage_mixing": 0.3, "Rmc": 0.7,
        "heart_rate_bpm": 70.0, "lvad.left.speed_rpm": 2400.0, "ecmo.oxygenator.clotted_fraction": 0.2,
    }  # fmt: skip
    changed = with_values(case, values).as_mapping()
    assert changed["gas"]["vo2_ml_min"] == 180.0
    assert (changed["ecmo"]["sweep_l_min"], changed["ecmo"]["drainage_mixing"]) == (6.0, 0.3)
    assert changed["parameters"] == {"Rmc": 0.7, "ecmo.oxygenator.clotted_fraction": 0.2}
    assert changed["patient"]["heart_rate_bpm"] == 70.0
    assert changed["lvad"]["left"]["speed_rpm"] == 2400.0
    again = read_mapping(changed).case
    assert {name: stated(again, name) for name in values} == values
    assert stated(case, "gas.vo2_ml_min") is None


def test_a_fitted_haemoglobin_leaves_the_base_excess_of_its_beats(case):
    """A fitted file had another base excess than its fit where only the bicarbonate was given."""
    acidotic = read_mapping(RAW | {"solutes": {"bicarbonate_mmol_l": 14.0}}).case
    base = values_of(acidotic)["gas.base_excess_mmol_l"]
    assert base == pytest.approx(-14.3, abs=0.1)
    changed = with_values(acidotic, {"gas.haemoglobin_g_dl": 7.0})
    assert values_of(read_mapping(changed.as_mapping()).case)["gas.base_excess_mmol_l"] == base
    for given in ({"gas.base_excess_mmol_l": -5.0}, {}):
        values = {"gas.haemoglobin_g_dl": 7.0} | given
        of_gas_alone = with_values(case, values)
        assert values_of(of_gas_alone)["gas.base_excess_mmol_l"] == given.get("gas.base_excess_mmol_l", 0.0)


def test_a_number_of_an_instance_is_what_its_device_says():
    assert quantity("ecmo.left.Recmooxy").unit == "mmHg s/mL"
    assert quantity("ecmo.left.drainage_mixing").maximum == 1.0
    assert quantity("lvad.left.speed_rpm").unit == "rpm"
    assert quantity("ecmo.pump") is None
    assert quantity("gas.nonsense") is None


def test_a_number_without_its_section_is_refused(case):
    with pytest.raises(ValueError, match=r"has no \[crrt\] section"):
        with_values(case, {"crrt.flow_ml_min": 100.0})
    with pytest.raises(ValueError, match="not a numeric quantity of a case"):
        with_values(case, {"nothing": 1.0})


def test_volume_given_to_a_patient_without_a_section_for_it_makes_one(case):
    """A fit that frees it must be able to say what it found."""
    changed = with_values(case, {"fluid.extra_volume_ml": 300.0}).as_mapping()
    assert changed["fluid"]["extra_volume_ml"] == 300.0
    assert read_mapping(changed).case.fluid.extra_volume_ml == 300.0


@pytest.mark.parametrize("key", ["ecmo.sweep_l_min", "ecmo.drainage_mixing", "gas.shunt_fraction"])
def test_what_has_a_section_does_not_stand_in_parameters(key):
    with pytest.raises(CaseError) as caught:
        read_mapping({**RAW, "parameters": {key: 0.5}})
    assert [str(m) for m in caught.value.mistakes] == [
        f"parameters.{key} = 0.5: is set in the section [{key.split('.')[0]}], not here; allowed: "
        f"{key.split('.')[1]} in [{key.split('.')[0]}]; did you mean {key}?"
    ]
