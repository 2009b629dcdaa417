"""Links and history: what is restored is what was shown, and nothing else gets in."""

import base64
import zlib

import pytest

from eclsim.app.knobs import connect, turn
from eclsim.app.state import (
    LARGEST_STATE,
    History,
    PageState,
    key_of,
    link_of,
    packed,
    preset_state,
    state_of,
    subject_of,
)
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import read_mapping
from eclsim.inputs.mistakes import CaseError


def zipped(content: bytes) -> str:
    return base64.urlsafe_b64encode(zlib.compress(content)).decode().rstrip("=")


@pytest.mark.parametrize("key", PRESETS)
def test_link_restores_the_state(key):
    state = preset_state(key).with_policy("patient_held")
    assert state_of(link_of(state)) == state
    opened = PageState(PRESETS[key].case(), origin="file", source="mine.toml")
    changed = opened.with_case(turn(opened.case, "patient.heart_rate_bpm", 77))
    assert state_of(link_of(changed)) == changed
    assert state_of(link_of(changed)).start == opened


def test_a_link_cannot_call_another_case_a_preset():
    state = PageState(PRESETS["lvad"].case(), origin="healthy")
    assert state_of(link_of(state)).changed
    assert state_of(packed({"v": 1, **state.as_object()})).start == preset_state("healthy")


def test_link_is_short_enough_for_a_message():
    assert len(link_of(PageState(PRESETS["paper"].case()))) < 1000


@pytest.mark.parametrize(
    "link",
    [
        "",
        "abc",
        "!!!",
        link_of(PageState(PRESETS["paper"].case()))[:-20],
        zipped(b"\xff\xfe"),
        packed([]),
        packed({"v": 3}),
        packed({"v": 2}),
        packed({"v": 2, "state": {**PageState(PRESETS["paper"].case()).as_object(), "verdict": "perfect"}}),
        packed({"v": 2, "state": {**PageState(PRESETS["paper"].case()).as_object(), "opened": 3}}),
        packed({"v": 1, "policy": "as_published", "case": {}}),
        packed({"v": 1, "policy": "as_published", "case": "no"}),
        packed({"v": 1, "policy": "other", "case": PRESETS["paper"].case().as_mapping()}),
        zipped(b"[" * 100_000),
        "A" * 9000,
    ],
)
def test_what_is_no_link_is_refused(link):
    with pytest.raises(CaseError):
        state_of(link)


FILED = PageState(PRESETS["paper"].case(), origin="file", source="mine.toml").as_object()
OTHER = PageState(PRESETS["lvad"].case(), origin="file", source="mine.toml").as_object()


@pytest.mark.parametrize(
    ("forged", "reason"),
    [
        ({"origin": "a preset of another version"}, "for a patient that this version does not have"),
        ({"origin": ["file"]}, "damaged"),
        ({"verdict": "good"}, "damaged"),  # of a fit that nobody made
        ({"source": "mine\u202e.toml"}, "damaged"),
        ({"source": "x" * 300}, "damaged"),
        ({"later": 1}, "from another version"),
        ({"opened": OTHER}, "inconsistent: it holds two patients"),
        ({"opened": {**FILED, "source": "yours.toml"}}, "inconsistent: it holds two patients"),
    ],
)
def test_a_forged_link_is_refused_in_one_sentence(forged, reason):
    """It was taken for something else, or what it said was left out, without a word."""
    assert state_of(packed({"v": 2, "state": FILED})).source == "mine.toml"
    with pytest.raises(CaseError) as refused:
        state_of(packed({"v": 2, "state": {**FILED, **forged}}))
    (mistake,) = refused.value.mistakes
    assert str(mistake) == f"the link is {reason}; allowed: a link copied from this page"


def test_a_long_name_of_a_file_comes_back_whole():
    state = PageState(PRESETS["paper"].case(), origin="file", source=f"{'f' * 80}, data point {'p' * 64}")
    assert state_of(link_of(state)) == state


def test_link_that_unpacks_to_too_much_is_refused():
    bomb = zipped(b" " * (50 * LARGEST_STATE))
    assert len(bomb) < 20_000
    with pytest.raises(CaseError, match="too l"):
        state_of(bomb[:7999] if len(bomb) > 8000 else bomb)


def test_link_with_an_impossible_value_names_it():
    case = PRESETS["paper"].case().as_mapping()
    case["ecmo"]["speed_rpm"] = -5
    with pytest.raises(CaseError, match=r"ecmo\.speed_rpm"):
        state_of(packed({"v": 1, "policy": "as_published", "case": case}))


def test_link_with_a_flow_that_no_speed_was_solved_for_is_refused():
    case = PRESETS["paper"].case().as_mapping()
    case["ecmo"]["flow_l_min"] = 3.0
    del case["ecmo"]["speed_rpm"]
    with pytest.raises(CaseError, match="pump flow instead of a speed"):
        state_of(packed({"v": 1, "policy": "as_published", "case": case}))


def at_speed(state: PageState, rpm: float) -> PageState:
    return state.with_case(turn(state.case, "ecmo.speed_rpm", rpm))


def test_undo_takes_back_one_turn_of_a_knob_not_one_step():
    first = PageState(PRESETS["paper"].case())
    history = History(first)
    for k in range(10):
        history.change(at_speed(first, 3000 + k), "ecmo.speed_rpm", 0.1 * k)
    history.change(at_speed(first, 4000), "ecmo.speed_rpm", 10.0)
    assert history.undo()
    assert history.now == at_speed(first, 3009)
    assert history.undo()
    assert history.now == first
    assert not history.undo()
    assert history.redo()
    assert history.now == at_speed(first, 3009)


def test_a_change_after_undo_forgets_what_was_undone():
    first = PageState(PRESETS["paper"].case())
    history = History(first)
    history.change(at_speed(first, 3000), "ecmo.speed_rpm", 0.0)
    history.undo()
    history.change(at_speed(first, 2000), "ecmo.speed_rpm", 9.0)
    assert not history.redo()


def test_reset_leads_to_the_patient_that_is_shown_also_after_undo():
    first, other = PageState(PRESETS["paper"].case()), PageState(PRESETS["lvad"].case())
    history = History(first)
    history.change(at_speed(first, 3000), "ecmo.speed_rpm", 0.0)
    history.change(other, "", 5.0)
    assert history.now.start == other
    assert history.undo()
    assert history.now.start == first
    assert history.now.changed


def test_a_knob_that_is_turned_back_changes_nothing():
    first = PageState(PRESETS["paper"].case())
    back = at_speed(at_speed(first, 3000), first.case.ecmo.speed_rpm)
    assert back == first
    assert not back.changed


def test_the_patient_is_the_same_turned_fitted_or_not_and_another_one_is_not():
    first, other = PageState(PRESETS["paper"].case()), PageState(PRESETS["lvad"].case())
    assert subject_of(at_speed(first, 3000)) == subject_of(first) != subject_of(other)
    fitted = PageState(at_speed(first, 3000).case, origin="fit", subject=subject_of(first))
    assert subject_of(at_speed(fitted, 2500)) == subject_of(first)


def test_reflexes_that_are_switched_on_rest_at_the_pressures_of_the_patient_as_opened():
    opened = preset_state("healthy")
    assert opened.computed_case is opened.case
    on = opened.with_case(connect(opened.case, "regulation"))
    weak = on.with_case(turn(on.case, "parameters.Emaxlv", 0.6))
    assert weak.computed_case.at_rest() == opened.case
    assert state_of(link_of(weak)).computed_case.at_rest() == opened.case
    own = weak.with_case(
        read_mapping(weak.case.as_mapping() | {"regulation": {"baroreflex": 1.0, "set_point_mmHg": 80}}).case
    )
    assert own.computed_case is own.case


def test_equal_cases_with_other_set_points_have_other_results():
    """A beat of the one counted as that of the other: 88 mmHg for a patient with 67."""
    healthy = preset_state("healthy")
    reflexes = healthy.with_case(connect(healthy.case, "regulation"))
    turned = reflexes.with_case(turn(reflexes.case, "parameters.Rmc", 0.5))
    opened = PageState(turn(healthy.case, "parameters.Rmc", 0.5), origin="file")
    other = opened.with_case(connect(opened.case, "regulation"))
    assert turned.case == other.case
    assert key_of(turned) != key_of(other)
    assert key_of(turned) == key_of(state_of(link_of(turned)))
    assert key_of(opened) == key_of(healthy.with_case(opened.case))  # without reflexes nothing differs
