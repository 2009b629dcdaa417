"""Mean flow and mean pressure at each point of the circuit, as dot charts."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eclsim.reporting.beat_values import beat_mean, case_name, in_unit
from eclsim.reporting.names import COMPARTMENTS, CONNECTIONS, instances_at, naming_at, place_words
from eclsim.reporting.numbers import number
from eclsim.reporting.style import GREY, OKABE_ITO, PAGE_WIDTH_MM, figure_style, new_figure, plain_text

if TYPE_CHECKING:
    import xarray as xr

_PATIENT = ("o", OKABE_ITO["black"])
_ROOM_FOR_NUMBERS = 0.24
"""Share of the axis that is kept free beside the largest value for its number."""


@dataclass(frozen=True)
class _Row:
    label: str
    group: str
    mark: tuple[str, str]
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


def _rows(result: "xr.Dataset", kind: str, patients: dict[str, str], unit: str) -> list[_Row]:
    """The rows of one chart, the patient's before those of devices.

    Waveforms that are in no table come last in the patient's group, under their own names.
    """
    waveforms = [
        str(name)[1:] for name in result.data_vars if str(name).startswith(kind) and _is_curve(result, name)
    ]
    heads = {name for name in waveforms if kind == "P" and _is_pump(name)}
    others = [name for name in waveforms if name not in patients and naming_at(name) is None]
    rows = [("Patient", _PATIENT, n) for n in (*patients, *others) if n in waveforms and n not in heads]
    for names in instances_at(waveforms):
        words = names.device.connections if kind == "Q" else names.device.compartments
        mark = (names.device.look.marker, names.device.look.colour)
        rows += [(names.label, mark, n) for n in map(names.place, words) if n in waveforms]
    return [
        _Row(plain_text(place_words(kind + n), 28), group, mark, in_unit(beat_mean(result, kind + n), unit))
        for group, mark, n in rows
    ]


def _is_pump(name: str) -> bool:
    names = naming_at(name)
    return name.endswith("pump") if names is None else name in names.pumps()


def _is_curve(result: "xr.Dataset", name: object) -> bool:
    return result[name].dims == ("phase",)


def _headings(*charts: list[_Row]) -> tuple[dict[str, int], int]:
    """The line of each group's heading, the same in all charts, and the number of lines."""
    headings, line = {}, 0
    for group in dict.fromkeys(row.group for chart in charts for row in chart):
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
            group,
            (0.0, headings[group]),
            xycoords=("axes fraction", "data"),
            xytext=(-4, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            weight="bold",
        )
    for where, row in zip(places, rows, strict=True):
        marker, colour = row.mark
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
