"""Ranking of schemes by a rule, with reasons; a rank is given only if all numbers it depends on are known."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from eclsim.crrt_study.beats import GASES, joined_with_and, schemes_named, speeds_without_solution
from eclsim.crrt_study.limits import CRRT_LIMITS, KEPT_TO_THE_END, LIMITS, USUAL_ALARMS
from eclsim.crrt_study.rule import DEFAULT_RULE, FLOW, ON_PATIENT, PAST_OXYGENATOR, Rule
from eclsim.devices.crrt import embolism_text

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.crrt_study.limits import Limit
    from eclsim.crrt_study.schemes import Scheme
    from eclsim.crrt_study.study import CrrtStudy


@dataclass(frozen=True, slots=True)
class Ranked:
    """Rank of a scheme and the numbers it is based on.

    Args:
        letter: letter of the scheme.
        rank: rank among the schemes whose beat at the case's speed was found, 1 is best; None if a number
            that it depends on is not known.
        alarms_kept: whether both lines are within the machine's alarm limits at the case's speed; None if the
            beat at that speed was not found.
        access_190_kept: whether the access pressure is below 190 mmHg, or the rule's own limit; None if the
            beat was not found.
        usual_alarms_kept: whether both lines are within the usual alarms of CRRT machines, also where the
            rule sets others or none; None if the beat was not found.
        lowest_site_pressure: lower of the mean pressures at the sites of the lines [mmHg]; NaN without a
            beat.
        largest_flow: largest ECMO flow known to keep all limits of the CRRT lines [L/min]; NaN if there is
            none.
        throughout: whether the scheme keeps them at the largest speed studied.
        recirculated: share of the access flow that comes directly from the return line; NaN without a beat.
        margin: distance to the nearest limit [mmHg]; NaN without a beat.
        reasons: reasons as sentences.
        flow_at_most: largest flow that may keep the limits [L/min]; equal to `largest_flow` if that is
            certain.
        places: best and worst possible rank among the schemes whose beat at the case's speed was found; None
            for the others.
        why_no_rank: what is unknown; empty for a scheme with a rank.
        numbers: values of the quantities of the rule.
        decided_by: criterion by which the scheme ranks after the previous one; empty for the first and for
            ties.
    """

    letter: str
    rank: int | None
    alarms_kept: bool | None
    access_190_kept: bool | None
    lowest_site_pressure: float
    largest_flow: float
    throughout: bool
    recirculated: float
    margin: float
    reasons: tuple[str, ...]
    flow_at_most: float = np.nan
    places: tuple[int, int] | None = None
    why_no_rank: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)
    decided_by: str = ""
    usual_alarms_kept: bool | None = None

    @property
    def known(self) -> bool:
        """Whether the beat at the case's speed was found."""
        return self.alarms_kept is not None

    @property
    def flow_known(self) -> bool:
        """Whether the flow up to which the limits are kept is known, including that they never are."""
        return self.flow_at_most == self.largest_flow or bool(np.isnan(self.flow_at_most))

    @property
    def compared(self) -> Mapping[str, float]:
        """Numbers as compared by the rule: flows of limits that are never violated count as infinite."""
        return {**self.numbers, FLOW: np.inf} if self.throughout else self.numbers

    @property
    def most_flow(self) -> float:
        """Value of `flow_at_most` as compared by the rule."""
        return np.inf if self.throughout else self.flow_at_most

    @property
    def unknown(self) -> set[str]:
        """Quantities of the rule that are not known."""
        missing = {name for name, value in self.numbers.items() if name != FLOW and np.isnan(value)}
        return missing if self.flow_known else {*missing, FLOW}


def rank(
    means: xr.Dataset, limits: xr.Dataset, schemes: tuple[Scheme, ...], rule: Rule = DEFAULT_RULE
) -> tuple[Ranked, ...]:
    """Rank the schemes from best to worst for one policy and speed; those without a rank are last.

    Args:
        means: means over `scheme`, at the case's speed and for one policy.
        limits: result of `largest_flows` over `scheme` and `limit`, for the same policy.
        schemes: schemes of the study.
        rule: rule by which schemes are ranked.
    """
    assessed = [_assessed(means.sel(scheme=s.letter), limits.sel(scheme=s.letter), s, rule) for s in schemes]
    known, unknown = [r for r in assessed if r.known], [r for r in assessed if not r.known]

    def order(scheme: Ranked) -> tuple[object, ...]:
        return (scheme.places, *(c.key(scheme.compared[c.quantity]) for c in rule.criteria))

    placed = sorted((_placed(scheme, known, rule) for scheme in known), key=order)
    for k, (before, scheme) in enumerate(itertools.pairwise(placed), 1):
        by = rule.decides(before.compared, scheme.compared)
        placed[k] = replace(scheme, decided_by="" if by is None else by.sentence)
    return (*placed, *unknown)


def first_choice(ranking: Sequence[Ranked]) -> Ranked | None:
    """The best scheme of all; None if not known or if the beat of any scheme was not found."""
    return best_known(ranking) if all(r.known for r in ranking) else None


def best_known(ranking: Sequence[Ranked]) -> Ranked | None:
    """The scheme that is certainly best among those with a beat; None if not known."""
    return next((r for r in ranking if r.rank == 1), None)


def ties(ranking: Sequence[Ranked]) -> list[str]:
    """Letters of the schemes that share the first rank, which the rule cannot separate; else empty."""
    first = [r.letter for r in ranking if r.rank == 1]
    return first if len(first) > 1 else []


def _placed(scheme: Ranked, known: Sequence[Ranked], rule: Rule) -> Ranked:
    """Return the scheme with its best and worst possible rank, and with a rank if both are equal."""
    others = [other for other in known if other is not scheme]
    better = sum(_is_better(other, scheme, rule) is True for other in others)
    open_against = [other for other in others if _is_better(other, scheme, rule) is None]
    places = (1 + better, 1 + better + len(open_against))
    if not open_against:
        return replace(scheme, rank=places[0], places=places)
    reason = (
        f"place {places[0]} to {places[1]}: {_missing_numbers_text(scheme, open_against, rule)} is not known"
    )
    return replace(scheme, places=places, why_no_rank=reason)


def _missing_numbers_text(scheme: Ranked, others: Sequence[Ranked], rule: Rule) -> str:
    """First quantity of the rule that is unknown for the scheme or those it is compared with, in words."""
    missing = scheme.unknown.union(*(other.unknown for other in others))
    quantity = next(criterion.quantity for criterion in rule.criteria if criterion.quantity in missing)
    letters = [] if quantity in scheme.unknown else [o.letter for o in others if quantity in o.unknown]
    which = schemes_named(letters).lower() if letters else "it"
    if quantity != FLOW:
        return f"the {quantity} of {which}" if letters else f"its {quantity}"
    keeps = f"{which} {'keep their' if len(letters) > 1 else 'keeps its'}"
    return f"the ECMO flow up to which {keeps} limits"


def _is_better(a: Ranked, b: Ranked, rule: Rule) -> bool | None:
    """Whether a scheme is better than another; None if the known numbers do not determine it."""
    for criterion in rule.criteria:
        unknown = criterion.quantity in a.unknown or criterion.quantity in b.unknown
        if criterion.quantity == FLOW and unknown:
            least = a.compared[FLOW], b.compared[FLOW]
            if criterion.key(least[0]) < criterion.key(b.most_flow):
                return True
            return False if criterion.key(least[1]) < criterion.key(a.most_flow) else None
        if unknown:
            return None
        key_a, key_b = (criterion.key(r.compared[criterion.quantity]) for r in (a, b))
        if key_a != key_b:
            return key_a < key_b
    return False


def _assessed(means: xr.Dataset, limits: xr.Dataset, scheme: Scheme, rule: Rule) -> Ranked:
    margin = {str(k): float(limits["margin"].sel(limit=k)) for k in limits["limit"].values}
    limit = limits.sel(limit=CRRT_LIMITS)
    missing = speeds_without_solution([float(means["speed"])], [str(means["status"].item())])
    numbers = {
        **margin,
        "alarms": min(margin["access_alarm"], margin["return_alarm"]),
        "margin": margin[CRRT_LIMITS],
        "lowest_site_pressure": min(float(means["P" + node]) for node in scheme.nodes),
        ON_PATIENT: float(scheme.on_patient),
        FLOW: float(limit["largest_flow"]),
    }
    quantities = [c.quantity for c in rule.criteria]
    numbers |= {
        name: float(means[name]) for name in (*quantities, "recirculated_fraction") if name not in numbers
    }
    ranked = Ranked(
        letter=scheme.letter, rank=None, alarms_kept=None if missing else numbers["alarms"] >= 0.0,
        access_190_kept=None if missing else margin["access_190"] >= 0.0,
        lowest_site_pressure=numbers["lowest_site_pressure"], largest_flow=numbers[FLOW],
        throughout=limit["state"].item() == KEPT_TO_THE_END, recirculated=numbers["recirculated_fraction"],
        margin=numbers["margin"], reasons=(), flow_at_most=float(limit["flow_at_most"]),
        why_no_rank=f"no place: {missing}" if missing else "",
        usual_alarms_kept=None if missing else not _beyond_usual_alarms(means),
        numbers={name: numbers[name] for name in quantities},
    )  # fmt: skip
    return replace(ranked, reasons=tuple(_sentences(ranked, means, limit["in_words"].item(), scheme, rule)))


def _sentences(ranked: Ranked, means: xr.Dataset, flows: str, scheme: Scheme, rule: Rule) -> list[str]:
    if not ranked.known:
        return [ranked.why_no_rank.removeprefix("no place: "), flows]
    access_pressure, return_pressure = float(means["Pcrrttuin"]), float(means["Pcrrttuout"])
    texts = [f"access {_integer_text(access_pressure)} mmHg, return {_integer_text(return_pressure)} mmHg"]
    if not ranked.alarms_kept:
        texts.append("breaks a pressure alarm of the machine")
    elif not ranked.usual_alarms_kept:
        broken = ", ".join(f"{k} {_bounds_text(USUAL_ALARMS[k])}" for k in _beyond_usual_alarms(means))
        texts.append(
            f"beyond the usual alarms of CRRT machines ({broken} mmHg), which {rule.name} does not count"
        )
    if not ranked.access_190_kept:
        texts.append(_beyond_access_limit(access_pressure, rule))
    if ranked.lowest_site_pressure < 0.0:
        texts.append(
            f"a line attaches at {_integer_text(ranked.lowest_site_pressure)} mmHg: a leak there draws in air"
        )
    texts.append(flows)
    if ranked.recirculated >= 0.005:
        texts.append(
            f"{100.0 * ranked.recirculated:.0f} % of the access flow comes straight from the return line"
        )
    if scheme.returns_after_lungs:
        texts.append(embolism_text(scheme.return_site))
    elif scheme.returns_behind_oxygenator:
        texts.append("returns behind the oxygenator: no trap for air or clots from the CRRT")
    if (share := float(means[PAST_OXYGENATOR])) > 0.0:
        text = f"carries {100.0 * share:.1f} % of the ECMO's blood past the oxygenator"
        if scheme.returns_after_lungs:
            both = f"{100.0 * share:.1f} % of what CRRT and ECMO carry together"
            text = f"carries venous blood past oxygenator and lungs: {both}"
        texts.append(text)
    if "gas_status" in means:
        gases = speeds_without_solution([float(means["speed"])], [str(means["gas_status"].item())], GASES)
        texts += [gases] if gases else []
    return texts


def _beyond_usual_alarms(means: xr.Dataset) -> list[str]:
    """Lines whose pressure is beyond the usual alarms of CRRT machines."""
    return [k for k, limit in USUAL_ALARMS.items() if limit.margin(float(means[limit.quantity])) < 0.0]


def _bounds_text(limit: Limit) -> str:
    return f"{_integer_text(limit.low)} to {_integer_text(limit.high)}"


def _beyond_access_limit(pressure: float, rule: Rule) -> str:
    """Meaning of an access pressure beyond its limit; the default limit has a source."""
    limit = next(limit for limit in rule.limits if limit.name == "access_190")
    side, bound = ("above", limit.high) if pressure > limit.high else ("below", limit.low)
    text = f"access pressure {side} {bound:g} mmHg"
    if limit in LIMITS:
        return f"{text}: early failure of the CRRT circuit is more likely"
    return f"{text}, the limit of {rule.name}"


def _integer_text(value: float) -> str:
    """A whole number as text with a minus sign."""
    return f"{value:.0f}".replace("-", "−")


# --- the best scheme, in words -----------------------------------------------------------------

IN_ANOTHER_POLICY = {
    "as_published": "as published, where the patient's own blood fills the circuits",
    "patient_held": "when the circuits are primed and the patient's volume is held",
}
MOST_LINES = 20


def choice_text(study: CrrtStudy, policy: str) -> list[str]:
    """The best scheme with reasons, or what is missing to determine it; the first line is the answer."""
    ranking = study.ranking[policy]
    best, unknown = best_known(ranking), [r for r in ranking if not r.known]
    left_out = [*_embolism_text(study), *_unranked_text(unknown)]
    if best is not None:
        alarms = _alarms_text(study, ranking, [r for r in ranking if r.rank == 1])
        left_out = [*_alternatives_text(study, ranking, best), *left_out]
        tied = ties(ranking)
        name = f"scheme {best.letter} ({next(s.name for s in study.schemes if s.letter == best.letter)})"
        if not unknown:
            second = next((r for r in ranking if r.decided_by), None)
            them = "them" if tied else "it"
            by = [f"what places {them} before scheme {second.letter}: {second.decided_by}"] if second else []
            if tied:
                letters = joined_with_and(tied)
                answer = f"First for this patient: schemes {letters}, which the rule does not tell apart"
                first = ranking[: min(len(tied), MOST_LINES)]
                reasons = (f"Scheme {r.letter}: {'; '.join(r.reasons)}" for r in first)
                return [answer, *alarms, *by, *reasons, *left_out]
            return [f"First choice for this patient: {name}", *alarms, *by, *best.reasons, *left_out]
        of = f"the {len(ranking) - len(unknown)} of {len(ranking)} schemes whose beat was found"
        answer = f"No first choice can be named; best of {of} at {study.case_speed:.0f} rpm: {name}"
        share = f"schemes {joined_with_and(tied)} share its place: the rule does not tell them apart"
        return [answer, *[share] * bool(tied), *alarms, *best.reasons, *left_out]
    possible = [r for r in ranking if r.places is not None and r.places[0] == 1]  # as far as known
    if not possible:
        return ["No scheme can be ranked", *left_out]
    letters = joined_with_and([r.letter for r in possible])
    answer = f"No first choice can be named: schemes {letters} may each be first"
    lines = [f"Scheme {r.letter}: {r.why_no_rank}; {'; '.join(r.reasons)}" for r in possible]
    return [answer, *_alarms_text(study, ranking, possible), *lines[:MOST_LINES], *left_out]


def _alternatives_text(study: CrrtStudy, ranking: Sequence[Ranked], best: Ranked) -> list[str]:
    """Disadvantages of the best scheme, and the best of the schemes without them."""
    schemes = {scheme.letter: scheme for scheme in study.schemes}
    chosen, lines = schemes[best.letter], []

    def next_best(among: set[str]) -> str:
        other = next((r for r in ranking if r.rank is not None and r.letter in among), None)
        return f"scheme {other.letter} ({schemes[other.letter].name}), place {other.rank}" if other else ""

    if chosen.on_patient:
        text = next_best({k for k, scheme in schemes.items() if not scheme.on_patient})
        lines.append(
            "its lines attach to the patient without a catheter's resistance: their pressures are too mild"
            + (f"; best of the schemes on the ECMO circuit: {text}" if text else "")
        )
    before = {k for k, s in schemes.items() if not s.returns_behind_oxygenator and not s.on_patient}
    if chosen.returns_behind_oxygenator and (text := next_best(before)):
        lines.append(f"best of the schemes that return before the oxygenator: {text}")
    return lines


def _alarms_text(study: CrrtStudy, ranking: Sequence[Ranked], first: Sequence[Ranked]) -> list[str]:
    """What is first but breaks the machine's usual alarms, and the best of the schemes that keep them."""
    broken = [r.letter for r in first if r.usual_alarms_kept is False]
    if not broken:
        return []
    several = f"scheme{'s' if len(broken) > 1 else ''} {joined_with_and(broken)}"
    subject = f"{'it' if len(first) == 1 else several} break{'s' if len(broken) == 1 else ''}"
    keeping = [r for r in ranking if r.usual_alarms_kept and r.rank is not None]
    best = [r for r in keeping if r.rank == keeping[0].rank]
    if not best:
        bounds = ", ".join(f"{line} {_bounds_text(limit)}" for line, limit in USUAL_ALARMS.items())
        return [f"{subject} the machine's usual alarms, as do all schemes with a place ({bounds} mmHg)"]
    names = {scheme.letter: scheme.name for scheme in study.schemes}
    named = joined_with_and([f"{r.letter} ({names[r.letter]})" for r in best])
    which = f"scheme{'s' if len(best) > 1 else ''} {named}, place {place(best[0])}"
    return [f"{subject} the machine's usual alarms; best of the schemes that keep them: {which}"]


def _embolism_text(study: CrrtStudy) -> list[str]:
    """Schemes that return to the left heart or an artery."""
    letters = [scheme.letter for scheme in study.schemes if scheme.returns_after_lungs]
    if not letters:
        return []
    returns = "return" if len(letters) > 1 else "returns"
    return [
        f"{schemes_named(letters)} {returns} to the left heart or an artery: nothing holds back air or clots "
        "from the CRRT before the arteries of the body (systemic embolism)"
    ]


def _unranked_text(unknown: list[Ranked]) -> list[str]:
    """Schemes without a rank, grouped by reason."""
    letters_of: dict[str, list[str]] = {}
    for r in unknown:
        letters_of.setdefault(r.why_no_rank, []).append(r.letter)
    return [f"{schemes_named(letters)}: {reason}" for reason, letters in letters_of.items()]


def choice_in_other_policy(study: CrrtStudy, policy: str) -> str | None:
    """The best scheme under the other blood volume policy; None if only one was studied."""
    others = [p for p in study.policies if p != policy]
    if not others:
        return None
    best, first = first_choice(study.ranking[others[0]]), first_choice(study.ranking[policy])
    where = IN_ANOTHER_POLICY[others[0]]
    if best is None:
        return f"Which scheme is first {where} is not known."
    if first is not None and best.letter == first.letter:
        return f"It is also first {where}."
    return f"{where[0].upper()}{where[1:]}, scheme {best.letter} is first."


def place(ranked: Ranked) -> str:
    """Rank of a scheme as text; if not known, the possible ranks."""
    if ranked.rank is not None:
        return str(ranked.rank)
    return "–" if ranked.places is None else f"{ranked.places[0]}–{ranked.places[1]}"
