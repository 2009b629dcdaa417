"""Panels of outputs over the values of a sweep or the time of a course, with bars where limits are broken."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from eclsim.devices.description import CAUTION, LABELS, Panel
from eclsim.devices.registry import flows_of_own_devices, named_output
from eclsim.outputs.limits import group_of
from eclsim.outputs.registry import find_output, first_name
from eclsim.reporting.beat_values import FIGURE_MARKS, legend_of_figure_marks
from eclsim.reporting.style import OKABE_ITO

if TYPE_CHECKING:
    import xarray as xr

PANELS = (
    Panel("Arterial pressure", "mmHg", ("SP", "MAP", "DP"), ("systolic", "mean", "diastolic")),
    Panel(
        "Mean flows", "L/min", ("systemic_flow", "upper_body_flow", "lower_body_flow", "CO"),
        ("organs", "upper body", "lower body", "lungs (CO)"),
    ),
    Panel(
        "Filling pressures", "mmHg", ("MPAP", "PCWP", "right_atrial_pressure"),
        ("pulmonary", "wedge", "right atrial (CVP)"),
    ),
    Panel(
        "Ventricles", "mL", ("EDVLV", "ESVLV", "EDVRV", "ESVRV"),
        ("left, end-diastolic", "left, end-systolic", "right, end-diastolic", "right, end-systolic"),
    ),
)  # fmt: skip
"""Panels of the patient, to which flows and circuits of devices are added."""
FURTHER_PANELS = (
    Panel("Heart rate", "1/min", ("heart_rate",), ("heart rate",)),
    Panel(
        "Oxygen saturation", "%", ("SaO2", "SaO2_lower", "SvO2"),
        ("arteries", "femoral artery", "pulmonary artery"),
    ),
    Panel("Oxygen delivery", "mL/min", ("DO2", "VO2"), ("delivery", "consumption")),
    Panel(
        "Carbon dioxide", "mmHg", ("PaCO2", "PaCO2_lower", "tissue_PCO2"),
        ("arteries", "femoral artery", "tissue"),
    ),
)  # fmt: skip
"""Panels of a patient with reflexes, drugs or blood gases, after those of devices."""
QUANTITIES = {
    "mmHg": "Pressure", "L/min": "Flow", "mL": "Volume", "1": "Volume fraction", "%": "Saturation",
    "mmol/L": "Concentration", "mg/L": "Concentration", "1/min": "Rate", "mL/min": "Oxygen",
}  # fmt: skip
"""Labels of the vertical axes, by unit."""


class BrokenLimit(NamedTuple):
    """A limit that an output violates between two places on the horizontal axis."""

    quantity: str
    kind: str
    begin: float
    end: float


_BARS: dict[str, dict[str, object]] = {
    "collapse": {"color": "#7A0000", "linewidth": 4.5},
    "alarm": {"color": OKABE_ITO["vermillion"], "linewidth": 3.0},
    "warning": {"color": OKABE_ITO["orange"], "linewidth": 3.0, "linestyle": (0, (0.7, 0.5))},
}
"""Look of the bars; a warning is dashed, for grey print and any colour vision."""
_CARE = FIGURE_MARKS[CAUTION]
_ROOM = 0.08
"""Height of the space that is added for bars or event numbers, as a share of that of the axes."""


def panels_of(table: xr.Dataset) -> list[Panel]:
    """The panels that have outputs, those of devices after the first ones of the patient."""
    outputs = (named_output(str(name)) for name in table.data_vars)
    instances = {result[0].key: result[0] for result in outputs if result is not None}
    flows = [
        (curve.output, curve.label)
        for instance in instances.values()
        for curve in instance.views().curves
        if curve.panel == "flow"
    ]
    curves = {output for output, _ in flows}
    own = flows_of_own_devices(str(name) for name in table.data_vars)
    flows += [(name, name) for name in own if name not in curves]
    names, labels = zip(*flows, strict=True) if flows else ((), ())
    of_patient = (
        replace(p, names=p.names + names, labels=p.labels + labels) if p.unit == "L/min" else p
        for p in PANELS
    )
    of_devices = (panel for instance in instances.values() for panel in instance.swept())
    panels = (*of_patient, *of_devices, *FURTHER_PANELS)
    return [panel for panel in panels if any(name in table for name in panel.names)]


def curves_of(table: xr.Dataset, panel: Panel) -> list[tuple[str, str]]:
    """Outputs of a panel that the table has, with their labels; a dagger marks those to be read with care."""
    drawn = [pair for pair in zip(panel.names, panel.labels, strict=True) if pair[0] in table]
    return [(name, f"{label} {_CARE}" if _doubted(table, name) else label) for name, label in drawn]


def legend_of_care(table: xr.Dataset, panels: Iterable[Panel]) -> list[str]:
    """Line that explains the dagger; none if no output of the panels is to be read with care."""
    doubted = any(_doubted(table, name) for panel in panels for name in panel.names)
    return [legend_of_figure_marks(_CARE)] if doubted else []


def _doubted(table: xr.Dataset, name: str) -> bool:
    return any(one in table and table[one].attrs.get("read_with_care") for one in (name, first_name(name)))


def draw_broken_limits(ax: Axes, panel: Panel, broken: Sequence[BrokenLimit]) -> None:
    """Draw bars at the bottom where outputs of the panel violate limits, the most severe on top."""
    names = set(map(first_name, panel.names))
    shown = [one for one in broken if one.kind in _BARS and first_name(one.quantity) in names]
    if shown:
        make_room(ax, below=True)
    for kind in reversed(_BARS):
        for ends in _united((one.begin, one.end) for one in shown if one.kind == kind):
            draw_bar(ax, ends, 0.02, solid_capstyle="butt", **_BARS[kind])


def _united(spans: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Spans without overlaps, as dashes of two bars would fill each other's gaps."""
    result: list[tuple[float, float]] = []
    for begin, end in sorted(spans):
        if result and begin <= result[-1][1]:
            result[-1] = result[-1][0], max(end, result[-1][1])
        else:
            result.append((begin, end))
    return result


def legend_of_bars(panels: Iterable[Panel], broken: Iterable[BrokenLimit]) -> list[str]:
    """Lines that explain the bars and name the violated limits of outputs that no panel shows."""
    names = {first_name(name) for panel in panels for name in panel.names}
    limits = [one for one in broken if one.kind in _BARS]
    lines = []
    if drawn := {one.kind for one in limits if first_name(one.quantity) in names}:
        impossible = "; dark red: it is impossible" if "collapse" in drawn else ""
        lines.append(
            f"bars: an output of the panel is in alarm (red) or warning (orange, dashed){impossible}"
        )
    groups = set(map(group_of, names))
    hidden: dict[str, set[str]] = {}
    for one in limits:
        if (entry := find_output(one.quantity)) and group_of(one.quantity) not in groups:
            hidden.setdefault(entry.long_name, set()).add(one.kind)
    if hidden:
        named = (f"{name} ({_kinds_in_words(kinds)})" for name, kinds in hidden.items())
        lines += textwrap.wrap(f"limits broken by outputs that are not drawn: {', '.join(named)}", 110)
    return lines


def _kinds_in_words(kinds: set[str]) -> str:
    """Kinds of limits, the gravest first."""
    return " and ".join(LABELS.get(kind, kind) for kind in _BARS if kind in kinds)


def make_room(ax: Axes, *, below: bool = False, above: bool = False) -> None:
    """Widen the vertical axis, so that bars or numbers at its ends do not lie on curves."""
    low, high = ax.get_ylim()
    more = _ROOM * (high - low)
    ax.set_ylim(low - more * below, high + more * above)


def draw_bar(ax: Axes, ends: Sequence[float] | np.ndarray, height: float, **look: object) -> None:
    """Draw a bar between two places at a height in that of the axes."""
    ax.add_line(Line2D(ends, [height, height], transform=ax.get_xaxis_transform(), **look))  # pyright: ignore[reportArgumentType] - keywords of a line


def draw_legend_above(ax: Axes, title: str, rows: int, columns: int = 2, start: float = 0.0) -> None:
    """Draw a legend above the axes, from a place in widths of the axes, and a title above its rows."""
    ax.set_title(title, loc="left", pad=3 + 11.5 * rows)
    ax.legend(
        loc="lower left", bbox_to_anchor=(start, 1.0), ncols=columns, borderaxespad=0.1, handletextpad=0.5,
        columnspacing=1.0, labelspacing=0.25, borderpad=0.1,
    )  # fmt: skip


def legend_start(labels: list[str], columns: int = 2) -> float:
    """Left end of a legend, in widths of the axes; a long legend starts above the axis label.

    Otherwise it would extend beyond the axes to the edge of the page.
    """
    rows = max(math.ceil(len(labels) / columns), 1)
    widths = (max(map(len, labels[k : k + rows])) for k in range(0, len(labels), rows))
    return -0.19 if sum(widths) > _CHARACTERS_ABOVE_AXES[columns] else 0.0


_CHARACTERS_ABOVE_AXES = {1: 42, 2: 34}
"""Number of characters of a legend that fit above the axes, by its number of columns."""
