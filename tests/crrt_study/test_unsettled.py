"""Beats that were not found: no place, limit, median or share is made from them, and it is said."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from crrt_failures import ALL, forget, with_failures
from eclsim.crrt_study import limits as crrt_limits
from eclsim.crrt_study.beats import StudyCircuits, study_circuits
from eclsim.crrt_study.limits import (
    BROKEN_ABOVE,
    KEPT_TO_THE_END,
    NEVER,
    NOT_KNOWN,
    NOT_KNOWN_ABOVE,
    limit_range,
    uncertainty,
)
from eclsim.crrt_study.ranking import first_choice
from eclsim.crrt_study.schemes import select_schemes
from eclsim.crrt_study.study import crrt_study
from eclsim.orbit.status import Status
from eclsim.paper.crrt import paper_case

KEPT, AT_THE_LIMIT, BROKEN, UNKNOWN = 7.3, 0.0, -4.1, np.nan
SPEEDS = np.array([1000.0, 1777.7, 3425.0, 4100.3, 5000.0])
FLOWS = np.array([0.3, 1.2, 3.7, 4.6, 6.0])
PATTERNS = [
    p for n in (1, 2, 3, 5) for p in itertools.product((KEPT, AT_THE_LIMIT, BROKEN, UNKNOWN), repeat=n)
]


def test_what_is_said_of_a_limit_holds_for_every_pattern_of_margins():
    for pattern in PATTERNS:
        margins = np.array(pattern)
        n, known = len(margins), np.isfinite(margins)
        result = limit_range(SPEEDS[:n], np.where(known, FLOWS[:n], np.nan), margins)
        keeping = np.flatnonzero(known & (margins >= 0.0))
        if not len(keeping):
            assert result.state == (NEVER if known.all() else NOT_KNOWN), pattern
            assert np.isnan(result.flow)
            continue
        last = keeping[-1]
        after = margins[last + 1 :]
        expected = (
            KEPT_TO_THE_END if not len(after)
            else BROKEN_ABOVE if known[last + 1]
            else NOT_KNOWN_ABOVE
        )  # fmt: skip
        assert result.state == expected, pattern
        assert FLOWS[last] <= result.flow <= (FLOWS[last + 1] if expected == BROKEN_ABOVE else FLOWS[last])
        assert result.speed >= SPEEDS[last]
        assert result.flow_at_most >= result.flow
        assert result.broken_below == tuple(SPEEDS[:last][margins[:last] < 0.0])


def test_a_limit_that_is_kept_at_one_studied_speed_alone_is_kept_up_to_it():
    result = limit_range(SPEEDS, FLOWS, np.array([BROKEN, BROKEN, AT_THE_LIMIT, BROKEN, BROKEN]))
    assert (result.state, result.speed) == (BROKEN_ABOVE, 3425.0)
    assert result.flow == pytest.approx(3.7)


@pytest.fixture(scope="module")
def failing():
    """A left heart so weak that at 6000 rpm, as published, only with scheme h its valves open."""
    case = paper_case()
    case = case.model_copy(update={"parameters": case.parameters | {"Emaxlv": 1.0}})
    return crrt_study(case, schemes="a,d,h", speeds="5000,6000")


def test_a_beat_that_was_not_found_has_no_number_and_a_reason(failing):
    one = failing.means.sel(policy="as_published", scheme="d", speed=6000.0)
    assert str(one["status"].item()) == "one_of_many"
    numbers = [name for name, values in one.data_vars.items() if values.dtype.kind == "f"]
    assert len(numbers) > 50
    assert not any(np.isfinite(one[name]) for name in numbers)
    assert np.isnan(failing.without_crrt["PF"].sel(policy="as_published", speed=6000.0))
    assert not failing.converged
    messages = {(one.policy, one.place, one.speeds, one.status) for one in failing.unsettled}
    assert ("as_published", "scheme d", (6000.0,), "one_of_many") in messages
    assert ("as_published", "without CRRT", (6000.0,), "one_of_many") in messages


def test_medians_and_variations_are_of_the_schemes_that_are_known(failing):
    top = failing.summary.sel(policy="as_published", speed=6000.0)
    known = failing.means["Psart"].sel(policy="as_published", speed=6000.0).dropna("scheme")
    assert int(top["schemes_known"]) == known.sizes["scheme"] < 3
    assert float(top["Psart_median"]) == pytest.approx(float(known.median()))
    assert top["Psart_highest"].item() == ""
    assert int(failing.summary["schemes_known"].sel(policy="as_published", speed=3425.0)) == 3


def test_limits_are_never_kept_throughout_where_the_top_speeds_failed(study):
    gone = with_failures(study, [("as_published", "h", v) for v in (4500.0, 5000.0)])
    one = gone.limits.sel(policy="as_published", scheme="h", limit="access_alarm")
    assert one["state"].item() == NOT_KNOWN_ABOVE
    assert not one["kept_throughout"]
    assert float(one["largest_speed"]) == 4000.0
    ranked = next(r for r in gone.ranking["as_published"] if r.letter == "h")
    assert not ranked.throughout
    message = "; ".join(ranked.reasons)
    assert "(4000 rpm); above that it is not known: no steady beat at 4500 and 5000 rpm" in message
    assert "the native heart ejects next to nothing" in message
    whole = study.limits.sel(policy="as_published", scheme="h", limit="access_alarm")
    assert whole["kept_throughout"]
    assert whole["state"].item() == KEPT_TO_THE_END


def test_a_limit_is_not_interpolated_across_a_missing_beat(study):
    """d breaks 190 mmHg of access pressure between 4000 and 4500 rpm."""
    gone = with_failures(study, [("as_published", "d", 4500.0)])
    one = gone.limits.sel(policy="as_published", scheme="d", limit="access_190")
    flows = study.means["PF"].sel(policy="as_published", scheme="d")
    assert one["state"].item() == NOT_KNOWN_ABOVE
    assert float(one["largest_flow"]) == float(flows.sel(speed=4000.0))
    assert float(one["flow_at_most"]) == float(flows.sel(speed=5000.0))


def test_a_scheme_without_a_beat_at_the_speed_of_the_case_has_no_place(study):
    gone = with_failures(study, [("as_published", "d", 3425.0)], "not_converged")
    ranking = gone.ranking["as_published"]
    last = ranking[-1]
    assert (last.letter, last.rank, last.places, last.alarms_kept) == ("d", None, None, None)
    assert last.why_no_rank == "no place: no steady beat at 3425 rpm (the search for it did not converge)"
    assert [one.rank for one in ranking[:-1]] == list(range(1, 9))
    assert first_choice(ranking) is None
    assert first_choice(gone.ranking["patient_held"]).letter == "d"


def test_a_place_that_a_missing_beat_decides_is_a_range_and_not_a_rank(study):
    """g and a follow d by the flow that keeps their limits: 4.1 L/min, near 3700 rpm."""
    gone = with_failures(study, [("as_published", "g", v) for v in (4000.0, 4500.0, 5000.0)])
    places = {one.letter: (one.rank, one.places) for one in gone.ranking["as_published"]}
    assert places["g"] == (None, (1, 3))
    assert places["d"] == (None, (1, 2))
    assert places["h"] == (6, (6, 6)), "lines below the atmosphere come last whatever g keeps"
    assert first_choice(gone.ranking["as_published"]) is None
    may_be_first = [one for one in gone.ranking["as_published"] if one.places and one.places[0] == 1]
    assert {one.letter for one in may_be_first} == {"d", "g"}
    why = {one.letter: one.why_no_rank for one in gone.ranking["as_published"]}
    assert why["g"] == "place 1 to 3: the ECMO flow up to which it keeps its limits is not known"
    assert why["d"] == "place 1 to 2: the ECMO flow up to which scheme g keeps its limits is not known"


def test_no_order_is_given_where_nothing_is_known(study):
    gone = with_failures(study, [(policy, ALL, ALL) for policy in study.policies])
    for ranking in gone.ranking.values():
        assert {(one.rank, one.places) for one in ranking} == {(None, None)}
    assert set(gone.limits["state"].values.ravel()) == {NOT_KNOWN}
    assert int(gone.summary["schemes_known"].max()) == 0


def test_the_beats_without_crrt_count_among_those_not_found(study):
    single = study.without_crrt.copy(deep=True)
    single["status"] = single["status"].astype(object)
    forget(single, {"policy": "as_published", "speed": 5000.0}, "not_converged")
    gone = replace(study, without_crrt=single)
    assert [one.sentence for one in gone.unsettled] == [
        "without CRRT: no steady beat at 5000 rpm (the search for it did not converge)"
    ]
    assert not gone.converged


class Losing(StudyCircuits):
    """A circuits on which the beats of the last sample are not found."""

    def run(self, speeds, policy, keep=(), patient_volume_ml=None, patients=None):
        result = super().run(speeds, policy, keep, patient_volume_ml, patients)
        last = np.arange(len(result.status)) % 4 == 3
        statistics, values = (np.where(last, np.nan, table) for table in (result.statistics, result.values))
        status = np.where(last, Status.NO_EJECTION, result.status)
        return replace(result, statistics=statistics, values=values, status=status)


def test_the_share_of_samples_without_a_beat_is_told(study):
    made = study_circuits(paper_case(), select_schemes("g,h"), 200.0)
    circuits = Losing(made.circuit, made.without, made.values, made.nodes, made.schemes)
    samples = {"Dcrrttuout": [0.3175, 0.3175, 0.2, 0.3175]}
    doubt = uncertainty(circuits, 3425.0, "as_published", samples)
    one = doubt.sel(scheme="g", limit="return_alarm")
    assert float(one["settled"]) == 0.75
    assert float(one["probability_kept"]) == pytest.approx(2.0 / 3.0)
    assert (float(one["probability_at_least"]), float(one["probability_at_most"])) == (0.5, 0.75)
    whole = replace(study, uncertainty=doubt)
    assert whole.samples_without_a_beat == {"g": 1, "h": 1}
    assert not whole.converged


def test_limits_named_in_words_speak_of_one_limit_or_of_all(study):
    message = study.limits["in_words"].sel(policy="as_published", scheme="d")
    assert str(message.sel(limit="crrt").item()).startswith("keeps its limits up to 4.6 L/min")
    assert str(message.sel(limit="access_190").item()).startswith("keeps it up to")
    assert crrt_limits.limit_range_text(limit_range(SPEEDS, FLOWS, np.full(5, BROKEN)), "") == (
        "keeps its limits at no speed studied"
    )
    lower = limit_range(SPEEDS, FLOWS, np.array([BROKEN, KEPT, KEPT, KEPT, KEPT]))
    assert crrt_limits.limit_range_text(lower, "").endswith("the largest flow studied; broken at 1000 rpm")
