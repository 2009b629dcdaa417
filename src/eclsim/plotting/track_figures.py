"""Figures of following a patient: parameters and outputs over the measurements, with 90 % intervals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eclsim.parameters import thiel2025
from eclsim.plotting.style import GREY, OKABE_ITO, figure_style, new_figure, plain_text

_ACROSS = 2


def plot_parameters(series: Mapping[str, Any]) -> Figure:
    """Every parameter after each measurement: median and 90 %.

    Args:
        series: of `eclsim.report.track_files.as_object`.
    """
    points = series["points"]
    names = list(dict.fromkeys(n for p in points for n in p["parameters"]))
    with figure_style():
        fig, panels = _panels(series, "parameters: median and 90 % after each measurement", len(names))
        for ax, name in zip(panels, names, strict=True):
            _band(ax, [p["parameters"].get(name) for p in points], "blue", "after the measurement")
            ax.set_yscale("log")
            ax.set_ylabel(f"{name} [{thiel2025.PARAMETERS[name].unit}]")
            _times(ax, points)
    return fig


def plot_outputs(series: Mapping[str, Any]) -> Figure:
    """Every output: where it was expected, what was measured, and what the model says afterwards.

    Args:
        series: of `eclsim.report.track_files.as_object`.
    """
    points = series["points"]
    names = list(dict.fromkeys(n for p in points for n in p["outputs"]))
    with figure_style():
        fig, panels = _panels(series, "outputs: expected beforehand, measured, and afterwards", len(names))
        for ax, name in zip(panels, names, strict=True):
            _band(ax, [p["expected"].get(name) for p in points], "sky blue", "90 % of measurements expected")
            _band(ax, [p["outputs"].get(name) for p in points], "blue", "model afterwards, 90 %")
            _measured(ax, [p["measurements"].get(name) for p in points])
            ax.set_ylabel(f"{name} [{'L/min' if name in ('CO', 'PF') else 'mmHg'}]")
            _times(ax, points)
        handles, labels = [], []
        for ax in panels:
            for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
                if label not in labels:
                    handles.append(handle)
                    labels.append(label)
        fig.legend(handles, labels, loc="outside lower center", ncols=3)
    return fig


def _panels(series: Mapping[str, Any], what: str, count: int) -> tuple[Figure, list[Axes]]:
    down = -(-count // _ACROSS)
    fig = new_figure(height_mm=24 + 40 * down)
    fig.suptitle(f"{plain_text(series['id'])}: {what}")
    return fig, [fig.add_subplot(down, _ACROSS, k + 1) for k in range(count)]


def _band(ax: Axes, intervals: list[Any], colour: str, label: str) -> None:
    rows = [[np.nan] * 3 if i is None else [i["lower"], i["median"], i["upper"]] for i in intervals]
    low, middle, high = np.array(rows, dtype=float).T
    at = np.arange(len(rows))
    single = colour == "sky blue"
    width = 5.5 if single else 1.6
    ax.vlines(
        at, low, high, color=OKABE_ITO[colour], linewidth=width, alpha=0.55 if single else 1.0, label=label
    )
    if not single:
        ax.plot(at, middle, "-o", color=OKABE_ITO[colour], linewidth=0.8, markersize=3)


def _measured(ax: Axes, held: list[Any]) -> None:
    for usual, colour, marker, label in (
        (True, "black", "D", "measured"),
        (False, "vermillion", "X", "measured, does not fit"),
    ):
        at = [k for k, h in enumerate(held) if h is not None and h["unusual"] != usual]
        values = [held[k]["measured"] for k in at]
        if at:
            ax.plot(np.array(at) + 0.12, values, marker, color=OKABE_ITO[colour], linestyle="",
                    markersize=3.2 if usual else 5.5, label=label)  # fmt: skip


def _times(ax: Axes, points: list[Any]) -> None:
    every = max(1, len(points) // 12)
    at = list(range(0, len(points), every))
    ax.set_xticks(at)
    labels = [plain_text(points[k]["id"], 12) for k in at]
    tilted = max(map(len, labels)) > 4
    ax.set_xticklabels(labels, rotation=40 if tilted else 0, ha="right" if tilted else "center")
    ax.set_xlim(-0.5, len(points) - 0.5)
    ax.set_xlabel("measurement", color=GREY)
