"""The CRRT study of every patient of a cohort: does one scheme win for all?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eclsim.studies.crrt_ranking import Ranked
from eclsim.studies.crrt_schemes import NINE, PUBLISHED, Scheme
from eclsim.studies.crrt_settings import BOTH
from eclsim.studies.crrt_study import USUAL_SPEEDS, CrrtStudy, crrt_study

if TYPE_CHECKING:
    from eclsim.studies.cohort_cases import FittedCases


@dataclass(frozen=True)
class PointResult:
    """What the study says for one data point.

    Args:
        name: of the data point.
        flow: ECMO flow without CRRT at the point's speed [L/min].
        pressure: mean arterial pressure without CRRT there [mmHg].
        speed: of the pump [rpm].
        ranking: schemes from best to worst, by blood volume policy.
        variation: largest less smallest mean arterial pressure of the schemes [mmHg], by policy.
        taken_up: largest volume that a scheme takes from the patient [mL]; NaN without the published policy.
        unsettled: number of schemes and speeds without a steady beat.
    """

    name: str
    flow: float
    pressure: float
    speed: float
    ranking: dict[str, tuple[Ranked, ...]]
    variation: dict[str, float]
    taken_up: float
    unsettled: int

    def rank_of(self, policy: str, letter: str) -> int:
        """Place of a scheme, 1 is best."""
        return next(one.rank for one in self.ranking[policy] if one.letter == letter)


@dataclass(frozen=True)
class CohortStudy:
    """The study of a cohort.

    Args:
        points: one for each data point, in the order of the cohort.
        schemes: schemes compared.
        fitted: the cases and how they were found.
        crrt_flow_ml_min: blood flow of the CRRT; None if each case has its own.
        lost: data points without a study, and why.
    """

    points: tuple[PointResult, ...]
    schemes: tuple[Scheme, ...]
    fitted: FittedCases
    crrt_flow_ml_min: float | None
    lost: dict[str, str]

    @property
    def policies(self) -> tuple[str, ...]:
        """Blood volume policies that were studied."""
        return tuple(self.points[0].ranking)

    def winners(self, policy: str) -> dict[str, int]:
        """In how many data points each scheme is first, most often first."""
        first = [point.ranking[policy][0].letter for point in self.points]
        count = {scheme.letter: first.count(scheme.letter) for scheme in self.schemes}
        return dict(sorted(count.items(), key=lambda item: -item[1]))


@dataclass(frozen=True)
class SchemeSummary:
    """One scheme over the cohort.

    Args:
        letter: of the scheme.
        first: in how many data points it is first.
        median_rank: median of its places.
        worst_rank: its worst place.
        alarms_kept: in how many points the lines stay within the machine's alarms.
        access_190_kept: in how many the access pressure stays below 190 mmHg.
        above_atmosphere: in how many both lines attach above atmospheric pressure.
        smallest_flow: smallest over the points of the ECMO flow up to which all limits of the CRRT lines are
            kept [L/min]; 0 if a point keeps them at no speed.
        median_flow: median of it.
    """

    letter: str
    first: int
    median_rank: float
    worst_rank: int
    alarms_kept: int
    access_190_kept: int
    above_atmosphere: int
    smallest_flow: float
    median_flow: float


def crrt_cohort(
    fitted: FittedCases,
    *,
    schemes: str | Sequence[str] = NINE,
    speeds: str | Sequence[float] = USUAL_SPEEDS,
    crrt_flow_ml_min: float | None = None,
    volume_policy: str = BOTH,
    scheme_h: str = PUBLISHED,
    progress: Callable[[str], None] = lambda _: None,
) -> CohortStudy:
    """Run the study for every case, each at its own speed and over the same range of speeds.

    Args:
        fitted: the cases.
        schemes: letters, groups and pairs, see `select_schemes`.
        speeds: pump speeds [rpm]; each case's own is added.
        crrt_flow_ml_min: blood flow of the CRRT; left out, each case's own, else 200 mL/min.
        volume_policy: "as_published", "patient_held" or "both".
        scheme_h: "published" or "figure".
        progress: is told what is being computed.

    Raises:
        StudyError: If no case can be studied.
    """
    from eclsim.studies.crrt_settings import StudyError

    points, lost, chosen = [], dict(fitted.lost), ()
    for k, (name, case) in enumerate(fitted.cases.items()):
        progress(f"schemes: {k + 1} of {len(fitted.cases)} data points")
        try:
            study = crrt_study(
                case, schemes=schemes, speeds=speeds, crrt_flow_ml_min=crrt_flow_ml_min,
                volume_policy=volume_policy, scheme_h=scheme_h,
            )  # fmt: skip
        except StudyError as error:
            lost[name] = str(error)
            continue
        chosen = study.schemes
        points.append(_point(name, study))
    if not points:
        raise StudyError("no data point can be studied: " + "; ".join(f"{k}: {v}" for k, v in lost.items()))
    return CohortStudy(tuple(points), chosen, fitted, crrt_flow_ml_min, lost)


def _point(name: str, study: CrrtStudy) -> PointResult:
    policy, speed = study.policies[0], study.case_speed
    alone = study.without_crrt.sel(policy=policy, speed=speed)
    means = study.means.sel(speed=speed)
    spread = means["MAP"].max("scheme") - means["MAP"].min("scheme")
    taken = np.nan if study.uptake is None else float(study.uptake["blood_taken_up"].max())
    variation = {p: float(spread.sel(policy=p)) for p in study.policies}
    unsettled = int((~study.means["converged"]).sum()) + int((~study.without_crrt["converged"]).sum())
    return PointResult(
        name, float(alone["PF"]), float(alone["MAP"]), speed, study.ranking, variation, taken, unsettled
    )


def summaries(study: CohortStudy, policy: str) -> tuple[SchemeSummary, ...]:
    """Every scheme over the cohort: most often first, then the better median place."""
    found = []
    for scheme in study.schemes:
        ones = [next(r for r in p.ranking[policy] if r.letter == scheme.letter) for p in study.points]
        ranks, flows = [r.rank for r in ones], np.nan_to_num([r.largest_flow for r in ones])
        found.append(
            SchemeSummary(
                scheme.letter, sum(r == 1 for r in ranks), float(np.median(ranks)), max(ranks),
                sum(r.alarms_kept for r in ones), sum(r.access_190_kept for r in ones),
                sum(r.lowest_site_pressure >= 0.0 for r in ones), float(flows.min()), float(np.median(flows)),
            )
        )  # fmt: skip
    return tuple(sorted(found, key=lambda one: (-one.first, one.median_rank, one.worst_rank)))


def answer(study: CohortStudy, policy: str) -> str:
    """Does one scheme win for all, in a sentence."""
    winners = {letter: count for letter, count in study.winners(policy).items() if count}
    best, count = next(iter(winners.items()))
    total = len(study.points)
    if count == total:
        return f"Yes: scheme {best} is first in all {total} data points."
    others = ", ".join(f"{letter} in {n}" for letter, n in list(winners.items())[1:])
    said = f"No: scheme {best} is first in {count} of {total} data points, {others}."
    return f"{said} {_where_not(study, policy, best)}"


def _where_not(study: CohortStudy, policy: str, letter: str) -> str:
    """Why the scheme that is first most often is not first in the other points."""
    ones = [next(r for r in p.ranking[policy] if r.letter == letter) for p in study.points]
    lost = [one for one in ones if one.rank > 1]
    alarms = sum(not one.alarms_kept for one in lost)
    access = sum(one.alarms_kept and not one.access_190_kept for one in lost)
    reasons = [
        f"breaks an alarm in {alarms}" if alarms else "",
        f"exceeds 190 mmHg of access pressure in {access}" if access else "",
        f"stands behind for other reasons in {len(lost) - alarms - access}"
        if len(lost) > alarms + access
        else "",
    ]
    place = f"and is placed {max(one.rank for one in lost)} at worst"
    return f"Elsewhere {letter} {', '.join(filter(None, reasons))}, {place}."
