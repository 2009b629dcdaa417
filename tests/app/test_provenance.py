"""The page says where its numbers come from: preset, patient, fitted or not, changed or not."""

import pytest

from eclsim.app.knobs import connect, turn
from eclsim.app.provenance import MOST_NAMED, changes, kind_of, provenance, title_of
from eclsim.app.state import PageState, preset_state
from eclsim.cases.case import Measurements
from eclsim.cases.presets import PRESETS

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
    assert message["measured"] == {"MAP": 75.0, "CO": 3.0}


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


def test_what_was_changed_is_named_and_a_long_list_is_cut():
    state = preset_state("healthy")
    case = connect(state.case, "ecmo")
    assert changes(state.with_case(case)) == ["ECMO connected"]
    for key in ("Emaxlv", "Emaxrv", "Rmc", "Rpmc", "Csart"):
        case = turn(case, f"parameters.{key}", 0.47)
    named = changes(state.with_case(case))
    assert len(named) == MOST_NAMED + 1
    assert named[-1] == "2 more"
