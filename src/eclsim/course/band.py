"""Courses of draws of a patient's parameters as quantiles over time, with alarm probabilities."""

from __future__ import annotations

import json
import time as clock
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from eclsim.arguments import WholeNumber, number_of
from eclsim.cases.quantities import as_samples, check_samples
from eclsim.course.alarms import NO_PATIENT, NUMBER, clock_time
from eclsim.course.cohort import CourseGroup, courses_of_draws
from eclsim.course.course import checked_interval_min, refuse_unknown
from eclsim.course.result import IMPOSSIBLE, TIME
from eclsim.course.timeline import MINUTE, Timeline
from eclsim.devices.description import CAUTION
from eclsim.execution import Executor, Progress, as_executor, as_folder
from eclsim.files import ORIGIN, finite
from eclsim.orbit.model import CASE, CaseSource, as_case
from eclsim.orbit.status import Status
from eclsim.outputs.alarms import THIN_WALLED
from eclsim.outputs.registry import find_output
from eclsim.outputs.results import variable
from eclsim.outputs.uncertainty import NOT_THE_MEASURED
from eclsim.simulation.target_flow import with_speed

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Quantiles: the median and the ends of the central 50 % and 90 % intervals of the draws."""
DEFAULT_DRAWS = 200
MOST_REASONS = 3


def course_band(
    case: CaseSource,
    samples: Mapping[str, Sequence[float]],
    *,
    minutes: float,
    every_min: float | None = None,
    volume_policy: str | None = None,
    draws: int = DEFAULT_DRAWS,
    folder: Path | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Simulate courses, by steady beats, for draws of a patient's parameters and return quantiles over time.

    Args:
        case: path of a case file, what `read_case` returned, or a case; with its `[[events]]`.
        samples: values of each parameter, one for each draw, such as those of a posterior.
        minutes: duration [min].
        every_min: interval between moments shown [min]; None gives about 144 moments.
        volume_policy: blood volume policy; None takes that of the case.
        draws: largest number of draws, evenly taken from the samples.
        folder: folder that stores the courses; None keeps them in memory only.
        executor: runs groups of draws; None runs them in this process.
        progress: called when a group is done.

    Returns:
        Dataset over `quantile` and `time_min`: outputs and slow states of the draws still followed, without
        those whose beat is impossible or not determined, and the number `draws_followed`. Over `alarm` and
        `time_min`: `alarm_probability`, the share of the draws followed that violate a limit. Attributes as
        for `eclsim.course`, and `draws` and `failed` (numbers of all and of those that ended early).

    Raises:
        CaseError: The file is no case, an event is after the end, or parameters have different numbers of
            samples or values out of range.
        FlowNotReachedError: The case gives a pump flow that no speed can reach.
        ExecutionError: The folder holds other courses, or workers cannot be reached.
        ShardDone: This run computed one shard only.
    """
    began, minutes = clock.perf_counter(), number_of("minutes", minutes)
    draws, executor, folder = WholeNumber(1)("draws", draws), as_executor(executor), as_folder(folder)
    samples = as_samples(samples)
    solved = with_speed(as_case(case), volume_policy)[0]
    refuse_unknown(Timeline(solved, minutes * MINUTE), samples)
    check_samples(samples, samples)
    compute = CourseGroup(minutes, checked_interval_min(every_min, minutes), volume_policy, hand_over=False)
    chosen = _thinned(samples, draws)
    courses = courses_of_draws(solved, chosen, compute, folder, executor, progress)
    band = band_of(courses, tuple(chosen))
    warnings = [*solved.doubts, *band.attrs["warnings"]]
    return band.assign_attrs(warnings=warnings, seconds=clock.perf_counter() - began)


def _thinned(samples: Mapping[str, Sequence[float]], draws: int) -> dict[str, list[float]]:
    count = len(next(iter(samples.values())))
    chosen = np.unique(np.linspace(0, count - 1, min(draws, count)).round().astype(int))
    return {name: [float(values[k]) for k in chosen] for name, values in samples.items()}


def band_of(courses: Sequence[xr.Dataset], parameters: Sequence[str] = ()) -> xr.Dataset:
    """Quantiles over time of several courses of one case.

    Args:
        courses: courses of the draws, as `eclsim.course_many` returns them.
        parameters: names of the parameters that differ between the courses.
    """
    finished = [course for course in courses if course.attrs["converged"]] or list(courses)
    time = max((course[TIME].to_numpy() for course in finished), key=len)
    first = max(courses, key=lambda course: course.sizes[TIME])
    names = [str(n) for n, v in first.data_vars.items() if v.dtype.kind == "f"]
    columns = [_values_at(time, course, names) for course in courses]
    followed = np.array([np.isin(time, course[TIME].to_numpy()) for course in courses])
    unreadable = [
        (name, words, np.array([_has_mark(course, time, key, mark) for course in courses]))
        for name, key, mark, words in _UNREADABLE
    ]
    left_out = np.any([marked for _, _, marked in unreadable], axis=0)
    data: dict[str, xr.Variable] = {}
    for k, name in enumerate(names):
        values = np.where(left_out, np.nan, [column[k] for column in columns])
        data[name] = variable(("quantile", TIME), _quantiles(values), **first[name].attrs)
    data["draws_followed"] = variable(
        TIME, followed.sum(axis=0), long_name="draws followed so far", units="1"
    )
    for name, words, marked in unreadable:
        data[name] = variable(TIME, marked.sum(axis=0), long_name=f"draws: {words}", units="1")
    alarms = _alarm_probability(courses, time, followed)
    data["alarm_probability"] = variable(
        ("alarm", TIME), np.array([*alarms.values()]).reshape(len(alarms), len(time)),
        long_name="share of the draws that break a limit", units="1",
    )  # fmt: skip
    failed = [course for course in courses if not course.attrs["converged"]]
    shared = ("id", CASE, "events", "blood_volume_policy", "settling_s", "beat_by_beat", "seconds")
    about = {**ORIGIN, **{key: first.attrs[key] for key in shared}}
    coordinates = {
        TIME: variable(TIME, time, units="min", long_name="time from the start"),
        "quantile": np.array(QUANTILES),
        "alarm": [_label(*key) for key in alarms],
        "alarm_kind": ("alarm", [kind for kind, *_ in alarms]),
    }
    return xr.Dataset(data, coordinates).assign_attrs(
        about, draws=len(courses), failed=len(failed), parameters=list(parameters), alarms="[]",
        converged=int(not failed), message=_early_ends_text(failed, len(courses)),
        warnings=[_early_ends_text(failed, len(courses))] * bool(failed)
        + approximations_of_draws(courses, "draws")
        + [_count_text(marked, time, words) for _, words, marked in unreadable if marked.any()],
    )  # fmt: skip


def _values_at(time: np.ndarray, course: xr.Dataset, names: Sequence[str]) -> np.ndarray:
    """Values of a course at given times, shape (names, moments); NaN where it has no moment at that time."""
    moments = course[TIME].to_numpy()
    values = np.full((len(names), len(time)), np.nan)
    shared = np.isin(time, moments)
    places = np.searchsorted(moments, time[shared])
    for k, name in enumerate(names):
        if name in course:
            values[k, shared] = course[name].to_numpy()[places]
    return values


def _quantiles(values: np.ndarray) -> np.ndarray:
    """Quantiles over the draws that have a value; NaN if none has."""
    result, with_value = np.full((len(QUANTILES), values.shape[1]), np.nan), np.isfinite(values).any(axis=0)
    result[:, with_value] = np.nanquantile(values[:, with_value], QUANTILES, axis=0)
    return result


_Key = tuple[str, str, str, float | None]
"""Kind, quantity, side and limit of an alarm."""


def _alarm_probability(
    courses: Sequence[xr.Dataset], time: np.ndarray, followed: np.ndarray
) -> dict[_Key, np.ndarray]:
    """Share of the draws followed that violate a limit at each moment, the most probable limit first."""
    broken: dict[_Key, np.ndarray] = {}
    limits: dict[tuple[str, str, str], float | None] = {}
    fixed: dict[_Key, bool] = {}
    for k, course in enumerate(courses):
        for alarm in json.loads(course.attrs["alarms"]):
            if alarm["kind"] == CAUTION:
                continue
            limit = alarm["limit"]
            side = "below" if limit is not None and alarm["worst"] < limit else "above"
            about = (alarm["kind"], alarm["quantity"], side)
            key = (*about, limits.setdefault(about, limit))
            until = np.inf if alarm["until_min"] is None else alarm["until_min"]
            draws = broken.setdefault(key, np.zeros_like(followed))
            draws[k] |= followed[k] & (time >= alarm["at_min"]) & (time < until)
            fixed[key] = fixed.get(key, True) and limit == key[-1]
    # A more severe alarm of a draw hides a milder one, whose limit is violated as well.
    for key, draws in broken.items():
        _, quantity, side, limit = key
        for k, course in enumerate(courses):
            if fixed[key] and limit is not None and quantity in course:
                (values,) = _values_at(time, course, [quantity])
                draws[k] |= followed[k] & (values < limit if side == "below" else values > limit)
    counts = np.maximum(followed.sum(axis=0), 1)
    shares = {key: draws.sum(axis=0) / counts for key, draws in broken.items() if draws.any()}
    return dict(sorted(shares.items(), key=lambda item: -float(item[1].max())))


def _label(kind: str, quantity: str, side: str, limit: float | None) -> str:
    """A label such as "MAP below 65 mmHg (warning)" or "right atrium, Vra (collapse)"."""
    entry = find_output(quantity)
    if entry is None:
        place = THIN_WALLED.get(quantity[1:])
        return f"{f'{place}, ' if place else ''}{quantity} ({kind})"
    bound = "" if limit is None else f" {side} {limit:g} {entry.unit}".removesuffix(" 1")
    return f"{quantity}{bound} ({kind})"


def _early_ends_text(failed: Sequence[xr.Dataset], count: int) -> str:
    """Number of draws that ended early, and the reasons."""
    if not failed:
        return ""
    reasons = Counter(str(course.attrs["message"]).partition(": ")[2].partition(" (")[0] for course in failed)
    named = "; ".join(f"{reason} ({number})" for reason, number in reasons.most_common(MOST_REASONS))
    return f"{len(failed)} of {count} draws ended early and count up to where they ended: {named}"


_UNREADABLE = (
    ("draws_impossible", IMPOSSIBLE, 1, f"the beat is one {NO_PATIENT}"),
    (
        "draws_undetermined", "status", Status.ONE_OF_MANY.word,
        "no valve opens during the beat, so that volumes and pressures of the heart are not determined",
    ),
)  # fmt: skip
"""For draws without valid numbers: name of the count, variable and value that mark them, reason."""


_COUNTS = tuple(name for name, *_ in _UNREADABLE)


def _has_mark(one: xr.Dataset, time: np.ndarray, key: str, mark: object) -> np.ndarray:
    """Whether a variable of a course has a given value at each moment."""
    if key not in one:
        return np.zeros(len(time), dtype=bool)
    return np.isin(time, one[TIME].to_numpy()[one[key].to_numpy() == mark])


def _count_text(marked: np.ndarray, time: np.ndarray, words: str) -> str:
    """Number of draws marked at any moment, and time of most; `marked` has shape (draws, moments)."""
    most = int(marked.sum(axis=0).argmax())
    return (
        f"in {marked.any(axis=1).sum()} of {len(marked)} draws, most at {clock_time(time[most])}, {words}; "
        "the quantiles leave them out there"
    )


def approximations_of_draws(courses: Sequence[xr.Dataset], of: str) -> list[str]:
    """Sentences on where steady beats replace transients, one for each kind, with the number of courses.

    Remarks on infused fluid are combined in the same way.

    Args:
        courses: courses as `eclsim.course_many` returns them.
        of: what the courses are of, such as "draws".
    """
    kinds: dict[str, list[str]] = {}
    remarks_of_each = ([*one.attrs["approximations"], *one.attrs.get("cautions", ())] for one in courses)
    for sentence in (sentence for remarks in remarks_of_each for sentence in remarks):
        kind = NOT_THE_MEASURED if NOT_THE_MEASURED in sentence else NUMBER.sub("", sentence)
        kinds.setdefault(kind, []).append(sentence)
    return [
        f"in {len(alike)} of {len(courses)} {of}{'' if len({*alike}) == 1 else ', here of one'}: {alike[0]}"
        for alike in kinds.values()
    ]


def band_object(band: xr.Dataset) -> dict[str, Any]:
    """A band as plain data for JSON; null if no draw has a value."""
    about, names = band.attrs, [str(n) for n, v in band.data_vars.items() if "quantile" in v.dims]
    return {
        "id": str(about["id"]),
        CASE: json.loads(about[CASE]),
        "draws": int(about["draws"]),
        "failed": int(about["failed"]),
        "parameters": list(about["parameters"]),
        "time_min": finite(band[TIME].to_numpy()),
        **{name: band[name].to_numpy().tolist() for name in ("draws_followed", *_COUNTS)},
        "quantiles_percent": {
            n: {f"{100.0 * q:g}": finite(row) for q, row in zip(QUANTILES, band[n].values, strict=True)}
            for n in names
        },
        "units": {n: str(band[n].attrs.get("units", "")) for n in names},
        "alarms": [
            {"alarm": str(label), "kind": str(kind), "probability": finite(row)}
            for label, kind, row in zip(
                band["alarm"].values, band["alarm_kind"].values, band["alarm_probability"].values, strict=True
            )
        ],
        "events": json.loads(about["events"]),
        "warnings": [str(sentence) for sentence in about["warnings"]],
        "blood_volume_policy": str(about["blood_volume_policy"]),
        "seconds": finite(float(about["seconds"])),
    }
