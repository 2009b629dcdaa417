"""Numbers of the paper beside what eclsim computes, with the reason where they differ."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eclsim.parameters.thiel2025 import PARAMETERS
from eclsim.patients.resolve import resolve_parameters
from eclsim.solver.model import AS_PUBLISHED
from eclsim.studies.crrt_study import CrrtStudy, crrt_study
from eclsim.studies.paper_patient import Unstated, explained_case, paper_case, search_unstated, tolerance_of
from eclsim.studies.published_crrt import ALL_PRINTED, Printed
from eclsim.studies.published_tables import TABLES


@dataclass(frozen=True)
class Row:
    """One number.

    Args:
        section: where it is printed.
        quantity: what it is.
        unit: of the values.
        paper: as printed.
        ours: for the patient as assumed.
        explained: with the blood volume and heart rate that the numbers of section 3.3 ask for.
        digits: decimals printed.
        as_printed: whether ours, rounded, is what is printed (model tolerance 0.1 %).
        why: the reason where it is not.
    """

    section: str
    quantity: str
    unit: str
    paper: float
    ours: float
    explained: float | None
    digits: int
    as_printed: bool
    why: str

    @property
    def difference(self) -> float:
        """Ours less the paper's."""
        return self.ours - self.paper

    @property
    def difference_percent(self) -> float:
        """Difference relative to the paper's value."""
        return 100.0 * self.difference / abs(self.paper) if self.paper else np.nan


@dataclass(frozen=True)
class Reproduction:
    """The comparison.

    Args:
        rows: one for each number.
        unstated: what the paper does not say about the patient of section 3.3, as found.
        study: the CRRT study of the patient as assumed.
        explained: the same with the values found.
    """

    rows: tuple[Row, ...]
    unstated: Unstated
    study: CrrtStudy
    explained: CrrtStudy


def reproduce(progress: Callable[[str], None] = lambda _: None) -> Reproduction:
    """Compute everything and set it beside the paper's numbers."""
    progress("blood volume and heart rate of the paper's patient")
    unstated = search_unstated()
    studies = []
    for words, case in (("as assumed", paper_case()), ("as found", explained_case(unstated))):
        progress(f"CRRT study of the paper's patient, {words}")
        studies.append(crrt_study(case, volume_policy=AS_PUBLISHED))
    rows = [_row(p, studies[0], studies[1], unstated) for p in ALL_PRINTED]
    return Reproduction((*rows, *table_rows()), unstated, studies[0], studies[1])


def compute(printed: Printed, study: CrrtStudy) -> float:
    """What the study says for a printed number."""
    kind, *arguments = printed.key
    if kind in ("summary", "is"):
        speed, name = arguments[:2]
        found = study.summary[str(name)].sel(policy=AS_PUBLISHED, speed=speed).item()
        return float(found == arguments[2]) if kind == "is" else float(found)
    if kind == "mean":
        speed, letter, name = arguments
        return float(study.means[str(name)].sel(policy=AS_PUBLISHED, speed=speed, scheme=letter))
    if kind not in ("flow", "first"):
        raise ValueError(f"no way to compute {printed.key}")
    flows = study.limits["largest_flow"].sel(policy=AS_PUBLISHED, limit=arguments[0])
    if kind == "flow":
        return float(flows.sel(scheme=list(str(arguments[1]))).mean())
    return float(flows.min())


def table_rows() -> list[Row]:
    """A row for each value of Tables S-1 to S-4, printed and used."""
    used = {key: parameter.value for key, parameter in PARAMETERS.items()}
    patient = resolve_parameters(paper_case())
    rows = []
    for table, printed in TABLES.items():
        values = patient if table == "S-4" else used
        for name, value in printed.items():
            same = values[name] == value
            unit = PARAMETERS[name].unit
            rows.append(Row(f"Table {table}", name, unit, value, values[name], None, 6, same, ""))
    return rows


def _row(printed: Printed, study: CrrtStudy, explained: CrrtStudy, unstated: Unstated) -> Row:
    ours, found = compute(printed, study), compute(printed, explained)
    tolerance = tolerance_of(printed)
    same = abs(ours - printed.value) <= tolerance
    reasons = []
    if not same and abs(found - printed.value) <= tolerance:
        reasons.append(
            f"the patient's blood volume is not printed; with {unstated.blood_volume_ml:.0f} mL it agrees"
        )
    elif not same and printed.remark:
        reasons.append(printed.remark)
    elif not same:
        reasons.append(f"with {unstated.blood_volume_ml:.0f} mL of blood {found:.{printed.digits + 1}f}")
    return Row(
        printed.section, printed.words, printed.unit, printed.value, ours, found, printed.digits, same,
        "; ".join(reasons),
    )  # fmt: skip
