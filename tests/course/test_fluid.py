"""Fluid and solutes through the engine of courses: rest, balances, refill."""

import numpy as np
import pytest

from eclsim.cases import CaseError
from eclsim.cases.reading import read_mapping
from eclsim.course.course import course
from eclsim.course.drug_remarks import remarks_on_drugs
from eclsim.course.fluid_remarks import remarks_on_fluids, remarks_on_protein
from eclsim.course.timeline import Timeline
from eclsim.fluid.law import INTERSTITIAL_PROTEIN, INTERSTITIUM, PLASMA, PROTEIN, REMOVED

RAW = {
    "format": 1,
    "patient": {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75},
    "crrt": {
        "flow_ml_min": 200, "access_site": "svn", "return_site": "ra", "dialysate_ml_h": 1500,
        "net_ultrafiltration_ml_h": 0,
    },
    "fluid": {},
    "solutes": {"bicarbonate_mmol_l": 18},
}  # fmt: skip
FILTERING = RAW["crrt"] | {"net_ultrafiltration_ml_h": 100}
AS_PEOPLE = {
    "fluid": {"filtration_ml_min_mmHg": 4},
    "regulation": {"baroreflex": 1.0, "model": "heldt2010"},
    "parameters": {"Csvn": 95},
}
EVENTS = [
    {"at_min": 20, "give": {"crystalloid_ml": 400}, "over_min": 30},
    {"at_min": 60, "give": {"bleed_ml": 300}, "over_min": 10},
    {"at_min": 90, "give": {"red_cells_ml": 250}, "over_min": 40},
    {"at_min": 100, "give": {"albumin_ml": 100}, "over_min": 10},
    {"at_min": 120, "set": {"crrt.net_ultrafiltration_ml_h": 200}},
]


def follow(minutes, **sections):
    case = read_mapping(RAW | sections).case
    outputs = ("MAP", "CO", "crrt_access_pressure")
    result = course(case, minutes=minutes, every_min=minutes / 12.0, outputs=outputs)
    assert result.attrs["converged"], result.attrs["message"]
    return result


def change(found, *names):
    return sum(float(found[name][-1] - found[name][0]) for name in names)


@pytest.mark.parametrize(
    "key",
    ["fluid.extra_volume_ml", "solutes.urea_mmol_l", "gas.haemoglobin_g_dl", "patient.weight_kg", "P0svn"],
)
def test_events_set_no_starts(key):
    with pytest.raises(CaseError) as caught:
        read_mapping(
            RAW | {"gas": {}, "events": [{"at_min": 5, "set": {key: 60 if "patient" in key else 9}}]}
        )
    assert f"{key} = {60 if 'patient' in key else 9}: is a value at the start of the course" in str(
        caught.value
    )


@pytest.mark.slow
def test_courses_say_potassium_beyond_its_limits():
    result = follow(240.0, solutes={"potassium_mmol_l": 7.0, "fluid_potassium_mmol_l": 0.0})
    sentences = [line for line in result.attrs["warnings"] if "potassium" in line]
    assert sentences[0].startswith("alarm: potassium of the plasma above 6.5 mmol/L at 00:00, until 0")
    assert "(7 mmol/L at worst): hyperkalaemia" in sentences[0]
    assert sentences[1].startswith("potassium of the plasma above 6 mmol/L at 00:00")
    assert "(7 mmol/L at worst): hyperkalaemia" in sentences[1]


@pytest.mark.slow
def test_a_patient_at_rest_stays_there_whatever_is_dialysed():
    result = follow(360.0)
    for name in ("MAP", "CO", "fluid.plasma_ml", "haematocrit"):
        np.testing.assert_allclose(result[name], result[name][0].item(), rtol=1e-6)
    assert result["urea"][-1] < 0.92 * result["urea"][0]
    assert 18.0 < result["bicarbonate"][-1] < 32.0


@pytest.mark.slow
def test_ultrafiltration_takes_bicarbonate_with_its_water():
    crrt = RAW["crrt"] | {"net_ultrafiltration_ml_h": 150}
    del crrt["dialysate_ml_h"]
    result = follow(360.0, crrt=crrt, solutes={"bicarbonate_mmol_l": 24, "acid_generation_mmol_h": 0})
    assert change(result, "fluid.plasma_ml", "fluid.interstitium_ml") == pytest.approx(-900.0, abs=1e-3)
    np.testing.assert_allclose(result["bicarbonate"], 24.0, rtol=1e-6)


@pytest.mark.slow
def test_a_course_ends_where_an_amount_is_used_up():
    crrt = RAW["crrt"] | {"net_ultrafiltration_ml_h": 0}
    solutes = {"bicarbonate_mmol_l": 24, "acid_generation_mmol_h": 500}
    result = course(read_mapping(RAW | {"crrt": crrt, "solutes": solutes}).case, minutes=2880.0)
    assert not result.attrs["converged"]
    assert "bicarbonate outside cells is used up" in result.attrs["message"]
    assert result["bicarbonate"].min() > -0.1


@pytest.mark.slow
def test_what_goes_through_the_doors_is_what_is_there():
    result = follow(180.0, events=EVENTS)
    blood = change(result, "fluid.plasma_ml", "fluid.red_cells_ml")
    through = change(result, "fluid.given_ml", "fluid.refilled_ml") - change(result, "fluid.removed_ml")
    assert blood == pytest.approx(through, abs=1e-6)
    assert change(result, "fluid.given_ml") == pytest.approx(750.0, abs=1e-6)
    assert change(result, "fluid.removed_ml") == pytest.approx(500.0, abs=1e-6)
    assert change(result, "fluid.interstitium_ml", "fluid.refilled_ml") == pytest.approx(0.0, abs=1e-6)
    cells = change(result, "fluid.red_cells_ml")
    assert cells == pytest.approx(change(result, "fluid.red_cells_given_ml"), abs=1e-6)
    assert 20.0 < cells < 100.0
    protein = change(result, "fluid.plasma_protein_g", "fluid.interstitial_protein_g")
    assert protein == pytest.approx(change(result, "fluid.protein_given_g"), abs=1e-9)
    for solute, pools in (("urea", ("outside", "inside")), ("creatinine", ("outside", "inside"))):
        held = change(result, *(f"solutes.{solute}_{pool}_mmol" for pool in pools))
        made, removed = (change(result, f"solutes.{solute}_{what}_mmol") for what in ("made", "removed"))
        assert held == pytest.approx(
            made - removed, abs=1e-9 * float(result[f"solutes.{solute}_inside_mmol"][0])
        )


@pytest.mark.slow
def test_less_comes_back_past_what_is_next_to_capillaries_and_protein_balances():
    crrt = RAW["crrt"] | {"net_ultrafiltration_ml_h": 400}
    one, distance = (follow(240.0, crrt=crrt, fluid={"pericapillary_share": share}) for share in (1.0, 0.12))
    assert "fluid.pericapillary_protein_g" not in one
    near, outside = (distance[f"fluid.{n}_protein_g"] for n in ("pericapillary", "interstitial"))
    assert near[0] == pytest.approx(0.12 * outside[0])
    assert near[-1] > 0.15 * outside[-1]
    protein = ("fluid.plasma_protein_g", "fluid.interstitial_protein_g")
    assert change(distance, *protein) == pytest.approx(0, abs=1e-9)
    assert change(distance, "fluid.refilled_ml") < 0.9 * change(one, "fluid.refilled_ml")


@pytest.mark.slow
def test_an_event_makes_lymphatics_pump_harder_and_protein_balances():
    bled = {"at_min": 5, "give": {"bleed_ml": 500}, "over_min": 10}
    pumped = {"at_min": 15, "set": {"fluid.lymph_pump": 2.0}}
    usual, harder = (follow(600.0, events=events) for events in ([bled], [bled, pumped]))
    protein = ("fluid.plasma_protein_g", "fluid.interstitial_protein_g", "fluid.protein_given_g")
    *held, given = (change(harder, name) for name in protein)
    assert sum(held) == pytest.approx(given, abs=1e-9)
    assert change(harder, protein[0]) > change(usual, protein[0]) + 2.0
    assert change(harder, "fluid.refilled_ml") > change(usual, "fluid.refilled_ml") + 20.0


@pytest.mark.slow
def test_a_filter_that_takes_all_plasma_ends_the_course_with_a_reason():
    """It has no clearance; the course went on for ever."""
    crrt = RAW["crrt"] | {"net_ultrafiltration_ml_h": 7700}
    result = course(read_mapping(RAW | {"crrt": crrt}).case, minutes=10.0)
    assert not result.attrs["converged"]
    assert "no value of effective_clearance_urea, effective_clearance_creatinine" in result.attrs["message"]
    assert "which the course needs to go on" in result.attrs["message"]
    assert "a filter takes as much water from its blood as the plasma holds" in result.attrs["message"]


@pytest.mark.slow
def test_removal_beyond_the_last_steady_beat_ends():
    """A shortest step whose end has no beat was tried again for ever.

    With one Jacobian for all steps plasma swung from 977 mL to nothing, at 08:11.
    """
    sections = {name: RAW[name] for name in RAW if name != "solutes"}
    crrt = RAW["crrt"] | {"net_ultrafiltration_ml_h": 1500}
    case = read_mapping(sections | {"crrt": crrt, "regulation": {"baroreflex": 1.0}}).case
    result = course(case, minutes=600.0, every_min=60.0)
    assert not result.attrs["converged"]
    assert result.attrs["message"].startswith("stopped at 08:55")
    assert 100.0 < result["fluid.plasma_ml"].values[-1] < 400.0


@pytest.mark.slow
def test_a_clotted_filter_is_stopped_and_started_again_with_its_fluids():
    """A pump could not be stopped by an event: no blood flow below 10 mL/min was allowed."""
    events = [
        {"at_min": 60, "set": {"crrt.flow_ml_min": 0}, "give": {"bleed_ml": 150}},
        {"at_min": 90, "set": {"crrt.net_ultrafiltration_ml_h": 50}},
        {"at_min": 120, "set": {"crrt.flow_ml_min": 200}},
    ]
    result = course(read_mapping(RAW | {"crrt": FILTERING, "events": events}).case, minutes=180.0)
    assert result.attrs["converged"], result.attrs["message"]
    removed = result["fluid.removed_ml"].interp(time_min=[59.9, 62.0, 119.9, 180.0]).values
    assert removed == pytest.approx([100, 250, 250, 300], abs=1)
    cleared = result["effective_clearance_urea"].sel(time_min=[30.0, 100.0, 150.0], method="nearest").values
    assert cleared == pytest.approx([26.6, 0.0, 25.8], abs=0.5)
    urea = result["urea"].sel(time_min=[60.0, 119.0, 180.0], method="nearest").values
    assert urea[1] > urea[0] > urea[2]
    (said,) = [line for line in result.attrs["warnings"] if "pump and fluids stand still" in line]
    assert said.startswith("at 01:00")
    assert "until 02:00" in said


@pytest.mark.slow
def test_without_refill_all_that_is_filtered_leaves_the_blood():
    crrt = RAW["crrt"] | {"net_ultrafiltration_ml_h": 100}
    dry, filled = (follow(120.0, crrt=crrt, fluid={"capillary_refill": on}) for on in (False, True))
    assert change(dry, "fluid.plasma_ml") == pytest.approx(-200.0, abs=1e-6)
    assert change(dry, "fluid.refilled_ml") == 0.0
    assert -150.0 < change(filled, "fluid.plasma_ml") < 0.0
    assert dry["MAP"][-1] < filled["MAP"][-1]
    assert dry["haematocrit"][-1] > filled["haematocrit"][-1] > filled["haematocrit"][0]


@pytest.mark.parametrize(
    ("give", "sections", "said"),
    [
        ({"crystalloid_ml": 500}, {}, ["of crystalloid given in excess of losses"]),
        ({"albumin_ml": 100, "crystalloid_ml": 500}, {}, ["a half (Ernest 2001)"]),
        ({"albumin_ml": 100, "crystalloid_ml": 500}, AS_PEOPLE, []),
        (
            {"albumin_ml": 100, "crystalloid_ml": 500},
            {**AS_PEOPLE, "fluid": {"filtration_ml_min_mmHg": 10}},
            ["of crystalloid"],
        ),
        ({"crystalloid_ml": 500}, {"fluid": {"capillary_refill": False}}, []),
        (
            {"crystalloid_ml": 500},
            {"fluid": {"pericapillary_share": 0.12}},
            ["more of it stays than in patients"],
        ),
        (
            {"crystalloid_ml": 500},
            {"fluid": {"filtration_ml_min_mmHg": 6}},
            ["wall of 10 mL/min/mmHg (here 6)"],
        ),
        ({"crystalloid_ml": 500}, {"fluid": {"filtration_ml_min_mmHg": 2}}, []),
        (
            {"crystalloid_ml": 500},
            {"fluid": {"filtration_ml_min_mmHg": 1}},
            ["mmHg (as here), three quarters"],
        ),
        ({"red_cells_ml": 300}, {}, ["without the potassium"]),
        ({"bleed_ml": 150}, {}, []),
        ({"bleed_ml": 300, "blood_ml": 250}, {}, []),
        ({"blood_ml": 250}, {}, ["never raises the haematocrit"]),
        ({"bleed_ml": 100}, {"crrt": FILTERING}, ["net ultrafiltration", "removed without a reflex"]),
        (
            {"bleed_ml": 100},
            {"crrt": FILTERING, "regulation": {"baroreflex": 0.5}},
            ["net ultrafiltration"],
        ),
        (
            {"bleed_ml": 100},
            {"crrt": FILTERING, "fluid": {"filtration_ml_min_mmHg": 1.6}},
            ["removed without a reflex"],
        ),
        (
            {"bleed_ml": 100},
            {"crrt": FILTERING, "fluid": {"pericapillary_share": 0.12}},
            ["removed without a reflex"],
        ),
        (
            {"bleed_ml": 100},
            {"crrt": FILTERING, "fluid": {"capillary_refill": False}},
            ["removed without a reflex"],
        ),
        ({"bleed_ml": 300}, {}, ["of blood that is lost", "without a reflex"]),
        ({"bleed_ml": 300}, {"regulation": {"baroreflex": 1.0}}, ["of blood that is lost"]),
        ({"bleed_ml": 300}, {"fluid": {"capillary_refill": False}}, ["without a reflex"]),
    ],
)
def test_courses_say_what_of_a_gift_they_do_not_hold(give, sections, said):
    case = read_mapping(RAW | sections | {"events": [{"at_min": 1, "give": give, "over_min": 1}]}).case
    found = remarks_on_fluids(Timeline(case, 600.0))
    assert [words in sentence for words, sentence in zip(said, found, strict=True)] == [True] * len(said)


FRESH = {"dialysate_ml_h": 1000, "replacement_post_ml_h": 1000}
DIALYSING = {**FILTERING, "net_ultrafiltration_ml_h": 0, **FRESH}


@pytest.mark.parametrize(
    ("solutes", "minutes", "crrt", "said"),
    [
        ({}, 720.0, DIALYSING, True),
        ({}, 300.0, DIALYSING, False),
        ({}, 720.0, {**DIALYSING, "flow_ml_min": 0}, False),
        ({"acid_generation_mmol_h": 2.8}, 720.0, DIALYSING, False),
        ({"kidney_clearance_ml_min": 20}, 720.0, DIALYSING, False),
    ],
)
def test_a_long_dialysis_without_acid_is_said_to_end_too_alkaline(solutes, minutes, crrt, said):
    """Left out, a day of 2 L/h with 32 mmol/L ended at 28.1 in place of 27.0 mmol/L, three days at 31.2."""
    case = read_mapping(RAW | {"solutes": solutes, "crrt": crrt}).case
    sentences = [one for one in remarks_on_fluids(Timeline(case, 60.0 * minutes)) if "bicarbonate" in one]
    assert len(sentences) == said
    assert not said or "by up to 0.5 mmol/L in the end (2.0 L/h of fluid)" in sentences[0]
    without = {key: section for key, section in (RAW | {"crrt": crrt}).items() if key != "solutes"}
    assert not remarks_on_fluids(Timeline(read_mapping(without).case, 60.0 * minutes))


def test_a_reflex_that_an_event_switches_on_counts():
    events = [
        {"at_min": 1, "set": {"regulation.baroreflex": 1.0}},
        {"at_min": 5, "give": {"bleed_ml": 300}, "over_min": 5},
    ]
    case = read_mapping(RAW | {"regulation": {"baroreflex": 0}, "events": events}).case
    assert not any("without a reflex" in one for one in remarks_on_fluids(Timeline(case, 600.0)))


@pytest.mark.parametrize(
    ("wall", "regulation", "kept"),
    [(10.0, {}, (0.20, 0.05)), (2.0, {}, (0.60, 0.22)), (1.0, {"baroreflex": 1.0}, (0.79, 0.50))],
)
@pytest.mark.slow
def test_remarks_on_crystalloid_state_what_of_it_stays(wall, regulation, kept):
    events = [{"at_min": 0, "give": {"crystalloid_ml": 1000}, "over_min": 30}]
    sections = {"fluid": {"filtration_ml_min_mmHg": wall}, "regulation": regulation, "events": events}
    raw = {key: RAW[key] for key in ("format", "patient")} | {k: v for k, v in sections.items() if v}
    result = course(read_mapping(raw).case, minutes=61.0, every_min=10.0, outputs=["MAP"])
    stays = result["fluid.plasma_ml"].interp(time_min=[30.0, 60.0]) - result["fluid.plasma_ml"][0]
    np.testing.assert_allclose(stays / 1000.0, kept, atol=0.03)


@pytest.mark.slow
def test_courses_say_bicarbonate_and_haematocrit_beyond_their_limits():
    events = [{"at_min": 5, "give": {"bleed_ml": 300}, "over_min": 5}]
    sections = {"fluid": {"haematocrit": 0.20}, "solutes": {"bicarbonate_mmol_l": 9}, "events": events}
    warnings = follow(12.0, **sections).attrs["warnings"]
    (acid,) = [
        line
        for line in warnings
        if line.startswith("alarm: bicarbonate of the plasma below 10 mmol/L at 00:00")
    ]
    assert " mmol/L at worst): acidaemia" in acid
    (thin,) = [line for line in warnings if line.startswith("haematocrit of the blood below 0.21 at 00:00")]
    assert " at worst): haemoglobin 7 g/dL" in thin


@pytest.mark.slow
def test_courses_say_plasma_that_no_case_may_start_with():
    """Water alone is filtered, so that protein thickens."""
    crrt = RAW["crrt"] | {"net_ultrafiltration_ml_h": 1500}
    sections = {"crrt": crrt, "fluid": {"plasma_protein_g_dl": 9.5, "capillary_refill": False}}
    warnings = follow(12.0, **sections).attrs["warnings"]
    assert any(line.startswith("protein of the plasma") and "above 10 g/dL" in line for line in warnings)
    assert not any("above 10 g/dL" in line for line in follow(1.0, **sections).attrs["warnings"])


@pytest.mark.slow
def test_courses_call_for_help_where_haematocrit_and_protein_are_survived_by_few():
    """Hours at 0.68 and 2.2 g/dL had a warning at most."""
    thick = {"fluid": {"haematocrit": 0.68, "plasma_protein_g_dl": 2.2, "interstitial_protein_g_dl": 0.8}}
    warnings = follow(12.0, **thick).attrs["warnings"]
    (cells,) = [line for line in warnings if line.startswith("alarm: haematocrit of the blood")]
    assert cells.startswith("alarm: haematocrit of the blood above 0.65 at 00:00")
    assert "haemoglobin 22 g/dL, as in the worst capillary leak" in cells
    (protein,) = [line for line in warnings if line.startswith("alarm: protein of the plasma")]
    assert protein.startswith("alarm: protein of the plasma below 2.3 g/dL at 00:00")
    thin = {"fluid": {"haematocrit": 0.13, "plasma_protein_g_dl": 3.5, "interstitial_protein_g_dl": 1.2}}
    warnings = follow(12.0, **thin).attrs["warnings"]
    assert any("a third of patients died at 4.1 to 5 g/dL" in line for line in warnings)
    assert any("none of 21 patients in shock survived" in line for line in warnings)


def test_protein_that_leaves_a_drying_patient_is_remarked_on():
    """Three litres off, and nothing more removed: a third of the plasma's protein left within three days."""
    minutes = np.array([0.0, 600.0, 1200.0])
    states = {
        PROTEIN: np.array([235.0, 220.0, 190.0]), INTERSTITIAL_PROTEIN: np.array([217.0, 232.0, 262.0]),
        INTERSTITIUM: np.array([12000.0, 9800.0, 9900.0]),
    }  # fmt: skip
    (said,) = remarks_on_protein(minutes, states)
    assert said.startswith("from 20:00 more than 15 %")
    assert "(19 % at worst)" in said
    assert remarks_on_protein(minutes, states | {INTERSTITIUM: np.array([12000.0, 12500.0, 13000.0])}) == []
    assert remarks_on_protein(minutes[:2], {key: values[:2] for key, values in states.items()}) == []
    assert remarks_on_protein(minutes, {}) == []


def test_plasma_that_is_lost_after_the_last_removal_is_remarked_on():
    """Three litres off within 36 min: the mean arterial pressure went on falling for a day."""
    minutes = np.array([0.0, 40.0, 80.0, 840.0, 1620.0])
    states = {
        PROTEIN: np.array([213.0, 225.0, 224.0, 198.0, 191.0]),
        INTERSTITIAL_PROTEIN: np.array([227.0, 215.0, 216.0, 242.0, 249.0]),
        INTERSTITIUM: np.array([12590.0, 9955.0, 9760.0, 9883.0, 9919.0]),
        PLASMA: np.array([3553.0, 3187.0, 3382.0, 3259.0, 3223.0]),
        REMOVED: np.array([0.0, 3000.0, 3000.0, 3000.0, 3000.0]),
    }
    (said,) = remarks_on_protein(minutes, states)
    assert said.startswith("after the last removal of fluid, at 00:40, the plasma loses another 159 mL")
    assert "33 g of protein" in said
    early = {key: values[:3] for key, values in states.items()}
    filled = states | {INTERSTITIUM: states[INTERSTITIUM][0] + np.arange(5.0)}
    untouched = states | {REMOVED: np.zeros(5)}
    for quiet in (early, filled, untouched):
        assert remarks_on_protein(minutes[: len(quiet[PROTEIN])], quiet) == []


@pytest.mark.parametrize(
    ("sections", "to", "said"),
    [
        ({"drugs": {"levosimendan": 0.1}}, {"drugs.levosimendan": 0.0}, "a metabolite with a half-life"),
        ({"drugs": {"levosimendan": 0.05}}, {"drugs.levosimendan": 0.1}, ""),
        ({"drugs": {"milrinone": 0.3}, "solutes": {}}, {}, "milrinone leaves through the kidneys"),
        ({"drugs": {"milrinone": 0.3}, "solutes": {"kidney_clearance_ml_min": 60}}, {}, ""),
        ({"drugs": {"milrinone": 0.3}}, {}, ""),
        ({"drugs": {"noradrenaline": 0.1}}, {"drugs.noradrenaline": 0.3}, "plasma hardly moves"),
        ({"drugs": {"noradrenaline": 0.1}, "fluid": {"venular_tone": 1}}, {"drugs.noradrenaline": 0.3}, ""),
        ({"drugs": {"noradrenaline": 0.1}}, {"drugs.noradrenaline": 0.11}, ""),
    ],
)
def test_drugs_that_stay_longer_in_patients_are_said(sections, to, said):
    """Only the documentation said so: CO fell within hours of the end of levosimendan, silently."""
    patient = {"id": "x", "sex": "male", "age_years": 60, "heart_rate_bpm": 80}
    events = [{"at_min": 5, "set": to}] if to else []
    case = read_mapping({"format": 1, "patient": patient, **sections, "events": events}).case
    remarks = remarks_on_drugs(Timeline(case, 600.0))
    ours = [remark for remark in remarks if "plasma hardly" not in remark or "plasma hardly" in said]
    assert [said in remark for remark in ours] == ([True] if said else [])
