"""The page says where its numbers come from: preset, patient, fitted or not, changed or not."""

import pytest

from eclsim.app.course import with_event
from eclsim.app.files import export, parse_file
from eclsim.app.knobs import connect, turn
from eclsim.app.provenance import (
    MOST_NAMED,
    changes,
    kind_of,
    marked_id,
    measured_values,
    opened_state,
    provenance,
    title_of,
)
from eclsim.app.state import PageState, preset_state
from eclsim.cases.case import Measurements
from eclsim.cases.fit_mark import with_mark
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import case_text
from eclsim.inputs.sections import looks_identifiable

PAPER = PRESETS["paper"].case()
UNFITTED = PAPER.model_copy(update={"parameters": {}, "measurements": Measurements(MAP=75.0, CO=3.0)})


@pytest.mark.parametrize("key", PRESETS)
def test_a_preset_keeps_its_name_only_while_nothing_is_turned(key):
    state = preset_state(key)
    assert title_of(state) == PRESETS[key].name
    turned = state.with_case(turn(state.case, "patient.heart_rate_bpm", 91))
    assert title_of(turned) == f"{PRESETS[key].name}, changed"
    assert "Heart rate" in provenance(turned)["text"]
    assert title_of(state.with_policy("patient_held")).endswith(", changed")


def test_a_row_of_a_cohort_that_is_not_fitted_is_not_the_patient():
    message = provenance(PageState(UNFITTED, origin="file", source="ward.csv"))
    assert message["badge"] == "Not fitted"
    assert message["level"] == "warning"
    assert "ward.csv" in message["text"]
    assert measured_values(PageState(UNFITTED, origin="file"))["measured"] == {"MAP": 75.0, "CO": 3.0}
    measured = UNFITTED.model_copy(update={"measurements": Measurements(CVP=14.0)})
    said = measured_values(PageState(measured, origin="file"))["measured"]
    assert said == {"CVP": 14.0, "right_atrial_pressure": 14.0}, (
        "the tile and the row with limits show it too"
    )


@pytest.mark.parametrize(
    ("state", "kind", "level"),
    [
        (PageState(PAPER, origin="file", source="p.toml"), "parameters", "ok"),
        (PageState(PAPER, origin="fit", verdict="good"), "fit", "ok"),
        (PageState(PAPER, origin="fit", verdict="poor"), "fit", "warning"),
        (PageState(PAPER, origin="fit"), "fit", "warning"),
        (PageState(PAPER, origin="posterior", source="posterior.nc"), "posterior", "warning"),
    ],
)
def test_where_the_parameters_come_from_is_said(state, kind, level):
    assert kind_of(state) == kind
    assert provenance(state)["level"] == level
    assert state.source in provenance(state)["text"]
    assert state.verdict in provenance(state)["text"].lower()
    assert ("poor" in provenance(state)["badge"].lower()) == (state.verdict == "poor")


@pytest.mark.parametrize(
    ("state", "badge"),
    [
        (PageState(PAPER, origin="fit", verdict="poor"), "Poor fit, changed"),
        (PageState(PAPER, origin="fit", verdict="doubtful"), "Doubtful fit, changed"),
        (PageState(UNFITTED, origin="file", source="ward.csv"), "Not fitted, changed"),
        (PageState(PAPER, origin="fit", verdict="good"), "Changed"),
        (preset_state("paper"), "Changed"),
    ],
)
def test_a_turned_knob_hides_no_doubt_about_the_fit(state, badge):
    assert provenance(state.with_case(turn(state.case, "patient.heart_rate_bpm", 91)))["badge"] == badge


def test_the_verdict_stands_before_all_else_that_is_said_of_a_fit():
    """The line may be cut off where it is long: what is seen of it must not reassure."""
    filled = turn(PAPER, "volume_ml", 300)
    said = provenance(PageState(filled, origin="fit", source="p.toml", verdict="poor"))["text"]
    assert said.index("POOR") < min(said.index("as set"), said.index("p.toml"))


MEASURED = Measurements(MAP=75.0, CO=3.0)


@pytest.mark.parametrize(
    ("state", "marks", "badge", "level"),
    [
        (PageState(PAPER, origin="fit", verdict="poor"), " (poor fit)", "Poor fit", "warning"),
        (PageState(PAPER, origin="fit", verdict="doubtful"), " (doubtful fit)", "Doubtful fit", "warning"),
        (PageState(PAPER, origin="fit", verdict="good"), " (fitted)", "Fitted", "ok"),
        (PageState(PAPER, origin="fit"), " (fit without a verdict)", "Fitted", "warning"),
        (PageState(PAPER, origin="posterior", source="p.nc"), " (central draw)", "Posterior", "warning"),
        (PageState(UNFITTED, origin="file", source="ward.csv"), "", "Not fitted", "warning"),
        (PageState(PAPER, origin="file", source="p.toml"), "", "Case file", "ok"),
        (preset_state("paper"), "", "Case file", "ok"),
    ],
)
def test_a_file_does_not_wash_off_how_a_patient_was_fitted(state, marks, badge, level):
    """Saved, opened, saved and opened again; and once more after a knob was turned."""
    for turned in (False, True):
        if turned:
            state = state.with_case(turn(state.case, "parameters.Rmc", 0.77))
            marks = " (not fitted, changed)" if state.start.case.parameters == {} else with_changed(marks)
        for _ in range(2):
            content = export(state, "case")[1]
            (saved,) = (case for _, case in parse_file("mine.toml", content).cases)
            assert saved.patient.id == f"{PAPER.patient.id}{marks}"
            state = opened_state(saved, "mine.toml")
            said = provenance(state)
            assert (said["badge"], said["level"]) == (badge, "warning" if turned else level)
            assert "mine.toml" in said["text"]
            assert ("Changed by hand" in said["text"]) == turned
            known = measured_values(state)
            assert known["measured"] == measured_values(state.start)["measured"]
            assert known["measured_before"] == turned
        assert content.decode().startswith("# ")


def with_changed(marks):
    return marks.replace(")", ", changed)") if marks else " (changed)"


@pytest.mark.parametrize(
    ("level", "badge", "said"),
    [
        ("good", "Fitted", "good"),
        ("doubtful", "Doubtful fit", "doubtful"),
        ("poor", "Poor fit", "POOR, not to"),
    ],
)
def test_a_case_that_was_fitted_on_the_command_line_says_how_well(level, badge, said):
    """`eclsim identify` writes the verdict into its case files: it stands where the numbers come from."""
    written = with_mark(case_text(PAPER.model_copy(update={"measurements": MEASURED})), level, "why")
    for content, changed in (
        (written, False),
        (written.replace("speed_rpm = 3425", "speed_rpm = 3000"), True),
    ):
        opened = parse_file("P01.toml", content.encode())
        assert not [remark for remark in opened.remarks if "fit" in remark]
        ((_, case),) = opened.cases
        about = provenance(opened_state(case, opened.name, opened.fit))
        assert about["badge"] == badge
        assert about["level"] == ("warning" if changed or level != "good" else "ok")
        assert said in about["text"]
        assert "does not say" not in about["text"]
        assert ("Changed by hand" in about["text"]) == changed
    again = export(opened_state(case, opened.name, opened.fit), "case")[1]
    ((_, saved),) = parse_file("again.toml", again).cases
    assert provenance(opened_state(saved, "again.toml"))["badge"] == badge


def test_a_file_that_does_not_say_whether_it_was_fitted_is_not_called_fitted():
    case = PAPER.model_copy(update={"measurements": MEASURED})
    said = provenance(opened_state(case, "p.toml"))
    assert said["level"] == "warning"
    assert "does not say" in said["text"]


@pytest.mark.parametrize(
    "name", ["P01 (ward 3)", "P01 (fitted, poor fit)", " (fitted)", "P01 (", "P01 ()", "P01"]
)
def test_other_names_have_no_marks(name):
    case = PAPER.model_copy(update={"patient": PAPER.patient.model_copy(update={"id": name})})
    state = opened_state(case, "p.toml")
    assert state.case == case
    assert state.origin == "file"


def test_what_is_turned_in_a_section_that_was_switched_on_since_is_named():
    state = preset_state("healthy")
    regulated = connect(state.case, "regulation")
    assert changes(state.with_case(regulated)) == ["Reflexes switched on"]
    weaker = turn(regulated, "regulation.baroreflex", 0.5)
    assert changes(state.with_case(weaker)) == ["Reflexes switched on", "Baroreflex gain"]
    assert "Baroreflex gain" in provenance(state.with_case(weaker))["text"]
    for order in (("ecmo", "gas"), ("gas", "ecmo")):
        case = connect(connect(state.case, order[0]), order[1])
        named = ["ECMO connected", "Blood gases switched on"]
        assert changes(state.with_case(case)) == named
        faster = turn(case, "ecmo.speed_rpm", 4000)
        assert changes(state.with_case(faster)) == [*named, "ECMO Pump speed"]


def test_what_was_changed_is_named_and_a_long_list_is_cut():
    state = preset_state("healthy")
    case = connect(state.case, "ecmo")
    assert changes(state.with_case(case)) == ["ECMO connected"]
    for key in ("Emaxlv", "Emaxrv", "Rmc", "Rpmc", "Csart"):
        case = turn(case, f"parameters.{key}", 0.47)
    named = changes(state.with_case(case))
    assert len(named) == MOST_NAMED + 1
    assert named[-1] == "2 more"


def test_measurements_are_of_the_settings_at_which_they_were_made():
    """ECMO 6.12 stood beside "meas. 4.60", measured at another speed of the pump."""
    case = PAPER.model_copy(update={"measurements": MEASURED})
    state = PageState(case, origin="fit", verdict="good")
    assert not measured_values(state)["measured_before"]
    faster = state.with_case(turn(case, "ecmo.speed_rpm", 3800))
    assert measured_values(faster) == {"measured": {"MAP": 75.0, "CO": 3.0}, "measured_before": True}
    assert measured_values(state.with_policy("patient_held"))["measured_before"]
    later = state.with_case(with_event(case, {"at_min": 30.0, "set": {"ecmo.speed_rpm": 3000.0}}))
    assert not measured_values(later)["measured_before"], "what happens later changes nothing at the start"


@pytest.mark.parametrize("measured", [True, False])
def test_a_file_says_that_its_measurements_are_of_other_settings(measured):
    case = PAPER.model_copy(update={"measurements": MEASURED if measured else None})
    state = PageState(case, origin="file", source="p.toml")
    turned = state.with_case(turn(case, "ecmo.speed_rpm", 3800))
    words = "do not run eclsim identify on it"
    assert words not in export(state, "case")[1].decode()
    content = export(turned, "case")[1]
    assert (words in content.decode().partition("format = ")[0]) == measured
    ((_, saved),) = parse_file("mine.toml", content).cases
    again = opened_state(saved, "mine.toml")
    assert measured_values(again)["measured_before"]
    assert (words in export(again, "case")[1].decode()) == measured


@pytest.mark.parametrize(
    ("origin", "verdict"),
    [*(("fit", verdict) for verdict in ("good", "doubtful", "poor", "")), ("posterior", ""), ("file", "")],
)
@pytest.mark.parametrize("is_changed", [False, True])
@pytest.mark.parametrize(("name", "is_private"), [("BedVV", False), ("Miller, Anna", True)])
def test_a_mark_in_a_file_is_no_name_and_hides_none(origin, verdict, is_changed, name, is_private):
    """The page's own "BedVV (fitted, changed)" was taken for a surname and a first name."""
    person = PAPER.patient.model_copy(update={"id": name})
    state = PageState(PAPER.model_copy(update={"patient": person}), origin=origin, verdict=verdict)
    if is_changed:
        state = state.with_case(turn(state.case, "patient.heart_rate_bpm", 91))
    assert (marked_id(state) != name) == (origin != "file" or is_changed)
    assert looks_identifiable(marked_id(state)) is is_private
    assert looks_identifiable(f"{name} (not fitted, changed)") is is_private
