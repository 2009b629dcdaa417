"""The CRRT study of every patient of a cohort: whether one scheme is best for all."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eclsim.crrt_study.ranking import Ranked, first_choice, ties
from eclsim.crrt_study.rule import DEFAULT_RULE, Rule, RuleError, read_rule
from eclsim.crrt_study.schemes import NINE, PUBLISHED, Scheme, StudyError, policy_of_cases, select_schemes
from eclsim.crrt_study.study import CrrtStudy, crrt_study
from eclsim.devices.description import LABELS
from eclsim.execution import Executor, Progress, Tasks, announce, complete_in, json_format
from eclsim.simulation.target_flow import FlowNotReachedError

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.identification.cohort import FittedCases

FILES = ("report.html", "cohort.json", "points.csv", "schemes.csv", "ranks.svg")
FITS = "fits"
"""Folder of the fits, so that they can be resumed."""


@dataclass(frozen=True)
class PointResult:
    """Result of the study for one data point.

    Args:
        name: name of the data point.
        flow: ECMO flow without CRRT at the point's speed [L/min]; NaN if this beat was not found.
        pressure: mean arterial pressure of this beat [mmHg]; NaN if it was not found.
        speed: pump speed [rpm].
        ranking: schemes from best to worst, by blood volume policy; those without a rank are last.
        variation: largest minus smallest mean arterial pressure of the schemes [mmHg], by policy; NaN unless
            the beats of all schemes were found.
        taken_up: largest volume that a scheme takes from the patient [mL]; NaN without the published policy,
            or unless the beats of all schemes and of the patient without CRRT were found.
        unsettled: one sentence for each scheme, policy and reason with steady beats that were not found.
        beats_not_found: number of these beats.
        impossible: sentences on beats at the point's speed that no patient can have.
    """

    name: str
    flow: float
    pressure: float
    speed: float
    ranking: dict[str, tuple[Ranked, ...]]
    variation: dict[str, float]
    taken_up: float
    unsettled: tuple[str, ...]
    beats_not_found: int
    impossible: tuple[str, ...] = ()

    def ranked(self, policy: str, letter: str) -> Ranked:
        """Rank of a scheme with the numbers it is based on."""
        return next(ranked for ranked in self.ranking[policy] if ranked.letter == letter)

    def first(self, policy: str) -> str | None:
        """Letter of the best scheme; None if known numbers do not determine it, or beats are impossible."""
        best = None if self.impossible else first_choice(self.ranking[policy])
        return None if best is None else best.letter


@dataclass(frozen=True)
class CohortStudy:
    """The study of a cohort.

    Args:
        points: results for the data points, in the order of the cohort.
        schemes: schemes that are compared.
        fitted: cases and how their parameters were found.
        lost: data points without a study, with the reason.
        rule: rule by which schemes are ranked.
    """

    points: tuple[PointResult, ...]
    schemes: tuple[Scheme, ...]
    fitted: FittedCases
    lost: dict[str, str]
    rule: Rule = DEFAULT_RULE

    @property
    def policies(self) -> tuple[str, ...]:
        """Blood volume policies that were studied."""
        return tuple(self.points[0].ranking)

    @property
    def doubts(self) -> dict[str, tuple[str, ...]]:
        """Doubts about fits that are not good, by data point."""
        return {name: case.doubts for name, case in self.fitted.cases.items() if case.doubts}

    @property
    def counted(self) -> tuple[PointResult, ...]:
        """Data points whose ranks count: those whose beats a patient can have."""
        return tuple(point for point in self.points if not point.impossible)

    @property
    def unsettled(self) -> tuple[PointResult, ...]:
        """Data points with beats that were not found."""
        return tuple(point for point in self.points if point.unsettled)

    def winners(self, policy: str) -> dict[str, int]:
        """Number of data points in which each scheme is best, largest first."""
        first = [point.first(policy) for point in self.points]
        count = {scheme.letter: first.count(scheme.letter) for scheme in self.schemes}
        return dict(sorted(count.items(), key=lambda item: -item[1]))

    def undecided(self, policy: str) -> tuple[str, ...]:
        """Data points for which the best scheme is not known."""
        return tuple(point.name for point in self.points if point.first(policy) is None)


@dataclass(frozen=True)
class SchemeSummary:
    """One scheme over the cohort; unknown values of data points are left out of each number.

    Args:
        letter: letter of the scheme.
        first: number of data points in which it is best.
        ranked: number of data points in which its rank is known.
        median_rank: median of its known ranks; NaN if there are none.
        worst_rank: worst of its known ranks; None if there are none.
        known: number of data points in which its beat at the point's speed was found.
        alarms_kept: number of these in which the lines are within the machine's alarm limits.
        access_190_kept: number of these in which the access pressure is below 190 mmHg, or the rule's limit.
        above_atmosphere: number of these in which both lines connect above atmospheric pressure.
        flow_known: number of data points for which the ECMO flow up to which all limits of the CRRT lines are
            kept is known.
        smallest_flow: smallest of these flows [L/min]; 0 if the limits are kept at no speed in some point.
        median_flow: median of these flows [L/min].
        smallest_flow_may_be_larger: whether it may be, because of points in which the limits are kept at the
            largest speed studied.
        median_flow_may_be_larger: the same for the median.
    """

    letter: str
    first: int
    ranked: int
    median_rank: float
    worst_rank: int | None
    known: int
    alarms_kept: int
    access_190_kept: int
    above_atmosphere: int
    flow_known: int
    smallest_flow: float
    median_flow: float
    smallest_flow_may_be_larger: bool
    median_flow_may_be_larger: bool


@dataclass(frozen=True)
class PointOutcome:
    """Study of a data point, or the reason why there is none."""

    name: str
    study: PointResult | None
    lost: str = ""


PRELOAD = ("eclsim.identification.cohort", "eclsim.crrt_study.cohort", "eclsim.outputs.steady_beat")
"""Modules that a worker imports before its first group."""
_FORMAT = json_format(list[PointOutcome])


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """Options of `crrt_study` for all cases of a cohort; a call studies the cases of a group in turn."""

    schemes: str | Sequence[str] = NINE
    speeds: str | Sequence[float] | None = None
    crrt_flow_ml_min: float | None = None
    volume_policy: str | None = None
    scheme_h: str = PUBLISHED
    rule: str | Path | Mapping[str, object] | Rule | None = None

    def __call__(self, cases: tuple[tuple[str, Case], ...]) -> list[PointOutcome]:
        """Return the outcome for each case."""
        outcomes = []
        for name, case in cases:
            announce(name)
            try:
                study = _point(name, crrt_study(case, **vars(self)))
                outcomes.append(PointOutcome(name, study))
            except (StudyError, RuleError, FlowNotReachedError) as error:
                outcomes.append(PointOutcome(name, None, str(error)))
        return outcomes


def crrt_cohort(
    fitted: FittedCases,
    options: StudyOptions | None = None,
    *,
    folder: Path | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> CohortStudy:
    """Study every case at its own speed and over common speeds (by default those of its pump).

    Args:
        fitted: the cases.
        options: options of the study; without a policy, that of the cases, else both.
        folder: folder that stores the studies; None keeps them in memory only.
        executor: runs the studies; None runs them in this process.
        progress: called when a group is done.

    Raises:
        StudyError: No case can be studied, or the cases state different policies.
        ExecutionError: The folder holds other studies, or workers cannot be reached.
        ShardDone: This run computed one shard only.
    """
    options = options or StudyOptions()
    judged_by = read_rule(options.rule)
    policy = options.volume_policy or policy_of_cases(list(fitted.cases.values()))
    compute = replace(options, volume_policy=policy, rule=judged_by.as_object())
    groups = [tuple((n, fitted.cases[n]) for n in names if n in fitted.cases) for names in fitted.groups]
    inputs = {**fitted.inputs, "study": vars(compute)}
    tasks = Tasks("schemes", "groups of data points", compute, groups, inputs)
    # Studies with different options have separate folders, so the fits can be reused.
    mark = hashlib.sha256(json.dumps(vars(compute)).encode()).hexdigest()[:8]
    groups_done = complete_in(folder, f"studies-{mark}", tasks, _FORMAT, executor, progress)
    outcomes = [outcome for group in groups_done for outcome in group]
    by_name = {outcome.name: outcome for outcome in outcomes}
    failures = {**fitted.not_fitted, **{outcome.name: outcome.lost for outcome in outcomes if outcome.lost}}
    points = tuple(study for name in fitted.cases if (study := by_name[name].study) is not None)
    if not points:
        raise StudyError(
            "no data point can be studied: " + "; ".join(f"{k}: {v}" for k, v in failures.items())
        )
    chosen = select_schemes(options.schemes, options.scheme_h)
    return CohortStudy(points, chosen, fitted, failures, judged_by)


def _point(name: str, study: CrrtStudy) -> PointResult:
    policy, speed = study.policies[0], study.case_speed
    without_crrt = study.without_crrt.sel(policy=policy, speed=speed)
    pressures = study.means["MAP"].sel(speed=speed)
    spread = pressures.max("scheme", skipna=False) - pressures.min("scheme", skipna=False)
    taken_up = np.nan if study.uptake is None else float(study.uptake["blood_taken_up"].max(skipna=False))
    variation = {p: float(spread.sel(policy=p)) for p in study.policies}
    missing = study.unsettled
    collapse = f"{LABELS['collapse']}: "
    return PointResult(
        name=name,
        flow=float(without_crrt["PF"]),
        pressure=float(without_crrt["MAP"]),
        speed=speed,
        ranking=study.ranking,
        variation=variation,
        taken_up=taken_up,
        unsettled=tuple(f"{beat.policy}, {beat.sentence}" for beat in missing),
        beats_not_found=sum(len(beat.speeds) for beat in missing),
        impossible=tuple(sentence for sentence in study.warnings if sentence.startswith(collapse)),
    )


def summaries(study: CohortStudy, policy: str) -> tuple[SchemeSummary, ...]:
    """Summaries of the schemes, those most often best first, then by median rank."""
    winners = study.winners(policy)
    result = [
        _summary(
            scheme.letter, winners[scheme.letter], [p.ranked(policy, scheme.letter) for p in study.counted]
        )
        for scheme in study.schemes
    ]

    def order(one: SchemeSummary) -> tuple[float, ...]:
        return -one.first, np.nan_to_num(one.median_rank, nan=np.inf), one.worst_rank or np.inf

    return tuple(sorted(result, key=order))


def _summary(letter: str, first: int, rankings: Sequence[Ranked]) -> SchemeSummary:
    """Summary of a scheme that is first in so many data points, from its ranks in all that count."""
    ranks, known = [r.rank for r in rankings if r.rank is not None], [r for r in rankings if r.known]
    of_flow = [r for r in rankings if r.flow_known]
    flows = [0.0 if np.isnan(r.largest_flow) else r.largest_flow for r in of_flow]
    most = [np.inf if r.throughout else flow for r, flow in zip(of_flow, flows, strict=True)]
    return SchemeSummary(
        letter=letter,
        first=first,
        ranked=len(ranks),
        median_rank=_median(ranks),
        worst_rank=max(ranks, default=None),
        known=len(known),
        alarms_kept=sum(bool(r.alarms_kept) for r in known),
        access_190_kept=sum(bool(r.access_190_kept) for r in known),
        above_atmosphere=sum(r.lowest_site_pressure >= 0.0 for r in known),
        flow_known=len(flows),
        smallest_flow=min(flows, default=np.nan),
        median_flow=_median(flows),
        smallest_flow_may_be_larger=bool(min(most, default=0.0) == np.inf),
        median_flow_may_be_larger=_median(most) == np.inf,
    )


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else np.nan


def conclusion(study: CohortStudy, policy: str) -> str:
    """One sentence on whether a single scheme is best for all."""
    winners = {letter: count for letter, count in study.winners(policy).items() if count}
    total, open_ = len(study.points), len(study.undecided(policy))
    doubt = f" In {open_} of {total} it is not known which scheme is first." if open_ else ""
    if not winners:
        return f"Not known: in none of the {total} data points is it known which scheme is first."
    best, count = next(iter(winners.items()))
    shared = sum(bool(point.first(policy) and ties(point.ranking[policy])) for point in study.points)
    if shared:
        doubt += f" In {shared} of {total} several share the first place; the first listed counts."
    if count == total:
        return f"Yes: scheme {best} is first in all {total} data points.{doubt}"
    if count == total - open_:
        return f"Not known: scheme {best} is first in {count} of {total} data points.{doubt}"
    others = ", ".join(f"{letter} in {n}" for letter, n in list(winners.items())[1:])
    text = f"No: scheme {best} is first in {count} of {total} data points, {others}.{doubt}"
    return f"{text} {_reasons_in_other_points(study, policy, best)}"


def _reasons_in_other_points(study: CohortStudy, policy: str, letter: str) -> str:
    """Reasons why the scheme that is most often best is not best in the other points."""
    rankings = [point.ranked(policy, letter) for point in study.counted if point.first(policy) != letter]
    not_first = [
        ranked for ranked in rankings if ranked.known and ranked.places is not None and ranked.places[0] > 1
    ]
    if not not_first:
        return f"Elsewhere {letter} shares the first place."
    alarms = sum(not ranked.alarms_kept for ranked in not_first)
    access = sum(bool(ranked.alarms_kept) and not ranked.access_190_kept for ranked in not_first)
    reasons = {
        "breaks an alarm": alarms,
        f"exceeds {study.rule.access_mmhg:g} mmHg of access pressure": access,
        "ranks lower for other reasons": len(not_first) - alarms - access,
    }
    listed = ", ".join(f"{reason} in {count}" for reason, count in reasons.items() if count)
    place = f"and is placed {max(ranked.places[1] for ranked in not_first if ranked.places)} at worst"
    return f"Elsewhere {letter} {listed}, {place}."
