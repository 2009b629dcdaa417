"""The study against the numbers that sections 3.3 and 4 of the paper print, and against itself."""

import json

import numpy as np
import pytest
import xarray as xr

from eclsim.cases.case import Case
from eclsim.crrt_study.ranking import choice_text
from eclsim.crrt_study.schemes import StudyError
from eclsim.crrt_study.study import crrt_study
from eclsim.devices.ecmo import RollerPump
from eclsim.orbit.model import model_of
from eclsim.paper.crrt import paper_case

LINES = [("Pcrrttuin", 161.4, 296.6), ("Pcrrttuout", 258.2, 295.9)]


def summary(study, name, speed=3425.0, policy="as_published"):
    return study.summary[name].sel(policy=policy, speed=speed).item()


def mean(study, letter, name, speed=3425.0, policy="as_published"):
    return float(study.means[name].sel(policy=policy, speed=speed, scheme=letter))


def test_every_steady_beat_is_found(study):
    assert study.converged
    assert study.means.sizes == {"policy": 2, "scheme": 9, "speed": 8}


@pytest.mark.parametrize(("name", "median", "variation"), LINES)
def test_line_pressures_at_3425_rpm_are_within_1_percent_of_the_paper(study, name, median, variation):
    assert summary(study, f"{name}_median") == pytest.approx(median, rel=0.01)
    assert summary(study, f"{name}_variation") == pytest.approx(variation, rel=0.01)


@pytest.mark.parametrize(
    ("name", "value"),
    [("Psart_median", 70.3), ("Psart_variation", 5.4), ("PF_median", 3.7)],
)
def test_arterial_pressure_and_flow_at_3425_rpm_are_within_2_percent_of_the_paper(study, name, value):
    assert summary(study, name) == pytest.approx(value, rel=0.02)


@pytest.mark.parametrize(
    ("letter", "name", "value"),
    [
        ("g", "Pcrrttuin", 119.0),
        ("g", "Pcrrttuout", 313.0),
        ("c", "Pcrrttuin", 120.0),
        ("c", "Pcrrttuout", 17.0),
    ],
)
def test_methods_a_and_b_of_wu_give_the_pressures_of_the_text(study, letter, name, value):
    assert mean(study, letter, name) == pytest.approx(value, abs=1.5)


@pytest.mark.parametrize(
    ("speed", "name", "value"),
    [
        (1750.0, "Psart_median", 49.4),
        (1750.0, "Pcrrttuin_variation", 81.3),
        (1750.0, "Pcrrttuout_median", 136.5),
        (5000.0, "Psart_median", 85.2),
        (5000.0, "Pecmodrain_median", -129.6),
        (5000.0, "Pcrrttuin_median", 397.4),
        (5000.0, "Pcrrttuin_variation", 624.5),
        (5000.0, "Pcrrttuout_median", 459.5),
        (5000.0, "Pcrrttuout_variation", 622.9),
    ],
)
def test_rows_at_1_2_and_6_litres_are_within_2_percent_of_the_paper(study, speed, name, value):
    assert summary(study, name, speed) == pytest.approx(value, rel=0.02)


def test_schemes_a_and_h_give_the_lowest_and_the_highest_arterial_pressure(study):
    assert summary(study, "Psart_lowest") == "a"
    assert summary(study, "Psart_highest") == "h"
    assert summary(study, "Psart_variation_percent") == pytest.approx(
        100.0 * (mean(study, "h", "Psart") - mean(study, "a", "Psart")) / summary(study, "Psart_median")
    )


@pytest.mark.slow
def test_the_switched_circuit_gives_what_a_circuit_of_one_scheme_gives(study):
    from eclsim.outputs.results import simulate

    single = simulate(model_of(paper_case().with_section("crrt", access_site="post_pump")))
    for name in ("MAP", "SP", "CO", "PF", "EDVRV", "crrt_access_pressure", "lowest_drainage_pressure"):
        assert mean(study, "a", name) == pytest.approx(float(single[name]), rel=1e-5), name
    assert mean(study, "a", "recirculated_fraction") == pytest.approx(
        float(single["crrt_recirculated_fraction"]), abs=1e-6
    )
    one = study.waveforms.sel(policy="as_published", scheme="a")
    np.testing.assert_allclose(one["Vlv"], single["Vlv"], rtol=1e-4)


def test_as_published_the_tubing_takes_24_to_89_ml_but_in_scheme_h(study):
    taken = study.uptake["blood_taken_up"].to_series()
    assert taken.drop("h").min() == pytest.approx(24.0, abs=0.5)
    assert taken.drop("h").max() == pytest.approx(89.0, abs=0.5)
    assert abs(taken["h"]) < 1.0
    change = study.means["patient_volume_change"].sel(speed=3425.0)
    np.testing.assert_allclose(change.sel(policy="as_published"), -taken, atol=1e-6)
    np.testing.assert_allclose(change.sel(policy="patient_held"), 0.0, atol=1e-6)


def test_with_the_volume_kept_the_schemes_hardly_differ(study):
    assert summary(study, "Psart_variation") > 5.0
    assert summary(study, "Psart_variation", policy="patient_held") < 0.7
    kept = study.uptake["Psart_flow"].values + float(
        study.without_crrt["Psart"].sel(policy="as_published", speed=3425.0)
    )
    assert kept.min() == pytest.approx(75.0, abs=0.1)
    assert kept.max() == pytest.approx(75.5, abs=0.1)


def test_uptake_and_flow_add_to_the_difference_to_no_crrt(study):
    without = study.without_crrt["EDVRV"].sel(policy="as_published", speed=3425.0)
    whole = study.means["EDVRV"].sel(policy="as_published", speed=3425.0) - without
    np.testing.assert_allclose(study.uptake["EDVRV_difference"], whole, rtol=1e-9)
    parts = study.uptake["EDVRV_uptake"] + study.uptake["EDVRV_flow"]
    np.testing.assert_allclose(parts, whole, rtol=1e-9)


def test_access_stays_below_190_mmhg_up_to_the_flows_of_the_text(study):
    flows = study.limits["largest_flow"].sel(policy="as_published", limit="access_190")
    assert float(flows.sel(scheme=["g", "d", "c"]).mean()) == pytest.approx(4.7, abs=0.1)
    assert float(flows.sel(scheme="a")) == pytest.approx(4.0, abs=0.1)
    together = study.limits["largest_flow"].sel(limit="crrt")
    single = study.limits["largest_flow"].sel(limit=["access_alarm", "return_alarm", "access_190"])
    np.testing.assert_allclose(together, single.min("limit"), atol=0.01)


def test_ranking_prefers_d_and_gives_every_reason(study):
    for policy in study.policies:
        ranked = study.ranking[policy]
        assert [one.rank for one in ranked] == list(range(1, 10))
        assert ranked[0].letter == "d"
        below = [one.letter for one in ranked if one.lowest_site_pressure < 0.0]
        assert below == [one.letter for one in ranked[-len(below) :]], "lines before the pump come last"
        assert sorted(below) == ["b", "c", "h", "i"]
        assert all("draws in air" in " ".join(one.reasons) for one in ranked[-4:])


def test_published_and_drawn_scheme_h_can_both_be_had():
    result = crrt_study(
        paper_case(), schemes="a,h,i", speeds="3425", volume_policy="as_published", scheme_h="figure"
    )
    assert result.schemes[1].return_site == "post_dc"
    assert mean(result, "h", "Pcrrttuout") == pytest.approx(31.1, abs=0.2)
    assert summary(result, "Pcrrttuin_variation") == pytest.approx(297.2, abs=0.1), "the paper prints 296.6"


@pytest.mark.slow
def test_crrt_on_the_patient_leaves_the_ecmo_circuit_alone():
    result = crrt_study(paper_case(), schemes="separate,g", speeds="3425", volume_policy="patient_held")
    without = result.without_crrt.sel(policy="patient_held", speed=3425.0)
    assert mean(result, "svn:svn", "PF", policy="patient_held") == pytest.approx(
        float(without["PF"]), rel=1e-3
    )
    for letter, share in (("svn:ra", 0.0), ("svn:svn", 0.04), ("ra:ra", 0.04)):
        recirculated = mean(result, letter, "recirculated_fraction", policy="patient_held")
        assert recirculated == pytest.approx(share, abs=0.005), letter
    ranking = result.ranking["patient_held"]
    assert ranking[0].letter == "g"
    assert ranking[1].decided_by.startswith("has both lines on the ECMO circuit (on the patient a catheter's")
    alone = crrt_study(
        paper_case(), schemes="svn:ra,c", speeds="3425", volume_policy="patient_held",
        rule={"name": "own", "criteria": [{"quantity": "margin", "prefer": "larger"}]},
    )  # fmt: skip
    answer = choice_text(alone, "patient_held")
    assert answer[0].startswith("First choice for this patient: scheme svn:ra")
    assert answer[-1] == (
        "its lines attach to the patient without a catheter's resistance: their pressures are too mild; best "
        "of the schemes on the ECMO circuit: scheme c (post oxygenator – pre pump), place 2"
    )
    assert result.uptake is None


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"ecmo": None}, "no \\[ecmo\\] section"),
        ({"ecmo": {"pump": RollerPump(roller_l_min=4.0), "speed_rpm": None}}, "roller pump"),
    ],
)
def test_a_case_without_a_pump_speed_is_refused(change, text):
    case = paper_case()
    ecmo = change["ecmo"]
    case = case.model_copy(update={"ecmo": None if ecmo is None else case.ecmo.model_copy(update=ecmo)})
    with pytest.raises(StudyError, match=text):
        crrt_study(case)


def test_named_crrt_circuits_are_refused():
    sites = {"flow_ml_min": 150.0, "access_site": "post_oxy", "return_site": "pre_oxy"}
    case = paper_case()
    raw = {key: value for key, value in case.as_mapping().items() if key != "crrt"} | {"crrt": {"x": sites}}
    with pytest.raises(
        StudyError, match=r"has \[crrt.x\]: the study places one CRRT circuit; write \[crrt\]"
    ):
        crrt_study(type(case).model_validate(raw))


@pytest.mark.parametrize("options", [{"volume_policy": "primed"}, {"crrt_flow_ml_min": 0.0}])
def test_options_out_of_range_are_refused(options):
    with pytest.raises(StudyError, match="allowed"):
        crrt_study(paper_case(), **options)


def test_every_step_is_told():
    message: list[str] = []
    crrt_study(paper_case(), schemes="g", speeds="3425", progress=message.append)
    assert message == [
        "policy 1 of 2 (as_published): 1 schemes at 1 speeds",
        "policy 2 of 2 (patient_held): 1 schemes at 1 speeds",
        "effects of the schemes split into blood volume and flow",
        "limits and ranking",
    ]


def test_the_front_door_takes_a_file_and_gives_labelled_numbers_and_plain_data(tmp_path):
    import eclsim
    from eclsim.cases.reading import write_case

    write_case(paper_case(), tmp_path / "case.toml")
    message = []
    study = eclsim.crrt_study(
        tmp_path / "case.toml", schemes="g", speeds=[3425.0], volume_policy="as_published",
        progress=lambda line: message.append(str(line)),
    )  # fmt: skip
    assert study.dataset["Pcrrttuin"].dims == ("policy", "scheme", "speed")
    assert study.dataset["Pcrrttuin"].attrs["units"] == "mmHg"
    assert study.as_object()["id"] == "Thiel 2025, section 3.3"
    assert any("1 schemes at 1 speeds" in line for line in message)


def test_the_labelled_result_repeats_the_study_and_names_rule_and_ranks(tmp_path):
    """It had the version alone: no flow, rule, warnings, case or ranking."""
    chosen = {"speeds": [3425.0], "volume_policy": "as_published"}
    study = crrt_study(paper_case(), schemes="a,g", crrt_flow_ml_min=150.0, **chosen)
    study.dataset.to_netcdf(tmp_path / "study.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "study.nc", engine="h5netcdf") as saved:
        about, ranks = saved.attrs, saved["rank"].sel(policy="as_published").to_series().to_dict()
    assert ranks == {ranked.letter: ranked.rank for ranked in study.ranking["as_published"]}
    assert about["crrt_flow_ml_min"] == 150.0
    assert [*about["warnings"]] == [*study.warnings]
    again = crrt_study(
        Case.model_validate_json(about["case"]), schemes="a,g", rule=json.loads(about["rule"]),
        crrt_flow_ml_min=about["crrt_flow_ml_min"], **chosen,
    )  # fmt: skip
    xr.testing.assert_identical(again.dataset, study.dataset)
    assert "case" not in study.means.attrs  # written to study.nc, which has the case once
