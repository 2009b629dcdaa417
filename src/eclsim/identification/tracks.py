"""Series of many patients: each patient is a task, stored when done, on one machine or many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from eclsim.cases.reading import case_text
from eclsim.devices.registry import digests_of_own_files
from eclsim.execution import Executor, Progress, Tasks, announce, complete_in, digest_of_text, json_format
from eclsim.files import finite
from eclsim.identification.tracking import TrackSettings, track

if TYPE_CHECKING:
    from eclsim.cases.case import Case

PRELOAD = ("eclsim.identification.tracks", "eclsim.outputs.steady_beat")
"""Modules that a worker imports before its first patient."""
PATIENTS = "patients"
"""Subfolder of the stored results."""
_FORMAT = json_format(dict[str, Any])


@dataclass(frozen=True)
class PatientSeries:
    """Measurements of one patient.

    Args:
        points: name and case of each measurement in order of time.
        settings: what is tracked and how.
        left_out: number of missing measurements before each point, as for `track`.
    """

    points: tuple[tuple[str, Case], ...]
    settings: TrackSettings
    left_out: tuple[int, ...] = ()

    def as_inputs(self) -> dict[str, object]:
        """All that determines the result, as plain data."""
        texts = [f"{name}\n{case_text(case)}" for name, case in self.points]
        return {
            "measurements": digest_of_text("\n".join(texts)),
            "left_out": list(self.left_out), "interval_hours": self.settings.interval_hours,
            **self.settings.as_object(),
        }  # fmt: skip


def followed(series: PatientSeries) -> dict[str, Any]:
    """Follow a patient and return the result as plain data; see `TrackResult.as_object`."""
    patient = series.points[0][1].patient.id

    def say(step: object) -> None:
        announce(f"{patient}: {step}")

    result = track(series.points, settings=series.settings, progress=say, left_out=series.left_out)
    return cast("dict[str, Any]", finite(result.as_object()))


def follow_patients(
    series: Mapping[str, PatientSeries],
    *,
    folder: Path | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Follow patients as resumable tasks; bitwise equal on any number of workers.

    Args:
        series: measurements of each patient, by id.
        folder: folder that stores what is followed; None keeps it in memory only.
        executor: runs the patients; None runs them in this process, one after another.
        progress: called when a patient is done, and with a description of the current step.

    Returns:
        Results as plain data, in the order of the patients.

    Raises:
        CaseError: One of the errors of `Tracker.update`.
        ExecutionError: The folder holds other results, or workers cannot be reached.
        ShardDone: This run computed one shard only.
    """
    inputs = {"series": {patient: one.as_inputs() for patient, one in series.items()}}
    each: Sequence[PatientSeries] = list(series.values())
    tasks = Tasks("tracking", "patients", followed, each, {**inputs, **digests_of_own_files()})
    return complete_in(folder, PATIENTS, tasks, _FORMAT, executor, progress)
