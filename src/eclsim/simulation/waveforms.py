"""Pressures, flows and volumes over two beats, by part of the circuit."""

import math
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eclsim.devices.description import Panel
from eclsim.devices.device import Naming
from eclsim.devices.registry import device_of
from eclsim.reporting.beat_values import beat_mean, beat_period, case_name, in_unit, summary_lines, two_beats
from eclsim.reporting.names import instances_at, place_words
from eclsim.reporting.numbers import number
from eclsim.reporting.style import GREY, PAGE_WIDTH_MM, curve_style, figure_style, new_figure

if TYPE_CHECKING:
    import xarray as xr


PARTS: dict[str, tuple[Panel, ...]] = {
    "heart": (
        Panel("Right heart", "mmHg", ("Prv", "Pra", "Ppas")),
        Panel("Left heart", "mmHg", ("Plv", "Pla", "Pao")),
        Panel("Right valves", "mL/s", ("Qrv", "Qra")),
        Panel("Left valves", "mL/s", ("Qlv", "Qla")),
        Panel("Right chambers", "mL", ("Vrv", "Vra")),
        Panel("Left chambers", "mL", ("Vlv", "Vla")),
    ),
    "systemic": (
        Panel("Arteries", "mmHg", ("Pao", "Psart", "Pupper", "Plower")),
        Panel("Veins", "mmHg", ("Psvn", "Psvc", "Pivc", "Pra")),
        Panel("Flows", "mL/s", ("Qao", "Qsart", "Qsvn", "Qupper", "Qlower")),
        Panel("Volumes", "mL", ("Vao", "Vsart", "Vsvn", "Vsvc", "Vivc"), change=True),
    ),
    "pulmonary": (
        Panel("Arteries", "mmHg", ("Ppas", "Ppart")),
        Panel("Veins", "mmHg", ("Ppvn", "Pla")),
        Panel("Flows", "mL/s", ("Qpas", "Qpart", "Qpvn")),
        Panel("Volumes", "mL", ("Vpas", "Vpart", "Vpvn"), change=True),
    ),
}
"""Figures of the patient; those of devices are in their files."""

_QUANTITY = {"mmHg": "Pressure", "mL/s": "Flow", "mL/min": "Flow", "L/min": "Flow", "mL": "Volume"}


def available_parts(result: "xr.Dataset") -> list[str]:
    """The parts of the circuit that this result has waveforms of: the patient's, and keys of devices."""
    patients = [part for part, panels in PARTS.items() if any(n in result for p in panels for n in p.names)]
    return [*patients, *_instances(result)]


def _instances(result: "xr.Dataset") -> dict[str, Naming]:
    """The devices that the result has waveforms of."""
    curves = [name for name, values in result.data_vars.items() if values.dims == ("phase",)]
    places = [str(name)[1:] for name in curves if str(name).startswith("Q")]
    return {one.key: one for one in instances_at(places)}


def plot_waveforms(result: "xr.Dataset", part: str = "heart") -> Figure:
    """Pressures [mmHg], flows and volumes [mL] of one part of the circuit over two beats.

    Args:
        result: one simulated case.
        part: "heart", "systemic", "pulmonary" or the key of a device, such as that of its section of the case
            file. Heart and vessel flows are in mL/s, those of devices in L/min or mL/min.

    Returns:
        The figure; only waveforms that the result holds are drawn.

    Raises:
        ValueError: the part is unknown, or the result holds no waveform of it.
    """
    present = available_parts(result)
    if part not in present:
        known = "" if part in PARTS or device_of(part) else " is not a part of the circuit"
        reason = known or " is not in this result"
        raise ValueError(f"part {part!r}{reason}; this result has: {', '.join(present) or 'none'}")
    names = _instances(result).get(part)
    title = f"{case_name(result)} – {part if names is None else names.label}"
    return _draw_panels(result, PARTS[part] if names is None else names.panels(), title)


def plot_overview(result: "xr.Dataset") -> Figure:
    """Pressures, flows and ventricular volumes to look at first, over two beats, with the main outputs."""
    lines = summary_lines(result)
    note = "\n".join("   ".join(part) for part in (lines[:4], lines[4:]) if part)
    pumps = [pump for one in _instances(result).values() for pump in one.pumps()]
    panels = (
        Panel("Left heart and aorta", "mmHg", ("Plv", "Pla", "Pao")),
        Panel("Right heart and lungs", "mmHg", ("Prv", "Pra", "Ppas")),
        Panel("Flows", "L/min", ("Qlv", *(f"Q{pump}" for pump in pumps))),
        Panel("Ventricles", "mL", ("Vlv", "Vrv")),
    )
    return _draw_panels(result, panels, case_name(result), note)


@figure_style()
def _draw_panels(result: "xr.Dataset", panels: tuple[Panel, ...], title: str, note: str = "") -> Figure:
    shown = [panel for panel in panels if any(name in result for name in panel.names)]
    rows = math.ceil(len(shown) / 2)
    fig = new_figure(PAGE_WIDTH_MM, 14 + 54 * rows)
    axes = list(fig.subplots(rows, 2 if len(shown) > 1 else 1, squeeze=False).flat)
    pairs = list(zip(axes, shown, strict=False))
    for start in range(0, len(pairs), 2):
        beside = pairs[start : start + 2]
        legend_rows = max(_legend_rows(result, panel) for _, panel in beside)
        for ax, panel in beside:
            _draw_panel(ax, result, panel, legend_rows)
    for ax in axes[len(shown) :]:
        ax.remove()
    fig.suptitle(title, x=0.01, ha="left")
    if note:
        fig.supxlabel(note, fontsize=7.5, x=0.01, ha="left", color=GREY)
    return fig


def _draw_panel(ax: Axes, result: "xr.Dataset", panel: Panel, legend_rows: int) -> None:
    factor = in_unit(1.0, panel.unit)
    names = [name for name in panel.names if name in result]
    for index, name in enumerate(names):
        time, values = two_beats(result, name)
        mean = beat_mean(result, name)
        label = place_words(name)
        if panel.change:
            values = values - mean
            label = f"{label} (mean {number(mean, 0)} mL)"
        ax.plot(time, factor * values, label=label, **curve_style(index))  # pyright: ignore[reportArgumentType] - dict of keywords
    quantity = f"{_QUANTITY[panel.unit]} minus mean" if panel.change else _QUANTITY[panel.unit]
    ax.set_xlabel("Time [s]")
    ax.set_ylabel(f"{quantity} [{panel.unit}]")
    ax.set_xlim(0.0, 2 * beat_period(result))
    _widen_flat_axis(ax)
    ax.set_title(panel.title, loc="left", pad=3 + 11.5 * legend_rows)
    ax.legend(
        loc="lower left",
        bbox_to_anchor=(_legend_start([place_words(name) for name in names]), 1.0),
        ncols=_legend_columns(panel),
        borderaxespad=0.1,
        handletextpad=0.5,
        columnspacing=1.0,
        labelspacing=0.25,
        borderpad=0.1,
    )


def _legend_start(labels: list[str]) -> float:
    """Where a legend starts, in widths of the axes: one with long names above the axis label.

    It would else run beyond the axes to the edge of the page.
    """
    columns = (labels[: math.ceil(len(labels) / 2)], labels[math.ceil(len(labels) / 2) :])
    long = sum(max(map(len, column), default=0) for column in columns) > _LETTERS_ABOVE_THE_AXES
    return -0.19 if long else 0.0


_LETTERS_ABOVE_THE_AXES = 34
"""Letters of two columns of a legend that fit above the axes."""


def _widen_flat_axis(ax: Axes) -> None:
    """Keeps a nearly constant curve from filling the axis with its rounding errors."""
    low, high = ax.get_ylim()
    least = 0.02 * max(abs(low), abs(high), 1e-3)
    if high - low < least:
        middle = 0.5 * (low + high)
        ax.set_ylim(middle - least, middle + least)


def _legend_columns(panel: Panel) -> int:
    return 1 if panel.change else 2


def _legend_rows(result: "xr.Dataset", panel: Panel) -> int:
    return math.ceil(sum(name in result for name in panel.names) / _legend_columns(panel))
