"""Fit a cohort: groups of data points run as tasks, each stored when done, on one machine or many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.cases.fit_mark import NOT_STUDIED, FitMark, with_mark
from eclsim.cases.reading import case_text
from eclsim.devices.registry import digests_of_own_files
from eclsim.execution import Executor, Progress, Tasks, announce, complete_in, json_format
from eclsim.files import file_stems, write_text
from eclsim.identification.fit import FitResult, failed_fit, fit_cases
from eclsim.identification.multi_start import FitStatus
from eclsim.identification.quantities import FLOWS, GASES, PRESSURES, measured_and_simulated
from eclsim.identification.settings import FitSettings
from eclsim.identification.solutions import with_solutions_sought
from eclsim.identification.verdict import Level, headline
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.model import CaseSource, as_case, circuit_of

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.cases.cohort import CohortPoint, CohortReading
    from eclsim.circuit.network import Circuit

POINTS_PER_GROUP = 8
"""Number of data points that are fitted side by side; an interruption loses at most one such group."""
PRELOAD = ("scipy.optimize", "eclsim.identification.cohort", "eclsim.outputs.steady_beat")
"""Modules that a worker imports before its first group."""
GROUPS, CASES = "groups", "cases"
"""Subfolders of the stored results and of the fitted case files."""


@dataclass(frozen=True)
class StoredFit:
    """A fit as it is stored: its numbers and the text of the fitted case file (None without a fit)."""

    numbers: dict[str, Any]
    case: str | None


_FORMAT = json_format(list[StoredFit])
Group = tuple["CohortPoint", ...]


@dataclass(frozen=True)
class FitGroup:
    """Fits the points of a group side by side."""

    settings: FitSettings

    def __call__(self, group: Group) -> list[StoredFit]:
        """Return the fits in the order of the points."""
        stored = []
        for point, fit in zip(group, self._fits([(p.name, p.case) for p in group]), strict=True):
            of_point = {name: getattr(point, name) for name in ("patient_id", "measurement", "line")}
            text = fitted_text(fit) if fit.simulated else None
            stored.append(StoredFit(fit.as_object() | of_point, text))
        return stored

    def _fits(self, cases: Sequence[tuple[str, Case]]) -> list[FitResult]:
        """Fit cases; an error in one fit does not end the others, unless the cases share parameters.

        Other patients who fit as well are sought where gases were measured: there it costs little.
        """
        try:
            fits = fit_cases(cases, self.settings, lambda step: announce(str(step)))
            return [with_solutions_sought(fit) if {*GASES} & {*fit.measured} else fit for fit in fits]
        except (CaseError, MemoryError, OSError):  # concerns the whole run, not one point
            raise
        except Exception as error:  # no error of one fit may end the whole cohort
            if len(cases) > 1 and not self.settings.shared:
                return [fit for case in cases for fit in self._fits([case])]
            return [failed_fit(name, case, self.settings, error) for name, case in cases]


def fit_tasks(
    points: Sequence[CohortPoint], settings: FitSettings, digest: str
) -> Tasks[Group, list[StoredFit]]:
    """Return the tasks that fit the groups of a cohort."""
    inputs = {"cohort_file": digest, "points": len(points), **settings.as_object(), **digests_of_own_files()}
    return Tasks(
        "fits", "groups of data points", FitGroup(settings), _groups(points, bool(settings.shared)), inputs
    )


def fit_cohort(
    points: Sequence[CohortPoint],
    settings: FitSettings,
    *,
    digest: str,
    folder: Path | None,
    executor: Executor,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Fit all points, write the fitted case files to the folder, and return the results in order.

    Args:
        points: data points of the cohort.
        settings: free parameters, weights and extent of the search.
        digest: digest of the cohort's file.
        folder: folder that stores the fits; None keeps them in memory only.
        executor: runs the groups.
        progress: called when a group is done, and with a description of the current step.

    Raises:
        ExecutionError: The folder holds other fits, or workers cannot be reached.
        ShardDone: This run computed one shard only.
    """
    tasks = fit_tasks(points, settings, digest)
    groups = complete_in(folder, GROUPS, tasks, _FORMAT, executor, progress)
    fits = [fit for group in groups for fit in group]
    if folder is not None:
        _write_cases(folder / CASES, fits)
    by_name = {fit.numbers["id"]: fit.numbers for fit in fits}
    return [by_name[point.name] for point in points]


def _write_cases(folder: Path, fits: Sequence[StoredFit]) -> None:
    """Write the fitted case files and delete those of earlier runs."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.toml"):
        old.unlink()
    stems = file_stems([fit.numbers["id"] for fit in fits])
    for stem, fit in zip(stems, fits, strict=True):
        if fit.case is not None:
            write_text(fit.case, folder / f"{stem}.toml")


def with_name(case: Case, name: str) -> Case:
    """Return the case with the name of its data point as id; unchanged if the name is too long for an id."""
    if len(name) > 64:
        return case
    return case.model_copy(update={"patient": case.patient.model_copy(update={"id": name})})


def fitted_text(fit: FitResult) -> str:
    """Return the text of the fitted case file, with the verdict on the fit."""
    case = fit.case if fit.name == fit.case.patient.id else with_name(fit.case, fit.name)
    return with_mark(case_text(case), fit.verdict.level, fit.verdict.headline)


def _groups(points: Sequence[CohortPoint], by_patient: bool) -> list[Group]:
    """Group points of the same circuit, a few at a time; with `by_patient`, all points of one patient."""
    by_circuit: dict[tuple[Circuit, str], list[CohortPoint]] = {}
    for point in points:
        key = (circuit_of(point.case), point.patient_id if by_patient else "")
        by_circuit.setdefault(key, []).append(point)
    size = len(points) if by_patient else POINTS_PER_GROUP
    return [tuple(same[k : k + size]) for same in by_circuit.values() for k in range(0, len(same), size)]


def patients_of_several_circuits(points: Sequence[CohortPoint]) -> dict[str, list[int]]:
    """Lines of patients whose data points have different circuits, so that they share no parameter."""
    groups = _groups(points, by_patient=True)
    patients = [group[0].patient_id for group in groups]
    return {
        patient: [point.line for point in points if point.patient_id == patient]
        for patient in dict.fromkeys(patients)
        if patients.count(patient) > 1
    }


# --- for studies of many patients ----------------------------------------------------------------------


@dataclass(frozen=True)
class FittedCases:
    """Cases with individual parameters, given or fitted.

    Args:
        cases: cases by name of the data point; for a shard, only those of that shard.
        misfits: root mean square of the relative differences of each fit, by name; empty if cases were given
            with their parameters.
        not_fitted: rows that were refused, data points without a fit or with a poor one, and the reason.
        description: how the parameters were found, as text.
        groups: all groups of names that are studied together.
        inputs: everything that determines the cases, as plain data.
    """

    cases: Mapping[str, Case]
    misfits: Mapping[str, float]
    not_fitted: Mapping[str, str]
    description: str
    groups: tuple[tuple[str, ...], ...]
    inputs: Mapping[str, object] = field(default_factory=dict)


def fit_points(
    reading: CohortReading,
    settings: FitSettings,
    *,
    folder: Path | None,
    executor: Executor,
    progress: Progress | None = None,
) -> FittedCases:
    """Return the fitted cases of a table; for a shard, only those of its own groups."""
    tasks = fit_tasks(reading.points, settings, reading.digest)
    place = None if folder is None else folder / GROUPS
    results = executor.completed_by_this_shard(tasks, place, _FORMAT, progress)
    cases, misfits, not_fitted = {}, {}, reading.refusals
    for number, fits in results.items():
        for point, fit in zip(tasks.arguments[number], fits, strict=True):
            numbers = fit.numbers
            if numbers["cost"] is None or numbers["status"] == FitStatus.ONE_OF_MANY:
                not_fitted[point.name] = numbers["message"]
                continue
            if numbers["verdict"]["level"] == Level.POOR:
                not_fitted[point.name] = f"{headline(numbers['verdict'])}; {NOT_STUDIED}"
                continue
            cases[point.name] = with_fitted_parameters(point.case, numbers)
            count = sum(cell["measured"] is not None for cell in numbers["outputs"].values())
            misfits[point.name] = (numbers["cost"] / max(count, 1)) ** 0.5
    explored = settings.multi_start.points_per_parameter
    description = (
        f"fitted to the table with {', '.join(settings.parameters)} free, {explored} explored sets each"
    )
    groups = tuple(tuple(point.name for point in group) for group in tasks.arguments)
    order = {point.name: k for k, point in enumerate(reading.points)}
    cases = {name: cases[name] for name in sorted(cases, key=order.__getitem__)}
    return FittedCases(cases, misfits, not_fitted, description, groups, tasks.inputs)


def with_fitted_parameters(case: Case, result: Mapping[str, Any]) -> Case:
    """Return a case with the parameters and the verdict of a result of `fit_cohort`."""
    fitted = {name: cell["value"] for name, cell in result["parameters"].items()}
    mark = FitMark(str(result["verdict"]["level"]), is_changed=False)
    return case.model_copy(update={"parameters": {**case.parameters, **fitted}, "fit_mark": mark})


def cases_as_given(
    cases: Sequence[CaseSource], where: str, lost: Sequence[tuple[CaseSource, str]] = ()
) -> FittedCases:
    """Return cases that already have their parameters; cases marked as poor fits are left out.

    Args:
        cases: the cases; those with the id of another one are told apart by file or number.
        where: where they come from, in words.
        lost: further cases that cannot be studied, each with the reason.
    """
    names = _names_of([*cases, *(case for case, _ in lost)])
    by_name = dict(zip(names, map(as_case, cases), strict=False))
    poor = {name: case.refusal for name, case in by_name.items() if case.refusal}
    inputs: dict[str, object] = {"cases": {name: case_text(case) for name, case in by_name.items()}}
    inputs |= digests_of_own_files() | ({"poor fits": poor} if poor else {})
    groups = tuple((name,) for name in by_name)
    kept = {name: case for name, case in by_name.items() if name not in poor}
    not_fitted = poor | {name: reason for name, (_, reason) in zip(names[len(cases) :], lost, strict=True)}
    return FittedCases(kept, {}, not_fitted, f"read from {where}", groups, inputs)


def _names_of(cases: Sequence[CaseSource]) -> list[str]:
    """Ids of cases; one that several cases have is followed by the file of each, else by a number."""
    ids = [as_case(case).patient.id for case in cases]
    names: list[str] = []
    for k, (case, name) in enumerate(zip(cases, ids, strict=True)):
        if ids.count(name) > 1:
            file = getattr(case, "file", case if isinstance(case, (str, Path)) else "")
            name = f"{name} ({Path(file).name or k + 1})"
        names.append(name if name not in names else f"{name} ({k + 1})")
    return names


# --- goodness of fit of a cohort -----------------------------------------------------------------------


def r_squared(results: Sequence[Mapping[str, Any]]) -> dict[str, float | None]:
    """Compute R2 of all pressures and of all flows: 1 - residual sum of squares / total sum of squares."""
    return {"pressures": _r_squared(results, PRESSURES), "flows": _r_squared(results, FLOWS)}


def _r_squared(results: Sequence[Mapping[str, Any]], names: Sequence[str]) -> float | None:
    values = measured_and_simulated(results, names)
    if len(values) < 2 or np.ptp(values[:, 0]) == 0.0:
        return None
    measured, simulated = values.T
    return float(1.0 - np.sum((measured - simulated) ** 2) / np.sum((measured - measured.mean()) ** 2))
