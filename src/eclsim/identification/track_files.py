"""The files of following patients: JSON, tables and figures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from eclsim.files import csv_text, write_json, write_text
from eclsim.identification.cohort import stem
from eclsim.identification.track_results import TrackedPoint

SUMMARY = "track.json"
_QUANTILES = ("median", "lower", "upper")


def as_object(
    patient: str, points: Sequence[TrackedPoint], assumed_hours: float | None = None
) -> dict[str, Any]:
    """A patient's series as plain data for JSON; null for what is not known.

    Args:
        patient: id.
        points: of the series.
        assumed_hours: from one measurement to the next; None where their names are times.
    """
    return {
        "id": patient, "assumed_interval_hours": assumed_hours, "points": [_point(p) for p in points]
    }  # fmt: skip


def write_tracks(folder: Path, content: Mapping[str, Any]) -> list[Path]:
    """Write track.json, report.html, parameters.csv, outputs.csv and figures; return the figures."""
    from eclsim.identification.track_figures import plot_outputs, plot_parameters
    from eclsim.identification.track_page import REPORT, track_page
    from eclsim.reporting.style import save_figure

    folder.mkdir(parents=True, exist_ok=True)
    write_json(content, folder / SUMMARY)
    each = [(s["id"], p) for s in content["series"] for p in s["points"]]
    head = ("patient", "id", "parameter", *_QUANTILES)
    rows = ((s, p["id"], n, *(i[q] for q in _QUANTILES)) for s, p in each for n, i in p["parameters"].items())
    write_text(csv_text(head, rows), folder / "parameters.csv")
    write_text(csv_text(_OUTPUT_HEAD, _output_rows(each)), folder / "outputs.csv")
    figures, drawings = [], {}
    for series in content["series"]:
        for key, plot in (("parameters", plot_parameters), ("outputs", plot_outputs)):
            figure = plot(series)
            saved = save_figure(figure, folder / "figures" / f"{stem(series['id'])}_{key}")
            figures += saved
            (svg,) = (path for path in saved if path.suffix == ".svg")
            drawings[series["id"], key] = svg.read_text(encoding="utf-8")
    write_text(track_page(content, drawings), folder / REPORT)
    return figures


_OUTPUT_HEAD = (
    "patient", "id", "output", "measured", "deviation", "unusual", "used",
    *(f"forecast_{q}" for q in _QUANTILES), *(f"expected_{q}" for q in _QUANTILES), *_QUANTILES,
)  # fmt: skip


def _output_rows(each: Iterable[tuple[str, Mapping[str, Any]]]) -> Iterable[Sequence[object]]:
    for patient, point in each:
        names = dict.fromkeys([*point["outputs"], *point["measurements"]])
        for name in names:
            held = point["measurements"].get(name, {})
            kinds = (point["forecast"], point["expected"], point["outputs"])
            quantiles = [kind.get(name, {}).get(q) for kind in kinds for q in _QUANTILES]
            given = [held.get(k) for k in ("measured", "deviation", "unusual", "used")]
            yield (patient, point["id"], name, *given, *quantiles)


def _point(point: TrackedPoint) -> dict[str, Any]:
    def each(intervals: Mapping[str, Any]) -> dict[str, Any]:
        return {n: i.as_object() for n, i in intervals.items()}

    return {
        "id": point.name,
        "hours_since_last": point.hours,
        "forecast": each(point.forecast),
        "expected": each(point.expected),
        "measurements": {
            n: {"measured": i.measured, "deviation": i.deviation, "unusual": i.unusual, "used": i.used}
            for n, i in point.innovations.items()
        },
        "chi_square": point.chi_square,
        "probability": point.probability,
        "unusual": point.unusual,
        "parameters": each(point.parameters),
        "outputs": each(point.outputs),
        "drift": point.drift,
        "seconds": round(point.seconds, 3),
        "failed": point.failed,
        "message": point.message,
    }
