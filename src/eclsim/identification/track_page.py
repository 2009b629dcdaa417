"""Followed patients as one HTML page: where each stands, what did not fit, the course, what is assumed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from eclsim.parameters import thiel2025
from eclsim.reporting.html import box, bullets, figure, heading, page, paragraph, table

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
    title = f"Following {ids[0]}" if len(ids) == 1 else f"Following {len(ids)} patients"
    return page(title, _pieces(title, content, drawings))


def _pieces(title: str, content: Mapping[str, Any], drawings: Mapping[tuple[str, str], str]) -> Iterator[str]:
    yield heading(title, 1)
    yield paragraph(
        "Before each measurement the model said what it expected; the measurement was held against that and, "
        "where it fits, used. All intervals are 90 %.", "lead",
    )  # fmt: skip
    if content["refused"]:
        yield box(["Rows that could not be used", *content["refused"]], warn=True)
    for number, series in enumerate(content["series"]):
        yield from _patient(number, series, drawings)
    yield heading("What is assumed")
    yield bullets(_assumptions(content))


def _patient(
    number: int, series: Mapping[str, Any], drawings: Mapping[tuple[str, str], str]
) -> Iterator[str]:
    points = series["points"]
    last = points[-1]
    yield heading(series["id"])
    yield _state(points)
    yield heading(f"Outputs at {last['id']}", 3)
    yield _outputs(last)
    yield heading("Parameters", 3)
    yield _parameters(points)
    yield heading("Every measurement", 3)
    yield _course(points)
    for key, caption in CAPTIONS.items():
        if (series["id"], key) in drawings:
            yield figure(drawings[series["id"], key], caption, f"p{number}-{key}")


def _state(points: Sequence[Mapping[str, Any]]) -> str:
    """In a box: whether the last measurement fits, and what was remarked before."""
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
    said = [f"{p['id']}: {p['message']}" for p in points if p["message"]]
    return box([first, *said], warn=bool(said) or last["failed"])


def _outputs(point: Mapping[str, Any]) -> str:
    names = dict.fromkeys([*point["outputs"], *point["measurements"]])
    rows = []
    for name in names:
        held = point["measurements"].get(name, {})
        off = held.get("deviation")
        remark = "" if held.get("used", True) else "not used"
        rows.append(
            (f"{name} [{'L/min' if name in ('CO', 'PF') else 'mmHg'}]", _number(held.get("measured")),
             _range(point["expected"].get(name)), "-" if off is None else f"{off:+.1f}",
             _interval(point["outputs"].get(name)), remark or ("unusual" if held.get("unusual") else ""))
        )  # fmt: skip
    head = ("Output", "Measured", "Expected", "Deviation [SD]", "Model afterwards", "Remark")
    return table(head, rows, numeric=(1, 2, 3, 4))


def _parameters(points: Sequence[Mapping[str, Any]]) -> str:
    known = [p for p in points if p["parameters"]]
    if not known:
        return paragraph("No parameter is known: no measurement could be used.")
    first, last = known[0], known[-1]
    rows = [
        (name, thiel2025.PARAMETERS[name].unit, _interval(first["parameters"][name]), _interval(now),
         f"{now['median'] / first['parameters'][name]['median']:.2f}")
        for name, now in last["parameters"].items()
    ]  # fmt: skip
    head = ("Parameter", "Unit", f"After {first['id']}", f"After {last['id']}", "Ratio of medians")
    return table(head, rows, numeric=(2, 3, 4))


def _course(points: Sequence[Mapping[str, Any]]) -> str:
    rows = [
        (p["id"], _number(p["hours_since_last"]), _number(p["probability"]),
         p["message"] or ("fits" if p["probability"] is not None else "first estimate"))
        for p in points
    ]  # fmt: skip
    head = ("Measurement", "Hours since the last", "Probability", "Remark")
    return table(head, rows, numeric=(0, 1, 2))


def _assumptions(content: Mapping[str, Any]) -> Iterator[str]:
    settings = content["settings"]
    rates = ", ".join(f"{drift:g}" for drift in settings["drifts"])
    yield (
        f"Drift of the parameters over a day: {rates} standard deviations of what is known beforehand (near "
        "the middle of wide bounds 0.1 is about 18 %). The measurements weigh the rates, and the variance "
        "grows with time."
    )
    for series in content["series"]:
        hours = series["assumed_interval_hours"]
        if hours is not None and len(series["points"]) > 1:
            yield (
                f"{series['id']}: the names of the measurements are no times; {hours:g} h from one to the "
                "next are assumed."
            )
    yield (
        "Measurements are normally distributed around the model's outputs, independently, with standard "
        "uncertainties that are assumed where they were not given. What the model leaves out is not in the "
        "intervals."
    )
    yield (
        "The probability is that of a larger deviation by chance. Below 1 % a measurement does not fit; one "
        "output that alone does not fit is left out."
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _interval(interval: Mapping[str, float] | None) -> str:
    return "-" if interval is None else f"{interval['median']:.3g} ({_range(interval)})"


def _range(interval: Mapping[str, float] | None) -> str:
    return "-" if interval is None else f"{interval['lower']:.3g} to {interval['upper']:.3g}"
