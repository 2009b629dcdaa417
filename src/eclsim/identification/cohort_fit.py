"""Fitting a cohort in batches, each data point kept as soon as it is done."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim._version import __version__
from eclsim.cases.writing import write_case
from eclsim.files import file_stem, write_json
from eclsim.identification.fit import FitResult, fit_cases
from eclsim.identification.settings import FitSettings

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.cases.cohort import CohortPoint

GROUP = 8
"""Data points that are fitted side by side; what an interruption costs at most."""
PRESSURES = ("SP", "DP", "MAP", "MPAP", "PCWP")
FLOWS = ("CO", "PF")
FORMAT = 2
"""Of the results that are kept: 2 has verdicts."""
_SETTINGS, _POINTS, _CASES = "settings.json", "points", "cases"


class StoreError(ValueError):
    """Results in a folder that cannot be continued, and why."""


class FitStore:
    """Finished data points in a folder.

    Args:
        folder: is made if it does not exist.
        digest: of the cohort's file.
        settings: of the fits.
    """

    def __init__(self, folder: Path, digest: str, settings: FitSettings):
        self.folder = folder
        made_of = {"eclsim": __version__, "format": FORMAT, "cohort_sha256": digest, **settings.as_object()}
        self.made_of: dict[str, Any] = json.loads(json.dumps(made_of))

    def open(self, resume: bool, force: bool) -> None:
        """Begin, or go on where an earlier run stopped.

        Raises:
            StoreError: Results are there already, or those to go on with were made of something else.
        """
        path = self.folder / _SETTINGS
        if path.exists() and resume:
            self._compare(path)
        elif path.exists() and not force:
            raise StoreError(
                f"{self.folder}: holds fits already; --resume goes on with them, --force begins anew"
            )
        else:
            self._clear()
        for name in (_POINTS, _CASES):
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        write_json(self.made_of, path)

    def _clear(self) -> None:
        for place, pattern in ((_POINTS, "*.json"), (_CASES, "*.toml")):
            for old in (self.folder / place).glob(pattern):
                old.unlink()

    def _compare(self, path: Path) -> None:
        try:
            before = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            raise StoreError(
                f"{path}: cannot be read, so nothing can be continued; --force begins anew"
            ) from None
        keys = dict.fromkeys([*self.made_of, *(before if isinstance(before, dict) else ())])
        wrong = [k for k in keys if not isinstance(before, dict) or before.get(k) != self.made_of.get(k)]
        if wrong:
            said = ", ".join(
                "the cohort's file has changed" if k == "cohort_sha256"
                else f"{k} was {before.get(k)!r} and is {self.made_of.get(k)!r}" if isinstance(before, dict)
                else k
                for k in wrong
            )  # fmt: skip
            raise StoreError(f"{self.folder}: cannot be continued: {said}; --force begins anew")

    def finished(self, names: Iterable[str]) -> dict[str, dict[str, Any]]:
        """Results of earlier runs, by name of the data point."""
        found = {}
        for name in names:
            path = self.folder / _POINTS / f"{stem(name)}.json"
            if not path.exists():
                continue
            try:
                kept = json.loads(path.read_text(encoding="utf-8"))
                whole = kept["sha256"] == _digest(kept["result"]) and kept["result"]["id"] == name
            except (OSError, ValueError, KeyError, TypeError):
                whole = False
            if not whole:
                raise StoreError(f"{path}: truncated or edited; take it away and the point is fitted again")
            found[name] = kept["result"]
        return found

    def save(self, fit: FitResult, labels: Mapping[str, Any]) -> dict[str, Any]:
        """Keep a fit: its case file, if anything was found, then its numbers."""
        if fit.simulated:
            write_case(named(fit.case, fit.name), self.folder / _CASES / f"{stem(fit.name)}.toml")
        result = {**fit.as_object(), **labels}
        path = self.folder / _POINTS / f"{stem(fit.name)}.json"
        write_json({"sha256": _digest(result), "result": result}, path)
        return result


def stem(name: str) -> str:
    """A file name for a data point; names that differ get file names that differ."""
    return file_stem(name, slashes=True)


def named(case: Case, name: str) -> Case:
    """The case under the name of its data point, where that is short enough for an id."""
    if len(name) > 64:
        return case
    return case.model_copy(update={"patient": case.patient.model_copy(update={"id": name})})


def fit_cohort(
    points: Sequence[CohortPoint],
    settings: FitSettings,
    store: FitStore,
    report: Callable[[str], None] | None = None,
    group: int = GROUP,
) -> list[dict[str, Any]]:
    """Fit all points that are not done yet; results in the order of the points.

    Args:
        points: of the cohort.
        settings: what is free, how it is weighted, how widely to look.
        store: opened.
        report: called with what is being done.
        group: data points side by side.
    """
    done = store.finished(p.name for p in points)
    before = len(done)
    waiting = [p for p in points if p.name not in done]
    if settings.shared:  # a patient's points are fitted together, or not at all
        open_patients = {p.patient_id for p in waiting}
        waiting = [p for p in points if p.patient_id in open_patients]
    for chosen in _groups(waiting, group, bool(settings.shared)):
        share = f"{len(done)} of {len(points)} data points done"
        share += f" ({before} of them by an earlier run)" if before else ""
        said = None if report is None else partial(_said, report, share)
        fits = fit_cases([(p.name, p.case) for p in chosen], settings, said)
        for point, fit in zip(chosen, fits, strict=True):
            labels = {"patient_id": point.patient_id, "measurement": point.measurement, "line": point.line}
            done[point.name] = store.save(fit, labels)
    return [done[p.name] for p in points]


def _said(report: Callable[[str], None], share: str, text: str) -> None:
    report(f"{share}; {text}")


def _groups(points: Sequence[CohortPoint], size: int, by_patient: bool) -> list[list[CohortPoint]]:
    """Points with the same circuit, some at a time, or all of a patient."""
    from eclsim.orbit.model import circuit_of

    by_circuit: dict[Any, list[CohortPoint]] = {}
    for point in points:
        key = (circuit_of(point.case), point.patient_id if by_patient else "")
        by_circuit.setdefault(key, []).append(point)
    if by_patient:
        return list(by_circuit.values())
    return [same[k : k + size] for same in by_circuit.values() for k in range(0, len(same), size)]


def r_squared(results: Sequence[Mapping[str, Any]]) -> dict[str, float | None]:
    """R2 of all pressures and of all flows, 1 - sum of squared differences / that about the mean."""
    return {"pressures": _r_squared(results, PRESSURES), "flows": _r_squared(results, FLOWS)}


def pairs(results: Sequence[Mapping[str, Any]], names: Sequence[str]) -> np.ndarray:
    """Measured and simulated values of some outputs wherever there are both, shape (values, 2)."""
    found = [
        (cell["measured"], cell["simulated"])
        for result in results
        for name in names
        if (cell := result["outputs"].get(name))
        and cell["measured"] is not None
        and cell["simulated"] is not None
    ]
    return np.array(found, dtype=float).reshape(-1, 2)


def _r_squared(results: Sequence[Mapping[str, Any]], names: Sequence[str]) -> float | None:
    values = pairs(results, names)
    if len(values) < 2 or np.ptp(values[:, 0]) == 0.0:
        return None
    measured, simulated = values.T
    return float(1.0 - np.sum((measured - simulated) ** 2) / np.sum((measured - measured.mean()) ** 2))


def _digest(result: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(result, sort_keys=True).encode()).hexdigest()
