"""What the study says in words, the same on the page, in the terminal and in JSON."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from eclsim.crrt_study.ranking import best_known, candidates, first_choice
from eclsim.crrt_study.unknown_beats import listed, no_beat
from eclsim.orbit.model import POLICY_WORDS

if TYPE_CHECKING:
    from eclsim.crrt_study.ranking import Ranked
    from eclsim.crrt_study.study import CrrtStudy

IN_ANOTHER_POLICY = {
    "as_published": "as published, where the patient's own blood fills the circuits",
    "patient_held": "when the circuits are primed and the patient's volume is held",
}
MOST_LINES = 20


def main_policy(study: CrrtStudy, policy: str | None) -> str:
    """The blood volume policy that a report is about: the one asked for, else the first studied.

    Raises:
        ValueError: If the study does not have it.
    """
    if policy is None:
        return study.policies[0]
    if policy not in study.policies:
        studied = ", ".join(study.policies)
        raise ValueError(f"blood volume policy '{policy}' was not studied; studied: {studied}")
    return policy


def choice(study: CrrtStudy, policy: str) -> list[str]:
    """Which scheme is first and why, or what is missing to tell; the first line is the answer."""
    ranking = study.ranking[policy]
    best, unknown = best_known(ranking), [one for one in ranking if not one.known]
    left_out = _left_out(unknown)
    if best is not None:
        name = f"scheme {best.letter} ({next(s.name for s in study.schemes if s.letter == best.letter)})"
        if not unknown:
            return [f"First choice for this patient: {name}", *best.reasons]
        of = f"the {len(ranking) - len(unknown)} of {len(ranking)} schemes whose beat was found"
        answer = f"No first choice can be named; best of {of} at {study.case_speed:.0f} rpm: {name}"
        return [answer, *best.reasons, *left_out]
    open_ = candidates(ranking)
    if not open_:
        return ["No scheme can be ranked", *left_out]
    answer = f"No first choice can be named: schemes {listed([r.letter for r in open_])} may each be first"
    lines = [f"Scheme {one.letter}: {one.why_no_rank}; {'; '.join(one.reasons)}" for one in open_]
    return [answer, *lines[:MOST_LINES], *left_out]


def _left_out(unknown: list[Ranked]) -> list[str]:
    """Schemes without a place, those with the same reason together."""
    together: dict[str, list[str]] = {}
    for one in unknown:
        together.setdefault(one.why_no_rank, []).append(one.letter)
    return [f"{_schemes(letters)}: {why}" for why, letters in together.items()]


def _schemes(letters: list[str]) -> str:
    return f"Scheme{'s' if len(letters) > 1 else ''} {listed(letters)}"


def choice_elsewhere(study: CrrtStudy, policy: str) -> str | None:
    """Which scheme is first under the other blood volume policy; None if only one was studied."""
    others = [one for one in study.policies if one != policy]
    if not others:
        return None
    best, here = first_choice(study.ranking[others[0]]), first_choice(study.ranking[policy])
    where = IN_ANOTHER_POLICY[others[0]]
    if best is None:
        return f"Which scheme is first {where} is not known."
    if here is not None and best.letter == here.letter:
        return f"It is also first {where}."
    return f"{where[0].upper()}{where[1:]}, scheme {best.letter} is first."


def not_known(study: CrrtStudy) -> list[str]:
    """Every beat that was not found, with its reason and what to do; empty if all were."""
    together: dict[tuple[str, str, tuple[float, ...], str], list[str]] = {}
    for one in study.unsettled:
        together.setdefault((one.policy, one.condition, one.speeds, one.status), []).append(one.place)
    lines = []
    for (policy, condition, speeds, status), places in together.items():
        how = condition or POLICY_WORDS[policy].partition(":")[0]
        where = f"{_places(places)}, {how}"
        lines.append(f"{where}: {no_beat(speeds, [status] * len(speeds))}")
    if len(lines) > MOST_LINES:
        lines = [*lines[:MOST_LINES], f"and {len(lines) - MOST_LINES} more, see the list in the JSON object"]
    if study.samples_without_a_beat and study.uncertainty is not None:
        count = ", ".join(f"{number} (scheme {k})" for k, number in study.samples_without_a_beat.items())
        every = study.uncertainty.attrs["samples"]
        lines.append(f"Samples of the patient's parameters without a steady beat, of {every}: {count}")
    return lines + [f"What this means: {words}" for words in dict.fromkeys(u.advice for u in study.unsettled)]


def _places(places: list[str]) -> str:
    """Places of one kind together: schemes a, b and c."""
    letters = [place.removeprefix("scheme ") for place in places if place.startswith("scheme ")]
    others = [place for place in places if not place.startswith("scheme ")]
    named = [_schemes(letters)] if letters else []
    words = listed([*named, *others])
    return words[0].upper() + words[1:]


def place(one: Ranked) -> str:
    """A scheme's place; where it is not known, the places that it may have."""
    if one.rank is not None:
        return str(one.rank)
    return "–" if one.places is None else f"{one.places[0]}–{one.places[1]}"


def kept(flow: float, flow_at_most: float, to_the_end: bool) -> str:
    """The ECMO flow that keeps a limit: +, kept at the largest speed; ≥, not known above.

    Args:
        flow: largest that is known to keep it [L/min].
        flow_at_most: bound on what may keep it.
        to_the_end: whether it is kept at the largest speed studied.
    """
    if math.isnan(flow):
        return "never" if math.isnan(flow_at_most) else "not known"
    if flow != flow_at_most:
        return f"≥ {flow:.1f}"
    return f"{flow:.1f}{'+' if to_the_end else ''}"
