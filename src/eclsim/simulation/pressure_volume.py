"""Pressure-volume loops of the heart chambers."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eclsim.reporting.beat_values import case_name, scalar
from eclsim.reporting.names import COMPARTMENTS
from eclsim.reporting.numbers import number
from eclsim.reporting.style import PAGE_WIDTH_MM, curve_style, figure_style, new_figure, plain_text

if TYPE_CHECKING:
    import xarray as xr


@figure_style()
def plot_pressure_volume(
    results: "xr.Dataset | Sequence[xr.Dataset]", labels: Sequence[str] | None = None, *, atria: bool = False
) -> Figure:
    """Pressure [mmHg] over volume [mL] of both ventricles, end-diastolic and end-systolic volume marked.

    Args:
        results: one simulated case, or several to compare.
        labels: one name for each result; their ids if left out.
        atria: also draws the atria, in a second row.
    """
    import xarray as xr

    cases = [results] if isinstance(results, xr.Dataset) else list(results)
    if not cases:
        raise ValueError("no result to draw: give at least one")
    names = (
        [plain_text(label, 40) for label in labels] if labels is not None else [case_name(c) for c in cases]
    )
    if len(names) != len(cases):
        raise ValueError(f"{len(names)} labels for {len(cases)} results: give one label for each")
    rows = [("rv", "lv"), ("ra", "la")] if atria else [("rv", "lv")]
    legend_mm = 5.0 * len(cases) if len(cases) > 1 else 0.0
    fig = new_figure(PAGE_WIDTH_MM, 12 + 75 * len(rows) + legend_mm)
    grid = fig.subplots(len(rows), 2, squeeze=False)
    for row, chambers in zip(grid, rows, strict=True):
        for ax, chamber in zip(row, chambers, strict=True):
            _draw_chamber(ax, cases, names, chamber)
    if len(cases) > 1:
        handles, texts = grid[0][0].get_legend_handles_labels()
        fig.legend(handles, texts, loc="outside lower left", ncols=1 if max(map(len, texts)) > 30 else 2)
    fig.suptitle("Pressure-volume loops" if len(cases) > 1 else names[0], x=0.01, ha="left")
    return fig


def _draw_chamber(ax: Axes, cases: "Sequence[xr.Dataset]", names: Sequence[str], chamber: str) -> None:
    title = COMPARTMENTS[chamber]
    for index, (case, name) in enumerate(zip(cases, names, strict=True)):
        volume = np.asarray(case[f"V{chamber}"].values, dtype=float)
        pressure = np.asarray(case[f"P{chamber}"].values, dtype=float)
        style = curve_style(index)
        ax.plot(volume, pressure, label=name, **style)  # pyright: ignore[reportArgumentType] - dict of keywords
        _mark(ax, volume, pressure, style["color"], largest=True)
        _mark(ax, volume, pressure, style["color"], largest=False)
    ax.set_title(title.capitalize(), loc="left", pad=16)
    marks = _volumes_in_words(cases[0], chamber) if len(cases) == 1 else "● EDV   ○ ESV"
    ax.annotate(marks, (0, 1), xytext=(0, 4), xycoords="axes fraction", textcoords="offset points")
    ax.set_xlabel("Volume [mL]")
    ax.set_ylabel("Pressure [mmHg]")
    ax.margins(y=0.06)
    if np.isfinite(ax.dataLim.x1):
        ax.set_xlim(0.0, 1.06 * ax.dataLim.x1)


def _mark(ax: Axes, volume: np.ndarray, pressure: np.ndarray, colour: object, *, largest: bool) -> None:
    if not np.isfinite(volume).all():
        return
    at = int(np.argmax(volume) if largest else np.argmin(volume))
    ax.plot(
        volume[at],
        pressure[at],
        marker="o",
        markersize=5,
        markeredgecolor=colour,
        markerfacecolor=colour if largest else "white",
        linestyle="none",
        zorder=3,
    )


def _volumes_in_words(case: "xr.Dataset", chamber: str) -> str:
    volume = np.asarray(case[f"V{chamber}"].values, dtype=float)
    side = chamber.upper()
    largest = scalar(case, f"EDV{side}")
    least = scalar(case, f"ESV{side}")
    largest = float(np.max(volume)) if largest is None else largest
    least = float(np.min(volume)) if least is None else least
    digits = 0 if largest > 20 else 1
    return f"● EDV {number(largest, digits)} mL   ○ ESV {number(least, digits)} mL"
