"""The figure of a sweep: outputs over the values of the key that was varied."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eclsim.devices.description import Panel
from eclsim.devices.registry import named_output
from eclsim.reporting.style import (
    GREY,
    PAGE_WIDTH_MM,
    curve_style,
    figure_style,
    new_figure,
    plain_text,
)

if TYPE_CHECKING:
    import xarray as xr

MARKERS = ("o", "s", "^", "D")


PANELS = (
    Panel("Arterial pressure", "mmHg", ("SP", "MAP", "DP"), ("systolic", "mean", "diastolic")),
    Panel("Mean flows", "L/min", ("systemic_flow", "CO"), ("organs", "lungs (CO)")),
    Panel(
        "Filling pressures", "mmHg", ("MPAP", "PCWP", "right_atrial_pressure"),
        ("pulmonary", "wedge", "right atrial (CVP)"),
    ),
    Panel(
        "Ventricles", "mL", ("EDVLV", "ESVLV", "EDVRV", "ESVRV"),
        ("left, end-diastolic", "left, end-systolic", "right, end-diastolic", "right, end-systolic"),
    ),
)  # fmt: skip
"""Of the patient; flows and circuits of devices are added to them."""
_AXES = {"mmHg": "Pressure", "L/min": "Flow", "mL": "Volume"}


def panels_of(table: "xr.Dataset") -> list[Panel]:
    """The panels that there are outputs for, those of devices behind the patient's."""
    known = (named_output(str(name)) for name in table.data_vars)
    instances = {result[0].key: result[0] for result in known if result is not None}
    flows = [
        (curve.output, curve.label)
        for one in instances.values()
        for curve in one.views().curves
        if curve.panel == "flow"
    ]
    names, labels = zip(*flows, strict=True) if flows else ((), ())
    own = (
        replace(p, names=p.names + names, labels=p.labels + labels) if p.unit == "L/min" else p
        for p in PANELS
    )
    panels = (*own, *(panel for one in instances.values() for panel in one.swept()))
    return [panel for panel in panels if any(name in table for name in panel.names)]


@figure_style()
def plot_sweep(table: "xr.Dataset") -> Figure:
    """Pressures, flows and volumes over the values of a sweep.

    A value without a steady beat is a gap in every curve and a cross on the axis; a beat that cannot be a
    patient's has hollow markers. The value of the case as it is has a grey line.

    Args:
        table: as `eclsim.simulation.sweep.as_table` gives it: outputs over `value`, `converged`,
            `impossible`.
    """
    shown = panels_of(table)
    rows = math.ceil(max(len(shown), 1) / 2)
    fig = new_figure(PAGE_WIDTH_MM, 16 + 58 * rows)
    axes = list(fig.subplots(rows, 2, squeeze=False).flat)
    for ax, panel in zip(axes, shown, strict=False):
        _draw_panel(ax, table, panel)
    for ax in axes[len(shown) :]:
        ax.remove()
    title = f"{plain_text(table.attrs['id'], 40)} – {plain_text(table.attrs['key'], 60)}"
    fig.suptitle(title, x=0.01, ha="left")
    if notes := _notes(table):
        fig.supxlabel(notes, fontsize=7.5, x=0.01, ha="left", color=GREY)
    return fig


def _draw_panel(ax: Axes, table: "xr.Dataset", panel: Panel) -> None:
    places, names = _axis(table)
    settled = table["converged"].to_numpy().astype(bool)
    hollow = settled & table["impossible"].to_numpy().astype(bool)
    line = "None" if names else None
    drawn = [pair for pair in zip(panel.names, panel.labels, strict=True) if pair[0] in table]
    for index, (name, label) in enumerate(drawn):
        values = np.where(settled, table[name].to_numpy().astype(float), np.nan)
        style: dict[str, Any] = {**curve_style(index), "marker": MARKERS[index % len(MARKERS)]}
        style |= {"linestyle": line} if line else {}
        ax.plot(places, values, label=label, markersize=3.2, **style)
        if hollow.any():
            ax.plot(
                places[hollow], values[hollow], linestyle="None", marker=style["marker"], markersize=3.2,
                markerfacecolor="white", markeredgecolor=style["color"],
            )  # fmt: skip
    _mark_own_value(ax, table, names)
    if not settled.all():
        height = np.full(np.count_nonzero(~settled), 0.04)
        ax.plot(places[~settled], height, "x", color=GREY, markersize=4.5, transform=ax.get_xaxis_transform())
    if names:
        ax.set_xticks(places, names)
    unit = table["value"].attrs.get("units", "")
    ax.set_xlabel(plain_text(table.attrs["key"], 40) + (f" [{unit}]" if unit else ""))
    ax.set_ylabel(f"{_AXES[panel.unit]} [{panel.unit}]")
    ax.set_title(panel.title, loc="left", pad=3 + 11.5 * math.ceil(len(drawn) / 2))
    ax.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.1, handletextpad=0.5,
        columnspacing=1.0, labelspacing=0.25, borderpad=0.1,
    )  # fmt: skip


def _axis(table: "xr.Dataset") -> tuple[np.ndarray, list[str]]:
    """Places of the values on the axis, and their names where they are no numbers."""
    values = table["value"].to_numpy()
    if np.issubdtype(values.dtype, np.number):
        return values.astype(float), []
    return np.arange(len(values), dtype=float), [plain_text(value, 20) for value in values]


def _mark_own_value(ax: Axes, table: "xr.Dataset", names: list[str]) -> None:
    own = table.attrs.get("own_value", "")
    if isinstance(own, str) or names:
        return
    places, _ = _axis(table)
    if places.min() <= own <= places.max():
        ax.axvline(own, color=GREY, linewidth=0.8, linestyle=(0, (1, 1.5)), zorder=0)


def _notes(table: "xr.Dataset") -> str:
    lost = int((table["converged"].to_numpy() == 0).sum())
    hollow = int((table["impossible"].to_numpy() * table["converged"].to_numpy() != 0).sum())
    own = table.attrs.get("own_value", "")
    messages = []
    if lost:
        messages.append(f"× no steady beat ({lost} of {table.sizes['value']} values), left out of the curves")
    if hollow:
        messages.append("hollow: a beat that cannot be a patient's; see the warnings")
    if not isinstance(own, str):
        messages.append(f"dotted line: {own:g}, the case as it is")
    messages.append(f"blood volume: {table.attrs['blood_volume_policy']}")
    return "\n".join(messages)
