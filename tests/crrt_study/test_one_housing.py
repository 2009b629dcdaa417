"""RenOx against the schemes, and the study of a patient with regions and gases."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.crrt_study.files import DRAWINGS, study_json
from eclsim.crrt_study.renox import compared_with_schemes
from eclsim.crrt_study.report import study_page
from eclsim.crrt_study.study import crrt_study
from eclsim.devices.crrt import Crrt
from eclsim.devices.renox import Renox
from eclsim.paper.crrt import paper_case

PICTURES = dict.fromkeys(DRAWINGS, "<svg></svg>")
REGIONAL = {
    "format": 1, "blood_volume_policy": "patient_held",
    "patient": {"id": "regional", "sex": "male", "age_years": 50, "height_cm": 175, "weight_kg": 70,
                "heart_rate_bpm": 90},
    "physiology": {"regional": True},
    "gas": {"haemoglobin_g_dl": 9.0, "shunt_fraction": 0.7},
    "ecmo": {"pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult", "drainage_site": "ivc",
             "drainage_cannula": "venous", "drainage_fr": 25, "return_site": "lower",
             "return_cannula": "arterial", "return_fr": 17, "sweep_l_min": 3.0, "fdo2": 0.6},
    "crrt": {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy",
             "dialysate_ml_h": 1000, "replacement_post_ml_h": 1000, "net_ultrafiltration_ml_h": 100},
}  # fmt: skip


@pytest.fixture(scope="module")
def regional():
    return crrt_study(read_mapping(REGIONAL).case, schemes="b,d,e,g,svc:ra", speeds="3000")


@pytest.mark.slow
def test_a_patient_with_regions_is_ranked_and_has_gases(regional):
    means = regional.means.sel(policy="patient_held", speed=3000.0)
    assert bool(means["converged"].all())
    assert {one.letter for one in regional.ranking["patient_held"]} == {"b", "d", "e", "g", "svc:ra"}
    assert float(means["recirculated_fraction"].sel(scheme="svc:ra")) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.slow
def test_blood_past_the_oxygenator_lowers_what_reaches_the_patient(regional):
    here = regional.means.sel(policy="patient_held", speed=3000.0)
    lost, taken_up = here["SpostO2"] - here["SreturnO2"], here["SpostO2"] - here["SpreO2"]
    assert float(lost.sel(scheme="g")) == pytest.approx(0.0, abs=1e-4)
    assert 0.001 < float(lost.sel(scheme="d")) < 0.01  # carbon dioxide of the fluids, which loosens oxygen
    most = here["past_oxygenator"] * taken_up
    assert 0.3 < float(lost.sel(scheme="e")) < float(most.sel(scheme="e"))
    assert float(here["PreturnCO2"].sel(scheme="e") - here["PpostCO2"].sel(scheme="e")) > 0.05


@pytest.mark.slow
def test_renox_moves_no_blood_and_clears_what_its_fluid_takes_up(regional):
    renox = regional.renox.sel(policy="patient_held", speed=3000.0)
    single = regional.without_crrt.sel(policy="patient_held", speed=3000.0)
    assert float(renox["PF"]) == pytest.approx(float(single["PF"]), rel=1e-9)
    assert float(renox["PreturnCO2"]) > float(single["PreturnCO2"])  # its fluid has more base than the blood
    assert float(renox["SreturnO2"]) == pytest.approx(float(single["SreturnO2"]), rel=1e-3)
    beside = compared_with_schemes(regional, "patient_held")
    assert next(iter(beside)) == "RenOx"
    assert beside["RenOx"]["access_mmhg"] is None
    assert beside["RenOx"]["blood_taken_up_ml"] == 0.0
    assert beside["RenOx"]["urea_ml_min"] == pytest.approx(2100.0 / 60.0, rel=0.01)
    for letter in ("e", "g"):  # at the pressure behind the pump, in its lines as in one housing
        assert beside[letter]["open_effluent_l_h"] > 5.0
    assert beside["RenOx"]["open_effluent_l_h"] > 5.0
    page = study_page(regional, PICTURES)
    assert "RenOx" in page
    plain = json.loads(study_json(regional))["policies"]["patient_held"]["renox"]
    assert plain["RenOx"]["return_mmhg"] is None
    assert math.isfinite(plain["g"]["return_mmhg"])


@pytest.mark.slow
def test_a_case_with_renox_alone_gives_its_fluids_to_the_schemes_too():
    own = Renox(dialysate_ml_h=2500, net_ultrafiltration_ml_h=120)
    case = paper_case().model_copy(update={"crrt": None, "renox": own})
    study = crrt_study(case, schemes="g", speeds="3425", volume_policy="patient_held")
    assert "renox_clearance_urea" not in study.means
    beside = compared_with_schemes(study, "patient_held")
    assert beside["RenOx"]["urea_ml_min"] == pytest.approx(2620.0 / 60.0, rel=0.01)
    assert beside["g"]["urea_ml_min"] == pytest.approx(2620.0 / 60.0, rel=0.05)
    assert [sentence.startswith("RenOx: ") for sentence in study.assumed] == [False, False, True, True]
    assert "37 mL/h/mmHg, is assumed" in study_page(study, PICTURES)
    written = json.loads(study_json(study))["assumed"]
    assert {f"{sentence[0].upper()}{sentence[1:]}" for sentence in study.assumed} < set(written)
    lost = replace(study, renox=study.renox * np.nan)
    unknown = compared_with_schemes(lost, "patient_held")["RenOx"]
    assert unknown["alarms_kept"] is None, "a beat that was not found kept all alarms, and took no blood"
    assert unknown["blood_taken_up_ml"] is None
    row = study_page(lost, PICTURES).partition(">RenOx<")[2].partition("</tr>")[0]
    assert "not known" in row
    assert "none" not in row


def test_without_fluids_there_is_no_renox():
    case = paper_case().model_copy(
        update={"crrt": Crrt(flow_ml_min=200, access_site="post_oxy", return_site="pre_oxy")}
    )
    study = crrt_study(case, schemes="g", speeds="3425", volume_policy="patient_held")
    assert study.renox is None
    assert compared_with_schemes(study, "patient_held") == {}
    assert "renox" not in json.loads(study_json(study))["policies"]["patient_held"]
