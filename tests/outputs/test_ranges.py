"""Values that a case file would refuse, varied from Python."""

import numpy as np
import pytest

from eclsim.cases.fluid import remarks_on_viscosity
from eclsim.cases.reading import read_mapping
from eclsim.orbit.model import UnknownValueError, model_of
from eclsim.outputs.ranges import allowed_range, out_of_range
from eclsim.simulation.single import derivatives, simulate, simulate_many

RAW = {
    "format": 1,
    "patient": {"id": "p", "sex": "male", "age_years": 60, "height_cm": 175, "weight_kg": 80,
                "heart_rate_bpm": 90},
    "ecmo": {"mode": "VA", "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult",
             "drainage_fr": 23, "return_fr": 17},
    "gas": {},
}  # fmt: skip
CRRT = {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy", "dialysate_ml_h": 2000}
CASE = read_mapping(RAW).case


def test_a_cannula_has_the_sizes_of_its_maker():
    """The cubic of its resistance rises again beyond them: 31 Fr carried less than 29 Fr, unsaid."""
    circuit, names = model_of(CASE).circuit, ("ecmo.drainage_fr", "ecmo.return_fr", "Rmc")
    ranges = [range_ and range_[:2] for range_ in (allowed_range(circuit, name) for name in names)]
    assert ranges == [(19, 29), (15, 23), (0.02, 8.0)]
    assert allowed_range(circuit, "ecmo.pump.R2") is None


def test_a_value_beyond_the_range_of_case_files_is_said_for_its_member():
    sizes = {"ecmo.drainage_fr": [23.0, 31.0], "etaB": [0.003, 3.0]}
    inside, beyond = out_of_range(model_of(CASE).circuit, sizes, 2)
    assert inside == []
    assert len(beyond) == 1
    assert "ecmo.drainage_fr = 31 Fr (19 to 29), etaB = 3 Pa s (0.001 to 0.01)" in beyond[0]


def test_results_say_what_is_extrapolated():
    found = simulate_many(CASE, {"ecmo.drainage_fr": [29.0, 31.0]}, outputs=["PF"])
    assert found.warnings.values[0] == ""
    assert "ecmo.drainage_fr = 31 Fr (19 to 29)" in found.warnings.values[1]
    one = simulate(model_of(CASE).with_values({"ecmo.drainage_fr": 31.0}))
    assert any("ecmo.drainage_fr = 31 Fr" in text for text in one.attrs["warnings"])
    assert not any("outside the range of case files" in text for text in simulate(CASE).attrs["warnings"])


def test_a_case_file_never_lies_outside_its_own_ranges():
    """A CRRT with gases was said to have a bicarbonate of 0, which stands for that of the blood."""
    filtered = read_mapping({**RAW, "crrt": CRRT}).case
    model = model_of(filtered)
    assert model.values["crrt.plasma_bicarbonate_mmol_l"] == 0.0
    assert out_of_range(model.circuit, model.values, 1) == [[]]


def test_what_is_solved_for_with_the_beat_lies_outside_no_range():
    """Every beat with a response to gases was warned of: sensed gases of NaN mmHg."""
    responses = {"chemoreflex": 1.0, "hypoxic_vasoconstriction": 1.0, "hypoxic_vasodilation": 1.0}
    found = simulate(read_mapping({**RAW, "regulation": responses}).case)
    assert found.attrs["converged"]
    assert not any("outside the range of case files" in text for text in found.attrs["warnings"])


@pytest.mark.parametrize(
    ("name", "inside", "beyond", "said"),
    [
        ("crrt.haematocrit_in", [0.0, 0.3], [-0.2, 0.9, 30.0], "(0.05 to 0.7)"),
        ("crrt.dialysate_ml_h", [0.0, 20.0], [-5.0, 10.0], "(0, or 20 to 20000)"),
        ("crrt.flow_ml_min", [0.0, 10.0], [5.0], "(0, or 10 to 600)"),
        ("KoAurea", [5.0], [0.0, 1.0], "(5 to 3000)"),
    ],
)
def test_a_small_number_may_be_a_wrong_one(name, inside, beyond, said):
    """A hundredth of a wide range let -5 mL/h of dialysate pass."""
    circuit = model_of(read_mapping({**RAW, "crrt": CRRT}).case).circuit
    found = out_of_range(circuit, {name: [*inside, *beyond]}, len(inside) + len(beyond))
    assert [bool(one) for one in found] == [False] * len(inside) + [True] * len(beyond)
    assert said in found[-1][0]


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("gas.fio2", -1.0, "0 to 1"),
        ("gas.fio2", 40.0, "0 to 1"),
        ("gas.shunt_fraction", 1.2, "0 to 1"),
        ("ecmo.sweep_l_min", -1.0, "0 or more"),
    ],
)
def test_a_value_that_no_gas_can_have_gives_no_gases(name, value, allowed):
    """A shunt of 1.2 gave a PaO2 of 8.7 mmHg, called steady, and a negative FiO2 no reason."""
    usual = model_of(CASE).values[name]
    found = simulate_many(CASE, {name: [usual, value]}, outputs=["PF", "SaO2", "PaCO2"])
    assert found.gas_status.values.tolist() == ["steady", "invalid_input"]
    assert np.isfinite(found.SaO2.values).tolist() == [True, False]
    assert np.isnan(found.PaCO2.values[1])
    assert found.PF.values[0] == found.PF.values[1]
    assert f"{name} = {value:g}: allowed: {allowed}" in found.message.values[1]
    assert found.attrs["without_gases"] == 1


def test_a_step_of_a_difference_may_leave_the_range():
    found = simulate_many(CASE, {"ecmo.fdo2": [1.0, 1.001]}, outputs=["SaO2"])
    assert found.gas_status.values.tolist() == ["steady", "steady"]
    assert found.warnings.values[1] == found.warnings.values[0]


def test_haemoglobin_alone_leaves_the_viscosity_and_that_is_said():
    alone = simulate_many(CASE, {"gas.haemoglobin_g_dl": [7.0, 16.0]}, outputs=["PF", "DO2"])
    assert alone.PF.values[0] == alone.PF.values[1]
    assert "not its viscosity" in "".join(alone.attrs["warnings"])
    assert remarks_on_viscosity(["Rmc"]) == []
    assert remarks_on_viscosity(["gas.haemoglobin_g_dl", "fluid.haematocrit"]) == []


FROM_BLOOD = {"crrt.plasma_bicarbonate_mmol_l": "24", "crrt.haematocrit_in": "0.3"}


@pytest.mark.parametrize(("name", "usual"), FROM_BLOOD.items())
def test_a_value_that_selects_that_of_the_blood_has_no_derivative(name, usual):
    """The derivative was an exact 0, at a value of 0."""
    model = model_of(read_mapping({**RAW, "crrt": CRRT}).case)
    with pytest.raises(
        UnknownValueError, match=f"{name} = 0 follows the patient's blood: set it, e.g. {usual},"
    ):
        derivatives(model, ["MAP"], ["Rmc", name])
    assert name not in model.parameters
    assert name in model.with_values({name: float(usual)}).parameters


def test_a_member_at_a_value_that_selects_that_of_the_blood_says_so():
    name = "crrt.plasma_bicarbonate_mmol_l"
    found = simulate_many(read_mapping({**RAW, "crrt": CRRT}).case, {name: [0.0, 24.0]}, outputs=["MAP"])
    said = f"{name} = 0 is no number to compute with: that of the blood itself is taken"
    assert said in found.warnings.values[0].split("\n")
    assert name not in found.warnings.values[1]
