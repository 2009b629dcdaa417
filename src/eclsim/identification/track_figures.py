"""Figures of following a patient: parameters and outputs over time, with 90 % intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator

from eclsim.parameters import thiel2025
from eclsim.reporting.style import GREY, OKABE_ITO, figure_style, new_figure, plain_log_ticks, plain_text

_ACROSS = 2
MOST_NAMES = 8
LONGEST_NAME = 6
"""Where names are longer, the axis counts the measurements."""
HOURS_PER_DAY = 24.0
DAYS_FROM = 72.0
"""A course longer than so many hours has days on its axis."""


@dataclass(frozen=True)
class TimeAxis:
    """Where measurements stand on the axis of time.

    Args:
        at: of each measurement.
        label: of the axis.
        names: of the measurements, where the axis counts them; empty where it is time.
    """

    at: np.ndarray
    label: str
    names: tuple[str, ...] = ()

    @classmethod
    def of(cls, series: Mapping[str, Any]) -> TimeAxis:
        """Time where it is known, else one measurement after the other."""
        points = series["points"]
        if series.get("assumed_interval_hours") is not None or len(points) < 2:
            names = tuple(plain_text(p["id"]) for p in points)
            at = np.arange(1.0, len(points) + 1.0)
            if max(map(len, names)) <= LONGEST_NAME:
                return cls(at, "measurement", names)
            return cls(at, "number of the measurement")
        hours = np.cumsum([p["hours_since_last"] or 0.0 for p in points])
        if hours[-1] > DAYS_FROM:
            return cls(hours / HOURS_PER_DAY, "days since the first measurement")
        return cls(hours, "hours since the first measurement")

    @property
    def step(self) -> float:
        """What a sign may take of the axis without touching its neighbour's."""
        return (float(np.ptp(self.at)) or 2.0) / 60.0

    def draw(self, ax: Axes, last_row: bool) -> None:
        """Ticks and label."""
        margin = 3.0 * self.step if np.ptp(self.at) else 1.0
        ax.set_xlim(self.at.min() - margin, self.at.max() + margin)
        if self.names:
            every = -(-len(self.names) // MOST_NAMES)
            chosen = range(0, len(self.names), every)
            ax.xaxis.set_major_locator(FixedLocator([self.at[k] for k in chosen]))
            ax.set_xticklabels([self.names[k] for k in chosen])
        else:
            ax.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        if last_row:
            ax.set_xlabel(self.label, color=GREY)


def plot_parameters(series: Mapping[str, Any]) -> Figure:
    """Every parameter after each measurement: median and 90 %.

    Args:
        series: of `TrackResult.as_object`.
    """
    points, time = series["points"], TimeAxis.of(series)
    names = list(dict.fromkeys(n for p in points for n in p["parameters"]))
    with figure_style():
        fig, panels = _panels(series, "parameters: median and 90 % after each measurement", len(names))
        for k, (ax, name) in enumerate(zip(panels, names, strict=True)):
            _band(ax, time, [p["parameters"].get(name) for p in points], "blue", "after the measurement")
            ax.set_yscale("log")
            plain_log_ticks(ax.yaxis)
            ax.set_ylabel(f"{name} [{thiel2025.PARAMETERS[name].unit}]")
            time.draw(ax, k >= len(names) - _ACROSS)
    return fig


def plot_outputs(series: Mapping[str, Any]) -> Figure:
    """Every output: where it was expected, what was measured, and what the model says afterwards.

    Args:
        series: of `TrackResult.as_object`.
    """
    points, time = series["points"], TimeAxis.of(series)
    names = list(dict.fromkeys(n for p in points for n in p["outputs"]))
    with figure_style():
        fig, panels = _panels(series, "outputs: expected beforehand, measured, and afterwards", len(names))
        for k, (ax, name) in enumerate(zip(panels, names, strict=True)):
            expected = [p["expected"].get(name) for p in points]
            _band(ax, time, expected, "sky blue", "90 % of measurements expected")
            _band(ax, time, [p["outputs"].get(name) for p in points], "blue", "model afterwards, 90 %")
            _measured(ax, time, [p["measurements"].get(name) for p in points])
            ax.yaxis.set_major_locator(MaxNLocator(4))
            ax.set_ylabel(f"{name} [{'L/min' if name in ('CO', 'PF') else 'mmHg'}]")
            time.draw(ax, k >= len(names) - _ACROSS)
        handles, labels = [], []
        for ax in panels:
            for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
                if label not in labels:
                    handles.append(handle)
                    labels.append(label)
        fig.legend(handles, labels, loc="outside lower center", ncols=2)
    return fig


def _panels(series: Mapping[str, Any], what: str, count: int) -> tuple[Figure, list[Axes]]:
    down = -(-count // _ACROSS)
    fig = new_figure(height_mm=30 + 36 * down)
    fig.suptitle(f"{plain_text(series['id'])}\n{what}")
    return fig, [fig.add_subplot(down, _ACROSS, k + 1) for k in range(count)]


def _band(ax: Axes, time: TimeAxis, intervals: Sequence[Any], colour: str, label: str) -> None:
    rows = [[np.nan] * 3 if i is None else [i["lower"], i["median"], i["upper"]] for i in intervals]
    low, middle, high = np.array(rows, dtype=float).T
    single = colour == "sky blue"
    width = 5.5 if single else 1.6
    ax.vlines(
        time.at,
        low,
        high,
        color=OKABE_ITO[colour],
        linewidth=width,
        alpha=0.55 if single else 1.0,
        label=label,
    )
    if not single:
        ax.plot(time.at, middle, "-o", color=OKABE_ITO[colour], linewidth=0.8, markersize=3)


def _measured(ax: Axes, time: TimeAxis, held: Sequence[Any]) -> None:
    for usual, colour, marker, label in (
        (True, "black", "D", "measured"),
        (False, "vermillion", "X", "measured, does not fit"),
    ):
        at = [k for k, h in enumerate(held) if h is not None and h["unusual"] != usual]
        values = [held[k]["measured"] for k in at]
        if at:
            ax.plot(time.at[at] + time.step, values, marker, color=OKABE_ITO[colour], linestyle="",
                    markersize=3.2 if usual else 5.5, label=label)  # fmt: skip
