"""Sections 3.3 and 4, Figures 5 and 6, Tables S-1 to S-4: the CRRT study of the paper's patient."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eclsim.cases.resolve import resolve_parameters
from eclsim.crrt_study.limits import LIMITS
from eclsim.crrt_study.study import CrrtStudy, crrt_study
from eclsim.orbit.model import AS_PUBLISHED
from eclsim.paper.claims import CLAIMS, Claim
from eclsim.paper.patient import Unstated, explained_case, paper_case, search_unstated, tolerance_of
from eclsim.paper.published_crrt import ALL_PRINTED, NEAR_ZERO, Printed
from eclsim.paper.published_tables import TABLES
from eclsim.paper.rows import Row, Verdict, statement
from eclsim.parameters.thiel2025 import PARAMETERS


@dataclass(frozen=True)
class CrrtPart:
    """The CRRT study beside the paper.

    Args:
        rows: one for each number and statement.
        unstated: what the paper does not say about the patient of section 3.3, as found.
        study: the CRRT study of the patient as assumed.
        explained: the same with the values found.
    """

    rows: tuple[Row, ...]
    unstated: Unstated
    study: CrrtStudy
    explained: CrrtStudy


def reproduce_crrt(progress: Callable[[str], None] = lambda _: None) -> CrrtPart:
    """Compute the study twice, as assumed and with the unstated values found, and compare."""
    progress("blood volume and heart rate of the paper's patient")
    unstated = search_unstated()
    studies = []
    for words, case in (("as assumed", paper_case()), ("as found", explained_case(unstated))):
        progress(f"CRRT study of the paper's patient, {words}")
        studies.append(crrt_study(case, volume_policy=AS_PUBLISHED))
    rows = [_row(p, studies[0], studies[1], unstated) for p in ALL_PRINTED]
    rows += [_claim(claim, studies[0], studies[1]) for claim in CLAIMS]
    return CrrtPart(tuple(rows), unstated, studies[0], studies[1])


def compute(printed: Printed, study: CrrtStudy) -> float:
    """What the study says for a printed number."""
    kind, *arguments = printed.key
    if kind == "summary":
        speed, name = arguments
        return float(study.summary[str(name)].sel(policy=AS_PUBLISHED, speed=speed))
    if kind == "mean":
        speed, letter, name = arguments
        return float(study.means[str(name)].sel(policy=AS_PUBLISHED, speed=speed, scheme=letter))
    if kind == "low":
        return _lowest_alarm(study, str(arguments[0]))
    if kind not in ("flow", "first"):
        raise ValueError(f"no way to compute {printed.key}")
    flows = study.limits["largest_flow"].sel(policy=AS_PUBLISHED, limit=arguments[0])
    if kind == "flow":
        return float(flows.sel(scheme=list(str(arguments[1]))).mean())
    return float(flows.min())


def _lowest_alarm(study: CrrtStudy, name: str) -> float:
    """Smallest ECMO flow at which a scheme reaches a low alarm [L/min]."""
    (limit,) = (one for one in LIMITS if one.name == name)
    found = []
    for letter in study.means["scheme"].values:
        one = study.means.sel(policy=AS_PUBLISHED, scheme=letter)
        pressure, flow = one[limit.quantity].values, one["PF"].values
        if pressure.min() < limit.low:
            found.append(float(np.interp(-limit.low, -pressure, flow)))
    return min(found) if found else np.nan


def table_rows() -> list[Row]:
    """A row for each value of Tables S-1 to S-4, printed and used."""
    used = {key: parameter.value for key, parameter in PARAMETERS.items()}
    patient = resolve_parameters(paper_case())
    return [
        Row(f"Table {table}", name, PARAMETERS[name].unit, value, (patient if table == "S-4" else used)[name],
            None, 6, 0.0)
        for table, printed in TABLES.items()
        for name, value in printed.items()
    ]  # fmt: skip


def _row(printed: Printed, study: CrrtStudy, explained: CrrtStudy, unstated: Unstated) -> Row:
    row = Row(
        printed.section, printed.words, printed.unit, printed.value, compute(printed, study),
        compute(printed, explained), printed.digits, tolerance_of(printed), "", printed.other_data,
    )  # fmt: skip
    if row.as_printed:
        return row
    volume = f"{unstated.blood_volume_ml:.0f} mL"
    if row.verdict is Verdict.EXPLAINED:
        return row.because(f"by {volume} of blood, which are not printed")
    why = printed.remark or f"{volume} of blood, which are not printed, bring it nearer"
    return row.because(why + (_near_zero(printed, explained) if printed.remark == NEAR_ZERO else ""))


def _near_zero(printed: Printed, explained: CrrtStudy) -> str:
    """How much the median would have to be off for the printed percentage."""
    speed, name = printed.key[1], str(printed.key[2]).removesuffix("_variation_percent")
    one = explained.summary.sel(policy=AS_PUBLISHED, speed=speed)
    median, variation = float(one[f"{name}_median"]), float(one[f"{name}_variation"])
    needed = 100.0 * variation / printed.value - abs(median)
    return f": a median {abs(needed):.3f} mmHg {'larger' if needed > 0.0 else 'smaller'} gives it"


def _claim(claim: Claim, study: CrrtStudy, explained: CrrtStudy) -> Row:
    return statement(claim.section, claim.words, claim.holds(study), claim.why, claim.holds(explained))
