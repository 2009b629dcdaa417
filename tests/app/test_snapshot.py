"""What a browser keeps of its tab comes back as it was, and nothing else gets in."""

import pytest

from eclsim.app.knobs import turn
from eclsim.app.state import (
    LONGEST_SNAPSHOT,
    MOST_SAVED,
    MOST_UNDONE,
    History,
    Moment,
    PageState,
    Snapshot,
    packed,
    preset_state,
    read_snapshot,
)
from eclsim.cases.presets import PRESETS
from eclsim.inputs.mistakes import CaseError

FIRST = PageState(PRESETS["paper"].case(), origin="file", source="mine.toml")


def at_speed(rpm: float) -> PageState:
    return FIRST.with_case(turn(FIRST.case, "ecmo.speed_rpm", rpm))


def test_undo_redo_pinned_and_saved_come_back():
    history = History(preset_state("healthy"))
    for k, state in enumerate((FIRST, at_speed(3000), at_speed(3100))):
        history.change(state, "", float(k))
    history.undo()
    moments = (Moment(30.5, 60), Moment())
    kept = Snapshot(history, FIRST, (at_speed(2000), preset_state("lvad")), Moment(1.5, 2), moments)
    result = read_snapshot(kept.packed())
    assert result.history.now == at_speed(3000)
    assert result.history.past == [preset_state("healthy"), FIRST]
    assert result.history.future == [at_speed(3100)]
    assert (result.pinned, result.saved) == (kept.pinned, kept.saved)
    assert (result.pinned_at, result.saved_at) == (kept.pinned_at, kept.saved_at)
    assert result.history.now.start == FIRST


def test_a_long_history_is_cut_and_stays_short():
    history = History(FIRST)
    for k in range(100):
        history.change(at_speed(2000 + k), "", float(k))
    kept = Snapshot(history, FIRST, tuple(at_speed(3000 + k) for k in range(MOST_SAVED))).packed()
    assert len(kept) < LONGEST_SNAPSHOT / 10
    assert read_snapshot(kept).history.past == history.past[-MOST_UNDONE:]


STATE = FIRST.as_object()
GOOD = {"v": 1, "states": [STATE], "now": 0, "past": [], "future": [], "pinned": None, "saved": []}


@pytest.mark.parametrize(
    "change",
    [
        {"v": 2}, {"states": 3}, {"states": []}, {"states": [STATE] * 1000}, {"now": -1}, {"now": 1},
        {"now": True}, {"now": None}, {"past": [0] * (MOST_UNDONE + 1)}, {"past": "no"}, {"pinned": "no"},
        {"saved": [0] * (MOST_SAVED + 1)}, {"saved": [9]}, {"states": [{**STATE, "policy": "other"}]},
        {"states": [{**STATE, "case": {}}]}, {"states": [None]}, {"pinned_at": 3}, {"pinned_at": [61, 60]},
        {"pinned_at": [-1, 60]}, {"pinned_at": [True, 2]}, {"pinned_at": [1, 1e9]}, {"pinned_at": ["1", 2]},
        {"saved_at": [[0, 0]]}, {"saved_at": "no"}, {"pinned_at": [float("nan"), 60]},
    ],
)  # fmt: skip
def test_what_is_no_kept_tab_is_refused(change):
    assert read_snapshot(packed(GOOD)).history.now == FIRST
    with pytest.raises(CaseError):
        read_snapshot(packed(GOOD | change))


@pytest.mark.parametrize("text", ["", "abc", "!!!", "A" * (LONGEST_SNAPSHOT + 1), packed([1])])
def test_what_is_damaged_is_refused(text):
    with pytest.raises(CaseError):
        read_snapshot(text)
