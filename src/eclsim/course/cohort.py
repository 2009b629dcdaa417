"""Courses of many members (patients of a cohort or draws of parameters), computed in groups."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from eclsim.arguments import number_of, written
from eclsim.cases.case import Case
from eclsim.cases.reading import case_text
from eclsim.course.course import checked_interval_min, course_many
from eclsim.course.engine import CourseOptions
from eclsim.course.result import attributes_of
from eclsim.course.timeline import MINUTE, Timeline
from eclsim.devices.registry import digests_of_own_files
from eclsim.execution import (
    Executor,
    Progress,
    Tasks,
    announce,
    as_executor,
    as_folder,
    complete_in,
    digest_of_text,
    json_format,
)
from eclsim.orbit.model import CaseSource, as_case
from eclsim.simulation.target_flow import FlowNotReachedError, with_speed

MEMBERS_PER_GROUP = 32
"""Number of members computed side by side; an interruption loses at most one such group."""
PRELOAD = ("eclsim.course.cohort", "eclsim.outputs.steady_beat")
"""Modules that a worker imports before its first group."""
_FORMAT = json_format(list[dict[str, Any]])


@dataclass(frozen=True)
class Members:
    """Members of a group.

    Args:
        cases: cases of the members, or one case whose variants are given by `changes`.
        changes: values of each parameter that varies, by key.
        refused: reason why each case is not followed, or empty; no entries for variants.
    """

    cases: tuple[Case, ...]
    changes: Mapping[str, tuple[float, ...]]
    refused: tuple[str, ...] = ()

    def reason(self, number: int) -> str:
        """Reason why a case is not followed; empty if it is."""
        return self.refused[number] if self.refused else ""


@dataclass(frozen=True)
class CourseGroup:
    """Computes the courses of a group side by side; see `eclsim.course.course.course_many`."""

    minutes: float
    every_min: float
    volume_policy: str | None
    hand_over: bool

    def __call__(self, members: Members) -> list[dict[str, Any]]:
        """Return each course as plain data; the reason for a case whose pump flow no speed can reach."""
        announce(f"{len(members.cases)} patients" if not members.changes else "draws of a patient")
        reasons = [members.reason(k) or self._unreachable(case) for k, case in enumerate(members.cases)]
        begun = [case for case, reason in zip(members.cases, reasons, strict=True) if not reason]
        followed = course_many(
            begun, members.changes, minutes=self.minutes, every_min=self.every_min,
            volume_policy=self.volume_policy, options=CourseOptions(hand_over=self.hand_over),
        ) if begun else []  # fmt: skip
        courses = iter(followed)
        if not any(reasons):
            return [course.to_dict() for course in courses]
        each = zip(members.cases, reasons, strict=True)
        return [
            (self._refused_course(c, refusal) if refusal else next(courses)).to_dict() for c, refusal in each
        ]

    def _unreachable(self, case: Case) -> str:
        """Reason why no speed gives the pump flow of a case; empty if one does."""
        try:
            with_speed(case, self.volume_policy)
        except FlowNotReachedError as error:
            return str(error)
        return ""

    def _refused_course(self, case: Case, reason: str) -> xr.Dataset:
        timeline, policy = Timeline(case, self.minutes * MINUTE), self.volume_policy or case.volume_policy
        message = f"not begun: {reason}"
        about = attributes_of(timeline, policy, message, {}, [message])
        nothing = {"alarms": "[]", "settling_s": 0.0, "beat_by_beat": 0, "seconds": 0.0}
        return xr.Dataset(coords={"time_min": np.zeros(0)}, attrs=about | nothing)


def course_cohort(
    cases: Sequence[CaseSource],
    *,
    minutes: float,
    every_min: float | None = None,
    volume_policy: str | None = None,
    hand_over: bool = True,
    folder: Path | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> list[xr.Dataset]:
    """Simulate courses of a cohort's patients as resumable tasks; bitwise equal on any number of workers.

    Args:
        cases: paths of case files, what `read_case` returned, or cases; each with its `[[events]]`.
        minutes: duration [min].
        every_min: interval between moments shown [min]; None gives about 144 moments.
        volume_policy: blood volume policy; None takes that of each case.
        hand_over: see `CourseOptions`.
        folder: folder that stores the courses; None keeps them in memory only.
        executor: runs the groups; None runs them in this process.
        progress: called when a group is done.

    Returns:
        One Dataset for each case, as of `eclsim.course`. A case that could not begin, or whose file is marked
        as a poor fit, has no moments and a message with the reason. `seconds` is the time of the whole group.

    Raises:
        CaseError: A file is no case, or an event is after the end.
        ExecutionError: The folder holds other courses, or workers cannot be reached.
        ShardDone: This run computed one shard only.
    """
    minutes = number_of("minutes", minutes)
    executor, folder = as_executor(executor), as_folder(folder)
    if isinstance(cases, (str, Case)) or not isinstance(cases, Iterable):
        raise TypeError(f"cases: {written(cases)} is not a list of cases; allowed: a list of paths or cases")
    patients = tuple(as_case(source) for source in cases)
    for case in patients:
        Timeline(case, minutes * MINUTE)
    compute = CourseGroup(minutes, checked_interval_min(every_min, minutes), volume_policy, hand_over)
    poor = tuple(case.refusal for case in patients)
    groups = [
        Members(patients[k : k + MEMBERS_PER_GROUP], {}, poor[k : k + MEMBERS_PER_GROUP])
        for k in range(0, len(patients), MEMBERS_PER_GROUP)
    ]
    inputs: dict[str, object] = {
        "cases": {f"{n} {case.patient.id}": _digests(case) for n, case in enumerate(patients, start=1)}
    }
    inputs |= {"poor fits": list(poor)} if any(poor) else {}
    return _complete(compute, groups, inputs, "groups of patients", folder, executor, progress)


def courses_of_draws(
    case: Case,
    samples: Mapping[str, Sequence[float]],
    compute: CourseGroup,
    folder: Path | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> list[xr.Dataset]:
    """Courses of one case with each draw of its parameters; see `course_cohort`."""
    count = len(next(iter(samples.values())))
    groups = [
        Members((case,), {key: tuple(values[k : k + MEMBERS_PER_GROUP]) for key, values in samples.items()})
        for k in range(0, count, MEMBERS_PER_GROUP)
    ]
    columns = {key: list(values) for key, values in samples.items()}
    rest = None if case.as_written is None else case.as_written.as_mapping()
    inputs = {
        "case": case.as_mapping(), "set_points_of": rest, "values": digest_of_text(json.dumps(columns)),
        "draws": count,
    }  # fmt: skip
    return _complete(compute, groups, inputs, "groups of draws", folder, executor, progress)


def _complete(
    compute: CourseGroup,
    groups: Sequence[Members],
    inputs: Mapping[str, object],
    unit: str,
    folder: Path | None,
    executor: Executor | None,
    progress: Progress | None,
) -> list[xr.Dataset]:
    tasks = Tasks(
        "courses", unit, compute, groups, {**inputs, "course": vars(compute), **digests_of_own_files()},
        side_by_side=len(groups) > 1,
    )  # fmt: skip
    results = complete_in(folder, "", tasks, _FORMAT, executor, progress)
    return [xr.Dataset.from_dict(course) for group in results for course in group]


def _digests(case: Case) -> dict[str, str]:
    """Digest of a case (its text without events, and as written) and, separately, of its events."""
    bare = (case.model_copy(update={"events": ()}), *([case.as_written] if case.as_written else ()))
    events = [event.as_object() for event in case.events]
    return {
        "case": digest_of_text("".join((*map(case_text, bare), *case.doubts))),
        "events": digest_of_text(json.dumps(events)),
    }
