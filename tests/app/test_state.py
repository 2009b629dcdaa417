"""Links and history: what is restored is what was shown, and nothing else gets in."""

import base64
import json
import zlib

import pytest

from eclsim.app.knobs import turn
from eclsim.app.state import LARGEST_STATE, History, PageState, link_of, state_of
from eclsim.patients.mistakes import CaseError
from eclsim.patients.presets import PRESETS


def packed(content: object) -> str:
    plain = content if isinstance(content, bytes) else json.dumps(content).encode()
    return base64.urlsafe_b64encode(zlib.compress(plain)).decode().rstrip("=")


@pytest.mark.parametrize("key", PRESETS)
def test_link_restores_the_state(key):
    state = PageState(PRESETS[key].case(), "patient_held", key)
    assert state_of(link_of(state)) == state


def test_link_is_short_enough_for_a_message():
    assert len(link_of(PageState(PRESETS["paper"].case()))) < 1000


@pytest.mark.parametrize(
    "link",
    [
        "",
        "abc",
        "!!!",
        link_of(PageState(PRESETS["paper"].case()))[:-20],
        packed(b"\xff\xfe"),
        packed([]),
        packed({"v": 2}),
        packed({"v": 1, "policy": "as_published", "case": {}}),
        packed({"v": 1, "policy": "as_published", "case": "no"}),
        packed({"v": 1, "policy": "other", "case": PRESETS["paper"].case().as_mapping()}),
        packed(b"[" * 100_000),
        "A" * 9000,
    ],
)
def test_what_is_no_link_is_refused(link):
    with pytest.raises(CaseError):
        state_of(link)


def test_link_that_unpacks_to_too_much_is_refused():
    bomb = packed(b" " * (50 * LARGEST_STATE))
    assert len(bomb) < 20_000
    with pytest.raises(CaseError, match="too l"):
        state_of(bomb[:7999] if len(bomb) > 8000 else bomb)


def test_link_with_an_impossible_value_names_it():
    case = PRESETS["paper"].case().as_mapping()
    case["ecmo"]["speed_rpm"] = -5
    with pytest.raises(CaseError, match=r"ecmo\.speed_rpm"):
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


def test_another_patient_is_where_reset_leads():
    history = History(PageState(PRESETS["paper"].case()))
    other = PageState(PRESETS["lvad"].case())
    history.load(other, 0.0)
    assert history.start == other
    assert history.undo()
    assert history.now != other
