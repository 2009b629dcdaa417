"""Followed patients as one HTML page: where each stands, what did not fit, the course, what is assumed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from eclsim.parameters import thiel2025
from eclsim.reporting.html import Table, render
from eclsim.reporting.numbers import MISSING, interval, number

REPORT = "report.html"
CAPTIONS = {
    "outputs": (
        "Outputs. Pale bars: where 90 % of measurements were expected beforehand. Diamonds: measured. Dark "
        "bars: what the model says afterwards, median and 90 %."
    ),
    "parameters": "Parameters after each measurement, median and 90 %.",
}
"""Figures of a patient, in order, with their captions."""


def track_page(content: Mapping[str, Any], drawings: Mapping[tuple[str, str], str]) -> str:
    """The page.

    Args:
        content: as in track.json.
        drawings: figures as SVG text, by id of the patient and key of `CAPTIONS`.
    """
    ids = [series["id"] for series in content["series"]]
    return render(
        "identification/track.html",
        title=f"Following {ids[0]}" if len(ids) == 1 else f"Following {len(ids)} patients",
        refused=content["refused"],
        patients=[_patient(series) for series in content["series"]],
        rates=", ".join(f"{drift:g}" for drift in content["settings"]["drifts"]),
        drawings=drawings,
        captions=CAPTIONS,
    )


def _patient(series: Mapping[str, Any]) -> dict[str, object]:
    points = series["points"]
    state = _state(points)
    return {
        "id": series["id"],
        "last": points[-1]["id"],
        "state": state,
        "doubtful": len(state) > 1 or points[-1]["failed"],
        "outputs": _outputs(points[-1]),
        "parameters": _parameters(points),
        "course": _course(points),
        "assumed_hours": series["assumed_interval_hours"] if len(points) > 1 else None,
    }


def _state(points: Sequence[Mapping[str, Any]]) -> list[str]:
    """Whether the last measurement fits, and what was remarked before."""
    last = points[-1]
    if last["failed"]:
        first = f"{last['id']} could not be used: the estimate is of the measurement before"
    elif last["probability"] is None:
        first = f"{last['id']} is the only measurement: nothing to hold it against yet"
    elif last["unusual"]:
        first = f"{last['id']} does not fit the patient so far"
    elif last["message"]:
        first = f"{last['id']} fits the patient so far as a whole, not in every output"
    else:
        first = f"{last['id']} fits the patient so far (probability {last['probability']:.2g})"
    return [first, *(f"{p['id']}: {p['message']}" for p in points if p["message"])]


def _outputs(point: Mapping[str, Any]) -> Table:
    names = dict.fromkeys([*point["outputs"], *point["measurements"]])
    rows = []
    for name in names:
        held = point["measurements"].get(name, {})
        off = held.get("deviation")
        remark = "" if held.get("used", True) else "not used"
        rows.append(
            (f"{name} [{'L/min' if name in ('CO', 'PF') else 'mmHg'}]", number(held.get("measured")),
             _range(point["expected"].get(name)), MISSING if off is None else f"{off:+.1f}",
             _interval(point["outputs"].get(name)), remark or ("unusual" if held.get("unusual") else ""))
        )  # fmt: skip
    head = ("Output", "Measured", "Expected", "Deviation [SD]", "Model afterwards", "Remark")
    return Table(head, rows, numeric=(1, 2, 3, 4))


def _parameters(points: Sequence[Mapping[str, Any]]) -> Table | None:
    known = [p for p in points if p["parameters"]]
    if not known:
        return None
    first, last = known[0], known[-1]
    rows = [
        (name, thiel2025.PARAMETERS[name].unit, _interval(first["parameters"][name]), _interval(now),
         f"{now['median'] / first['parameters'][name]['median']:.2f}")
        for name, now in last["parameters"].items()
    ]  # fmt: skip
    head = ("Parameter", "Unit", f"After {first['id']}", f"After {last['id']}", "Ratio of medians")
    return Table(head, rows, numeric=(2, 3, 4))


def _course(points: Sequence[Mapping[str, Any]]) -> Table:
    rows = [
        (p["id"], number(p["hours_since_last"]), number(p["probability"]),
         p["message"] or ("fits" if p["probability"] is not None else "first estimate"))
        for p in points
    ]  # fmt: skip
    head = ("Measurement", "Hours since the last", "Probability", "Remark")
    return Table(head, rows, numeric=(0, 1, 2))


def _interval(limits: Mapping[str, float] | None) -> str:
    return MISSING if limits is None else f"{limits['median']:.3g} ({_range(limits)})"


def _range(limits: Mapping[str, float] | None) -> str:
    return MISSING if limits is None else interval(limits["lower"], limits["upper"])
