"""Mean flow and mean pressure at each point of the circuit, as dot charts."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eclsim.reporting.beat_values import beat_mean, case_name, in_unit
from eclsim.reporting.names import COMPARTMENTS, CONNECTIONS, GROUPS, group_of
from eclsim.reporting.numbers import number
from eclsim.reporting.style import GREY, OKABE_ITO, PAGE_WIDTH_MM, figure_style, new_figure, plain_text

if TYPE_CHECKING:
    import xarray as xr

_MARKERS = {
    "patient": ("o", OKABE_ITO["black"]),
    "ecmo": ("s", OKABE_ITO["blue"]),
    "crrt": ("^", OKABE_ITO["bluish green"]),
    "lvad": ("D", OKABE_ITO["vermillion"]),
}

_ROOM_FOR_NUMBERS = 0.24
"""Share of the axis that is kept free beside the largest value for its number."""


@dataclass(frozen=True)
class _Row:
    label: str
    group: str
    value: float


@figure_style()
def plot_mean_flows(result: "xr.Dataset") -> Figure:
    """Mean flow [L/min] out of each point and mean pressure [mmHg] at it, side by side, in flow order."""
    flows = _rows(result, "Q", CONNECTIONS, unit="L/min")
    pressures = _rows(result, "P", COMPARTMENTS, unit="mmHg")
    headings, height = _headings(flows, pressures)
    fig = new_figure(PAGE_WIDTH_MM, 24 + 5.2 * height)
    left, right = fig.subplots(1, 2)
    _draw_rows(left, flows, headings, "Mean flow [L/min]", digits=2)
    _draw_rows(right, pressures, headings, "Mean pressure [mmHg]", digits=1)
    for ax in (left, right):
        ax.set_ylim(height - 0.4, -0.6)
    fig.suptitle(case_name(result), x=0.01, ha="left")
    return fig


def _rows(result: "xr.Dataset", kind: str, words: dict[str, str], unit: str) -> list[_Row]:
    """The rows of one chart; waveforms that the tables do not know come last, under their own names."""
    waveforms = [
        str(name)[1:] for name in result.data_vars if str(name).startswith(kind) and _is_curve(result, name)
    ]
    heads = {name for name in waveforms if kind == "P" and name.endswith("pump")}
    known = [name for name in words if name in waveforms]
    others = [name for name in waveforms if name not in words and name not in heads]
    return [
        _Row(plain_text(words.get(n, n), 28), group_of(n), in_unit(beat_mean(result, kind + n), unit))
        for group in GROUPS
        for n in (*known, *others)
        if group_of(n) == group
    ]


def _is_curve(result: "xr.Dataset", name: object) -> bool:
    return result[name].dims == ("phase",)


def _headings(*charts: list[_Row]) -> tuple[dict[str, int], int]:
    """The line of each group's heading, the same in all charts, and the number of lines."""
    headings, line = {}, 0
    for group in GROUPS:
        rows = max(sum(row.group == group for row in chart) for chart in charts)
        if rows:
            headings[group] = line
            line += 1 + rows
    return headings, line


def _draw_rows(ax: Axes, rows: list[_Row], headings: dict[str, int], axis_label: str, digits: int) -> None:
    free = {group: line + 1 for group, line in headings.items()}
    places = []
    for row in rows:
        places.append(free[row.group])
        free[row.group] += 1
    for group in {row.group: None for row in rows}:
        ax.annotate(
            GROUPS[group],
            (0.0, headings[group]),
            xycoords=("axes fraction", "data"),
            xytext=(-4, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            weight="bold",
        )
    for where, row in zip(places, rows, strict=True):
        marker, colour = _MARKERS[row.group]
        ax.plot([0, row.value], [where, where], color="#C4C4C4", linewidth=0.8, zorder=1)
        ax.plot(row.value, where, marker=marker, color=colour, markersize=4.5, linestyle="none")
        if np.isfinite(row.value):
            ax.annotate(
                number(row.value, digits),
                (max(row.value, 0.0), where),
                xytext=(5, 0),
                textcoords="offset points",
                va="center",
                fontsize=7,
            )
    ax.axvline(0.0, color=GREY, linewidth=0.7, zorder=0)
    ax.set_yticks(places, [row.label for row in rows])
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    ax.set_xlabel(axis_label)
    ax.margins(x=0.06)
    left, right = ax.get_xlim()
    ax.set_xlim(left, right + _ROOM_FOR_NUMBERS * (right - left))
