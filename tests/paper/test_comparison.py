import json
import math

import numpy as np
import pytest

from eclsim.paper.comparison import (
    Check,
    Explanation,
    Row,
    Verdict,
    at_least,
    at_most,
    printed_number,
    statement,
    within,
    worst,
)

SHOWN = Explanation("known", (within("with the reason taken away", 1.0, 1.05, 0.1),))
NO_LONGER_SHOWN = Explanation("known", (within("with the reason taken away", 1.0, 1.5, 0.1),))


def test_a_row_holds_up_to_its_tolerance_on_both_sides():
    assert within("a", 10.0, 10.5, 0.5).holds
    assert within("a", 10.0, 9.5, 0.5).holds
    assert not within("a", 10.0, 10.51, 0.5).holds


@pytest.mark.parametrize(
    "row", [within("a", 1.0, math.nan, 9.0), at_most("a", math.nan, 1.0), at_least("a", math.nan, 0.0)]
)
def test_a_number_that_is_none_never_holds(row: Row):
    assert not row.holds
    assert row.used == math.inf


def test_rows_of_array_numbers_are_plain_data():
    from eclsim.files import json_text
    from eclsim.validation.suite import validation_object

    rows = (
        within("a", np.float64(1.0), np.float64(1.0), np.float64(0.1)),
        at_most("b", np.float64(0.0), 1.0),
        at_least("c", np.float64(1.0), 0.5),
    )
    plain = json.loads(json_text(validation_object([Check("k", "t", "b", rows)])))
    assert [row["holds"] for row in plain["checks"][0]["rows"]] == [True, True, True]
    assert plain["checks"][0]["rows"][2]["high"] is None


def test_error_is_in_percent_of_the_size_of_the_expected_number():
    assert within("a", -50.0, -51.0, 2.0).percent == pytest.approx(-2.0)
    assert within("a", 0.0, 1.0, 2.0).percent is None


@pytest.mark.parametrize(
    ("row", "used"),
    [
        (within("a", 10.0, 10.1, 0.4), 0.25),
        (within("a", 10.0, 10.0, 0.0), 0.0),
        (at_most("a", 2e-9, 1e-8), 0.2),
        (at_most("a", 0.0, 0.0), 0.0),
        (at_most("a", 1.0, 0.0), math.inf),
        (at_least("a", 1.0, 0.999), 0.999),
        (at_least("a", 0.5, 0.999), 1.998),
        (Row("a", 20.0, 15.0, 25.0), 0.0),
        (Row("a", 30.0, 15.0, 25.0), 2.0),
    ],
)
def test_a_row_uses_a_share_of_its_tolerance(row: Row, used: float):
    assert row.used == pytest.approx(used)
    assert row.holds == (row.used <= 1.0)


def test_worst_row_takes_most_of_its_own_tolerance():
    small, large = within("small", 1.0, 1.09, 0.1), within("large", 100.0, 105.0, 50.0)
    assert worst([large, small]) is small


def test_an_explained_miss_is_a_miss_and_excused_only_where_the_bar_allows():
    rows = (within("good", 1.0, 1.0, 0.1), within("bad", 1.0, 2.0, 0.1, explanation=SHOWN))
    strict = Check("k", "t", "b", rows)
    allowed = Check("k", "t", "b", rows, explained_pass=True)
    assert [row.name for row in strict.missed] == [row.name for row in allowed.missed] == ["bad"]
    assert not strict.holds
    assert allowed.holds


def test_an_unexplained_miss_is_never_excused():
    rows = (within("bad", 1.0, 2.0, 0.1), within("known", 1.0, 2.0, 0.1, explanation=SHOWN))
    assert not Check("k", "t", "b", rows, explained_pass=True).holds


@pytest.mark.parametrize("explanation", [NO_LONGER_SHOWN, Explanation("claimed", ()), None])
def test_an_explanation_counts_only_while_its_evidence_holds(explanation: Explanation | None):
    row = within("bad", 1.0, 2.0, 0.1, explanation=explanation)
    assert row.explained == ""
    assert not Check("k", "t", "b", (row,), explained_pass=True).holds
    assert within("bad", 1.0, 2.0, 0.1, explanation=SHOWN).explained == "known"
    assert within("good", 1.0, 1.0, 0.1, explanation=SHOWN).explained == ""


def test_a_check_without_rows_does_not_hold():
    assert not Check("k", "t", "b", ()).holds


def pressure(ours: float, explained: float | None = None, *, other_data: bool = False) -> Row:
    return printed_number("3.3", "a pressure", "mmHg", 70.3, ours, decimals=1, explained=explained,
                          reason="blood", other_data=other_data)  # fmt: skip


@pytest.mark.parametrize(
    ("row", "verdict"),
    [
        (pressure(70.34), Verdict.AGREES),
        (pressure(71.0), Verdict.DIFFERS),
        (pressure(71.0, 70.3), Verdict.EXPLAINED),
        (pressure(71.0, 72.0), Verdict.DIFFERS),
        (pressure(71.0, other_data=True), Verdict.OTHER_DATA),
        (statement("3.3", "so it is", True), Verdict.AGREES),
        (statement("3.3", "so it is", False, "because", True), Verdict.EXPLAINED),
        (within("a", 1.0, 2.0, 0.1, explanation=SHOWN), Verdict.EXPLAINED),
        (within("a", 1.0, 2.0, 0.1, explanation=NO_LONGER_SHOWN), Verdict.DIFFERS),
    ],
)
def test_a_row_knows_what_the_comparison_came_to(row: Row, verdict: Verdict):
    assert row.verdict is verdict


def test_a_reason_is_shown_where_a_row_misses_and_counts_where_it_was_shown():
    assert pressure(70.34).reason == ""
    assert (pressure(71.0).reason, pressure(71.0).explained) == ("blood", "")
    assert (pressure(71.0, 70.3).reason, pressure(71.0, 70.3).explained) == ("blood", "blood")
    renamed = pressure(71.0, 70.3).because("volume")
    assert (renamed.explained, renamed.got_explained) == ("volume", 70.3)
    assert pressure(71.0).got_explained is None
