"""Figures of followed patients."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator

from eclsim.identification.figures import LONGEST_LABEL, scaled_axis, with_line_break
from eclsim.identification.points import HOURS_PER_DAY
from eclsim.identification.quantities import axis_label, unit_of
from eclsim.identification.track_report import doubts_of_point
from eclsim.reporting.style import GREY, OKABE_ITO, figure_style, panel_grid, plain_text

Series = Mapping[str, Any]
"""A followed patient as in the JSON file."""
_ACROSS = 2
MOST_NAMES = 8
LONGEST_NAME = 6
"""With longer names (characters), the axis shows the number of the measurement."""
HOURS_SHOWN_AS_DAYS = 72.0
"""Courses longer than this [h] have an axis in days."""


@dataclass(frozen=True)
class TimeAxis:
    """Positions of the measurements on the time axis.

    Args:
        at: position of each measurement.
        label: label of the axis.
        names: names of the measurements where the axis counts measurements; empty where it shows time.
    """

    at: np.ndarray
    label: str
    names: tuple[str, ...] = ()

    @classmethod
    def of(cls, series: Series) -> TimeAxis:
        """Axis in hours or days where the times are known, else one unit per measurement."""
        points = series["points"]
        if series.get("assumed_interval_hours") is not None or len(points) < 2:
            names = tuple(plain_text(p["id"]) for p in points)
            at = np.arange(1.0, len(points) + 1.0)
            if max(map(len, names)) <= LONGEST_NAME:
                return cls(at, "measurement", names)
            return cls(at, "number of the measurement")
        hours = np.cumsum([p["hours_since_last"] or 0.0 for p in points])
        if hours[-1] > HOURS_SHOWN_AS_DAYS:
            return cls(hours / HOURS_PER_DAY, "days since the first measurement")
        return cls(hours, "hours since the first measurement")

    @property
    def step(self) -> float:
        """Width that a marker may take on the axis without touching its neighbour."""
        return (float(np.ptp(self.at)) or 2.0) / 60.0

    def draw(self, ax: Axes, last_row: bool) -> None:
        """Set limits, ticks and, on the last row, the label."""
        margin = 3.0 * self.step if np.ptp(self.at) else 1.0
        ax.set_xlim(self.at.min() - margin, self.at.max() + margin)
        if self.names:
            stride = -(-len(self.names) // MOST_NAMES)
            chosen = range(0, len(self.names), stride)
            ax.xaxis.set_major_locator(FixedLocator([self.at[k] for k in chosen]))
            ax.set_xticklabels([self.names[k] for k in chosen])
        else:
            ax.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        if last_row:
            ax.set_xlabel(self.label, color=GREY)


def plot_parameters(series: Series) -> Figure:
    """Every parameter after each measurement: median and 90 % interval."""

    def draw(ax: Axes, time: TimeAxis, name: str) -> None:
        intervals = _values_of_points(series, "parameters", name)
        doubtful = [bool(doubts_of_point(p)) for p in series["points"]]
        _band(ax, time, intervals, "blue", "median and 90 %")
        _doubted(ax, time, intervals, doubtful, "median, doubtful")
        scaled_axis(ax.yaxis, name)
        ax.set_ylabel(with_line_break(axis_label(name)) + "\ndoubtful" * any(doubtful))

    return _panels_over_time(series, "parameters", "parameters after each measurement", draw)


def plot_outputs(series: Series) -> Figure:
    """Every output: forecast, measurement, and model output after the update."""
    points = series["points"]

    def draw(ax: Axes, time: TimeAxis, name: str) -> None:
        expected, outputs = (_values_of_points(series, key, name) for key in ("expected", "outputs"))
        _band(ax, time, expected, "sky blue", "90 % of measurements expected")
        _band(ax, time, outputs, "blue", "model afterwards, 90 %")
        doubtful = [outputs[k] is not None and bool(doubts_of_point(p, name)) for k, p in enumerate(points)]
        _doubted(ax, time, outputs, doubtful, "model afterwards, doubtful")
        _measured(ax, time, _values_of_points(series, "measurements", name))
        ax.yaxis.set_major_locator(MaxNLocator(4))
        ax.set_ylabel(_in_lines(f"{name} [{unit_of(name)}]") + "\ndoubtful" * any(doubtful))

    return _panels_over_time(
        series, "outputs", "outputs: expected beforehand, measured, and afterwards", draw
    )


def _in_lines(label: str) -> str:
    """Break a long label at the underscore nearest to its middle, so that it is no longer than its panel."""
    breaks = [k + 1 for k, sign in enumerate(label) if sign == "_"]
    if len(label) < LONGEST_LABEL or not breaks:
        return label
    middle = min(breaks, key=lambda k: abs(2 * k - len(label)))
    return f"{label[:middle]}\n{label[middle:]}"


def _legend(fig: Figure) -> None:
    """Draw one legend of what any panel shows, below all panels."""
    entries = [zip(*ax.get_legend_handles_labels(), strict=True) for ax in fig.axes]
    legend = {label: handle for pairs in reversed(entries) for handle, label in pairs}
    order = dict.fromkeys(label for ax in fig.axes for label in ax.get_legend_handles_labels()[1])
    fig.legend([legend[label] for label in order], list(order), loc="outside lower center", ncols=2)


def _values_of_points(series: Series, key: str, name: str) -> list[Any]:
    return [point[key].get(name) for point in series["points"]]


def _panels_over_time(
    series: Series, key: str, title: str, draw: Callable[[Axes, TimeAxis, str], None]
) -> Figure:
    """Create one panel over time for each name that the points have under a key."""
    names, time = list(dict.fromkeys(n for p in series["points"] for n in p[key])), TimeAxis.of(series)
    with figure_style():
        fig, panels = panel_grid(len(names), _ACROSS, 36, 30)
        fig.suptitle(title)
        for k, (ax, name) in enumerate(zip(panels, names, strict=True)):
            draw(ax, time, name)
            time.draw(ax, k >= len(names) - _ACROSS)
        _legend(fig)
    return fig


def _band(
    ax: Axes, time: TimeAxis, intervals: Sequence[Mapping[str, float] | None], colour: str, label: str
) -> None:
    rows = [[np.nan] * 3 if i is None else [i["lower"], i["median"], i["upper"]] for i in intervals]
    low, middle, high = np.array(rows, dtype=float).T
    single = colour == "sky blue"
    width = 5.5 if single else 1.6
    alpha = 0.55 if single else 1.0
    ax.vlines(time.at, low, high, color=OKABE_ITO[colour], linewidth=width, alpha=alpha, label=label)
    if not single:
        ax.plot(time.at, middle, "-o", color=OKABE_ITO[colour], linewidth=0.8, markersize=3)


def _doubted(
    ax: Axes,
    time: TimeAxis,
    intervals: Sequence[Mapping[str, float] | None],
    doubtful: Sequence[bool],
    label: str,
) -> None:
    """Draw medians in doubt as open circles."""
    chosen = {k: i["median"] for k, i in enumerate(intervals) if i is not None and doubtful[k]}
    if chosen:
        ax.plot(time.at[list(chosen)], list(chosen.values()), "o", color=OKABE_ITO["vermillion"],
                markerfacecolor="white", markersize=4.5, linestyle="", zorder=5,
                label=label)  # fmt: skip


def _measured(ax: Axes, time: TimeAxis, measurements: Sequence[Mapping[str, Any] | None]) -> None:
    for usual, colour, marker, label in (
        (True, "black", "D", "measured"),
        (False, "vermillion", "X", "measured, does not fit"),
    ):
        chosen = {
            k: h["measured"] for k, h in enumerate(measurements) if h is not None and h["unusual"] != usual
        }
        at, values = list(chosen), list(chosen.values())
        if at:
            ax.plot(time.at[at] + time.step, values, marker, color=OKABE_ITO[colour], linestyle="",
                    markersize=3.2 if usual else 5.5, label=label)  # fmt: skip
