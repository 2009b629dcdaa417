"""The study has the beat of `eclsim simulate` for the connection that a case has itself."""

import pytest

from eclsim import simulate
from eclsim.cases.reading import read_mapping
from eclsim.crrt_study.renox import compared_with_schemes
from eclsim.crrt_study.schemes import StudyError
from eclsim.crrt_study.study import crrt_study

CASE = {
    "format": 1, "blood_volume_policy": "as_published",
    "patient": {"id": "one", "sex": "female", "age_years": 70, "height_cm": 165, "weight_kg": 60,
                "heart_rate_bpm": 120},
    "ecmo": {"pump": "Rotaflow", "speed_rpm": 3425, "oxygenator": "Quadrox-i Adult", "drainage_site": "ra",
             "drainage_cannula": "venous", "drainage_fr": 21, "return_site": "ao",
             "return_cannula": "arterial", "return_fr": 17},
    "crrt": {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy", "dialysate_ml_h": 1000,
             "replacement_post_ml_h": 1000, "net_ultrafiltration_ml_h": 100},
}  # fmt: skip
ON_PATIENT = {"crrt": CASE["crrt"] | {"access_site": "svn", "return_site": "ra"}}
OUTPUTS = (
    "MAP", "PF", "crrt_access_pressure", "crrt_return_pressure", "filtration_fraction", "fresh_plasma_ml_h",
    "effective_clearance_creatinine", "base_gain", "effluent_pressure",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sections", "scheme"),
    [
        ({"fluid": {"haematocrit": 0.2}}, "g"),
        ({"fluid": {"haematocrit": 0.42, "reference_haematocrit": 0.28}}, "g"),
        ({"solutes": {"bicarbonate_mmol_l": 14}}, "g"),
        ({"fluid": {}, "crrt": CASE["crrt"] | {"haematocrit_in": 0.22}}, "g"),
        ({"physiology": {"regional": True}, **ON_PATIENT}, "svn:ra"),
        ({"physiology": {"collapsible_veins": True}, **ON_PATIENT}, "svn:ra"),
    ],
)
def test_own_connection_has_the_numbers_of_a_simulation(sections, scheme):
    case = read_mapping(CASE | sections).case
    study, beat = crrt_study(case, schemes=scheme, speeds="3425"), simulate(case)
    means = study.means.sel(policy="as_published", scheme=scheme, speed=3425.0)
    assert {n: float(means[n]) for n in OUTPUTS} == pytest.approx({n: float(beat[n]) for n in OUTPUTS}, 1e-6)


def test_a_site_that_the_patient_does_not_have_is_refused_in_a_sentence():
    with pytest.raises(StudyError, match="regional = true"):
        crrt_study(read_mapping(CASE).case, schemes="g,svc:ra", speeds="3425")


def test_an_access_pressure_of_more_than_190_breaks_no_alarm_beside_renox():
    case = read_mapping(CASE | {"ecmo": CASE["ecmo"] | {"speed_rpm": 3600}}).case
    study = crrt_study(case, schemes="a", speeds="3600", volume_policy="patient_held")
    beside = compared_with_schemes(study, "patient_held")["a"]
    access, back = (float(beside[f"{line}_mmhg"] or 0.0) for line in ("access", "return"))
    assert 190.0 < access < 250.0
    assert back < 350.0
    assert beside["alarms_kept"] is True
    assert study.ranking["patient_held"][0].alarms_kept is True


def test_an_open_effluent_filters_no_more_water_than_the_plasma_has():
    case = read_mapping(CASE).case
    study = crrt_study(case, schemes="g,h", speeds="3425", volume_policy="as_published")
    beside = compared_with_schemes(study, "as_published")
    assert beside["g"]["open_effluent_l_h"] == pytest.approx(
        0.93 * 60.0 * 0.2 * 0.7
    )  # 37 mL/h/mmHg: 12.6 L/h
    h = study.means.sel(policy="as_published", scheme="h", speed=3425.0)
    pressure = float(h["effluent_pressure"] + h["transmembrane_pressure"])
    assert beside["h"]["open_effluent_l_h"] == pytest.approx(37e-3 * pressure)
