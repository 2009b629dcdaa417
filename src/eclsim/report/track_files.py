"""The files of following patients: JSON, tables and figures."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from eclsim.report.files import whole_file
from eclsim.report.plain_json import write_plain
from eclsim.studies.cohort_fit import stem
from eclsim.studies.track_results import TrackedPoint

SUMMARY = "track.json"
_QUANTILES = ("median", "lower", "upper")


def as_object(patient: str, points: Sequence[TrackedPoint]) -> dict[str, Any]:
    """A patient's series as plain data for JSON; null for what is not known."""
    return {"id": patient, "points": [_point(p) for p in points]}


def write_tracks(folder: Path, content: Mapping[str, Any]) -> list[Path]:
    """Write track.json, parameters.csv, outputs.csv and a figure for each patient; return the figures."""
    from eclsim.plotting.style import save_figure
    from eclsim.plotting.track_figures import plot_outputs, plot_parameters

    folder.mkdir(parents=True, exist_ok=True)
    write_plain(content, folder / SUMMARY)
    each = [(s["id"], p) for s in content["series"] for p in s["points"]]
    _write(
        folder / "parameters.csv",
        ("patient", "id", "parameter", *_QUANTILES),
        ((s, p["id"], n, *(i[q] for q in _QUANTILES)) for s, p in each for n, i in p["parameters"].items()),
    )
    _write(folder / "outputs.csv", _OUTPUT_HEAD, _output_rows(each))
    figures = []
    for series in content["series"]:
        name = stem(series["id"])
        figures += save_figure(plot_parameters(series), folder / "figures" / f"{name}_parameters")
        figures += save_figure(plot_outputs(series), folder / "figures" / f"{name}_outputs")
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


def _write(path: Path, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    with whole_file(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head)
        writer.writerows([_cell(cell) for cell in row] for row in rows)


def _cell(value: object) -> object:
    """Numbers to eight digits; text that a spreadsheet would take for a formula behind an apostrophe."""
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.8g}"
    return f"'{value}" if isinstance(value, str) and value[:1] in "=+-@" else value
