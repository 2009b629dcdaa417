import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from eclsim.cases import (
    Case,
    Patient,
    apply_settings,
    read_case,
    read_mapping,
    resolve_parameters,
    write_case,
)
from eclsim.devices import ecmo, lvad
from eclsim.devices.ecmo import Ecmo, RollerPump
from eclsim.devices.ecmo_parts import OXYGENATORS
from eclsim.devices.lvad import Lvad
from eclsim.devices.registry import parameters
from eclsim.patient.anthropometry import mean_height_weight, total_blood_volume_ml

PATIENT = Patient(id="P01", sex="female", age_years=70, height_cm=165, weight_kg=60, heart_rate_bpm=120)
USUAL = {"oxygenator": "Quadrox-i Small Adult", "mode": "VA"}


def test_a_case_built_in_python_is_checked_like_a_file():
    with pytest.raises(ValidationError, match="post_oxy"):
        Case.model_validate(
            {"patient": PATIENT, "crrt": {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "ra"}}
        )
    with pytest.raises(ValidationError, match="Hz"):
        Patient(id="P01", sex="female", age_years=70, heart_rate_bpm=1.2)
    with pytest.raises(ValidationError, match="did you mean age_years"):
        Patient(id="P01", sex="female", age=70, heart_rate_bpm=80)


def test_a_case_cannot_be_changed():
    with pytest.raises(ValidationError, match="frozen"):
        PATIENT.age_years = 30


def test_without_devices_only_tables_patient_and_blood_volume_are_resolved():
    values = resolve_parameters(Case(patient=PATIENT))
    assert set(values) == {*parameters(), "heart_rate_bpm", "total_blood_volume_ml"}
    assert values["heart_rate_bpm"] == 120
    assert values["total_blood_volume_ml"] == pytest.approx(57 * 60 / (60 / 1.65**2 / 22) ** 0.5)
    assert values["Rmc"] == 0.5


def test_height_and_weight_left_out_are_taken_from_the_table():
    patient = Patient(id="P01", sex="male", age_years=42, heart_rate_bpm=80)
    volume = resolve_parameters(Case(patient=patient))["total_blood_volume_ml"]
    assert volume == pytest.approx(total_blood_volume_ml("male", 42, *mean_height_weight("male", 42)))


def test_devices_bring_their_constants_and_overrides_win():
    pump = Lvad(pump="HM3", speed_rpm=5400, inlet_site="lv", outlet_site="ao")
    circuit = Ecmo(pump="DP3", speed_rpm=6000, **USUAL)
    values = resolve_parameters(Case(patient=PATIENT, ecmo=circuit, lvad=pump, parameters={"Csart": 2.0}))
    assert values["ecmo.pump.R2"] == ecmo.PUMPS["DP3"].R2
    assert values["ecmo.speed_rpm"] == 6000
    assert (values["ecmo.drainage_fr"], values["ecmo.return_fr"]) == (21, 17)
    assert values["lvad.pump.Lper"] == lvad.PUMPS["HM3"].Lper
    assert "ecmo.pump.L" not in values
    assert values["Recmooxy"] == OXYGENATORS["Quadrox-i Small Adult"].resistance
    assert values["Csart"] == 2.0
    chosen = Case(patient=PATIENT, ecmo=circuit, parameters={"Recmooxy": 0.7})
    assert resolve_parameters(chosen)["Recmooxy"] == 0.7


def test_a_roller_pump_has_a_flow_and_no_speed():
    circuit = Ecmo(pump=RollerPump(roller_l_min=4.0), **USUAL)
    values = resolve_parameters(Case(patient=PATIENT, ecmo=circuit))
    assert values["ecmo.roller_l_min"] == 4.0
    assert not any(key.startswith("ecmo.pump") or key == "ecmo.speed_rpm" for key in values)
    with pytest.raises(ValidationError, match="a flow, not a speed"):
        Ecmo(pump={"roller_l_min": 4.0}, speed_rpm=3000, **USUAL)


IDS = st.text(st.characters(exclude_categories=("C", "Z")), min_size=1, max_size=30)
OVERRIDES = st.dictionaries(st.sampled_from(["Rmc", "Csart", "Emaxlv", "etaB"]), st.floats(0.9, 1.1))


@settings(max_examples=40, deadline=None)
@given(name=IDS, age=st.floats(18, 100), factors=OVERRIDES, roller=st.booleans(), measured=st.floats(21, 60))
def test_a_written_case_reads_back_the_same(tmp_path_factory, name, age, factors, roller, measured):
    mapping = {
        "format": 1,
        "patient": {"id": name, "sex": "male", "age_years": age, "heart_rate_bpm": 80},
        "measurements": {"MAP": measured},
        "ecmo": {"pump": {"roller_l_min": 4.0} if roller else "Rotaflow", **USUAL},
        "crrt": {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy"},
        "parameters": {key: factor * parameters()[key].value for key, factor in factors.items()},
    }
    if not roller:
        mapping["ecmo"]["speed_rpm"] = 3425
    case = read_mapping(mapping).case
    file = tmp_path_factory.mktemp("written") / "case.toml"
    write_case(case, file)
    assert read_case(file).case == case


@pytest.mark.parametrize("policy", [None, "as_published", "patient_held"])
def test_the_blood_volume_policy_is_written_and_read_back(tmp_path, policy):
    case = Case(patient=PATIENT, blood_volume_policy=policy)
    write_case(case, tmp_path / "case.toml")
    result = read_case(tmp_path / "case.toml").case
    assert result == case
    assert result.volume_policy == (policy or "as_published")


def test_what_nobody_gave_is_not_written(tmp_path):
    """Written cases had `second_return_clamp = 0`, and settings made an assumed shunt a known one."""
    ecmo = {"pump": "Rotaflow", "oxygenator": "Quadrox-i Adult", "speed_rpm": 3000, "mode": "VA"}
    case = Case(patient=PATIENT, ecmo=ecmo, gas={"fio2": 0.6}, drugs={"adrenaline": 0.1}, fluid={})
    case = apply_settings(case, ["ecmo.speed_rpm=3500"])
    write_case(case, tmp_path / "case.toml")
    raw = tomllib.loads((tmp_path / "case.toml").read_text())
    assert not {"second_return_clamp", "return_clamp"} & raw["ecmo"].keys()
    assert raw["gas"].keys() == {"fio2"}
    assert (raw["drugs"], raw["fluid"]) == ({"adrenaline": 0.1}, {})
    assert read_case(tmp_path / "case.toml").case == case


def test_writing_leaves_nothing_half_written(tmp_path):
    with pytest.raises(OSError, match="none"):
        write_case(Case(patient=PATIENT), tmp_path / "none" / "case.toml")
    (tmp_path / "case.toml").mkdir()
    with pytest.raises(OSError, match=r"case\.toml"):
        write_case(Case(patient=PATIENT), tmp_path / "case.toml")
    assert [item.name for item in tmp_path.iterdir()] == ["case.toml"]


def test_a_written_file_tells_units_and_replaces_the_old_one(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text("old")
    write_case(Case(patient=PATIENT, parameters={"Rmc": 0.6}), file)
    text = file.read_text()
    assert "heart_rate_bpm = 120 # Heart rate [bpm]" in text
    assert "Rmc = 0.6 # Resistance of systemic microcirculation [mmHg s/mL]" in text
