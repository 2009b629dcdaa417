"""Fitted cases of a cohort: what a study of many patients starts from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.identification.cohort_fit import FitStore, fit_cohort
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.settings import FitSettings

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.cases.cohort import CohortReading


@dataclass(frozen=True)
class FittedCases:
    """Cases with their own parameters.

    Args:
        cases: by name of the data point.
        misfits: root mean square of the relative differences of each fit, by name; empty if they came fitted.
        lost: data points that could not be fitted, and why.
        words: how the parameters were found.
    """

    cases: Mapping[str, Case]
    misfits: Mapping[str, float]
    lost: Mapping[str, str]
    words: str


def fit_points(
    reading: CohortReading,
    folder: Path,
    explore: int,
    resume: bool = False,
    progress: Callable[[str], None] = lambda _: None,
    policy: str = "as_published",
) -> FittedCases:
    """Fit every data point of a table with the paper's seven parameters.

    Args:
        reading: of the table.
        folder: keeps the fits.
        explore: explored sets of parameters for each free one.
        resume: whether to go on with what the folder holds.
        progress: is told what is being computed.
        policy: blood volume policy of the fits.
    """
    settings = FitSettings(multi_start=MultiStart.quick(explore), policy=policy)
    store = FitStore(folder, reading.digest, settings)
    store.open(resume=resume and (folder / "settings.json").exists(), force=not resume)
    results = fit_cohort(reading.points, settings, store, progress)
    cases, misfits, lost = {}, {}, {}
    for point, result in zip(reading.points, results, strict=True):
        if result["cost"] is None:
            lost[point.name] = result["message"]
            continue
        cases[point.name] = with_fitted(point.case, result)
        count = sum(cell["measured"] is not None for cell in result["outputs"].values())
        misfits[point.name] = (result["cost"] / max(count, 1)) ** 0.5
    words = f"fitted to the table with {', '.join(settings.parameters)} free, {explore} explored sets each"
    return FittedCases(cases, misfits, lost, words)


def with_fitted(case: Case, result: Mapping[str, Any]) -> Case:
    """A case with the parameters of a result of `fit_cohort`."""
    fitted = {name: cell["value"] for name, cell in result["parameters"].items()}
    return case.model_copy(update={"parameters": {**case.parameters, **fitted}})


def as_they_are(cases: Sequence[Case], where: str) -> FittedCases:
    """Cases that have their parameters already."""
    return FittedCases({case.patient.id: case for case in cases}, {}, {}, f"read from {where}")
