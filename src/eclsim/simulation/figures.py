"""Figures of one simulated case: the circuit, waveforms, means and pressure-volume loops."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eclsim.cases.case import Case
from eclsim.cases.fit_mark import untrusted
from eclsim.circuit import Circuit
from eclsim.devices.description import Panel
from eclsim.devices.device import Naming
from eclsim.devices.registry import device_of
from eclsim.files import file_stem
from eclsim.orbit.model import CASE
from eclsim.outputs.limits import consecutive_runs
from eclsim.reporting.beat_values import (
    COMPARTMENTS,
    CONNECTIONS,
    beat_mean,
    beat_period,
    case_name,
    case_title,
    check_beat,
    figure_marks_at,
    figure_marks_in,
    in_unit,
    instances_at,
    legend_of_figure_marks,
    marked,
    meaning_of_figure_marks,
    naming_at,
    place_label_of,
    scalar,
    summary_lines,
    summary_marks,
    two_beats,
)
from eclsim.reporting.numbers import number
from eclsim.reporting.schematic import draw_circuit
from eclsim.reporting.style import (
    GREY,
    OKABE_ITO,
    PAGE_WIDTH_MM,
    curve_style,
    figure_style,
    fitted_title,
    new_figure,
    plain_text,
    save_figure,
)
from eclsim.simulation.panels import (
    QUANTITIES,
    BrokenLimit,
    curves_of,
    draw_broken_limits,
    draw_legend_above,
    legend_of_bars,
    legend_of_care,
    legend_start,
    panels_of,
)

if TYPE_CHECKING:
    import xarray as xr


def write_case_figures(
    circuit: Circuit,
    result: xr.Dataset,
    folder: str | Path,
    *,
    formats: Sequence[str] = ("svg", "png"),
    stem: str = "",
) -> list[Path]:
    """Write every figure of a case; cases with different ids can share a folder.

    Args:
        circuit: the circuit that was simulated.
        result: the simulated case.
        folder: folder of the figures, created if it does not exist.
        formats: file formats of each figure; PNG takes more than half of the time.
        stem: stem of the file names; empty takes the case's id.

    Returns:
        The files written: `<stem>_circuit`, `_overview`, `_pressure_volume`, `_mean_flows` and one
        `_waveforms_<part>` for each part of the circuit.
    """
    beginning = Path(folder) / (stem or file_stem(str(result.attrs.get("id", "case"))))
    figures = {
        "circuit": lambda: draw_circuit(circuit, result),
        "overview": lambda: plot_overview(result),
        "pressure_volume": lambda: plot_pressure_volume(result, atria=True),
        "mean_flows": lambda: plot_mean_flows(result),
    }
    for part in available_parts(result):
        figures[f"waveforms_{part.replace('.', '_')}"] = lambda part=part: plot_waveforms(result, part)
    doubts = untrusted(result.attrs.get("warnings", ()))
    return [
        path
        for name, draw in figures.items()
        for path in save_figure(draw(), beginning.with_name(f"{beginning.name}_{name}"), formats, doubts)
    ]


# --- waveforms by part of the circuit ---------------------------------------------------------------

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
"""Figures of the patient; those of devices are defined in the devices' files."""

QUANTITY = {"mmHg": "Pressure", "mL/s": "Flow", "mL/min": "Flow", "L/min": "Flow", "mL": "Volume"}


def available_parts(result: xr.Dataset) -> list[str]:
    """Parts of the circuit whose waveforms are in the result: parts of the patient and keys of devices."""
    parts = PARTS | {key: names.panels() for key, names in _instances(result).items()}
    return [part for part, panels in parts.items() if any(n in result for p in panels for n in p.names)]


def _instances(result: xr.Dataset) -> dict[str, Naming]:
    """Devices whose waveforms are in the result, with their sections if it is that of a case."""
    named = {instance.key: instance for instance in instances_at(_places_of_curves(result, "Q"))}
    text = result.attrs.get(CASE)
    connected = () if text is None else Case.model_validate_json(text).instances()
    return named | {instance.key: instance for instance in connected if instance.key in named}


def plot_waveforms(result: xr.Dataset, part: str = "heart") -> Figure:
    """Pressures [mmHg], flows and volumes [mL] of one part of the circuit over two beats.

    Args:
        result: one simulated case.
        part: "heart", "systemic", "pulmonary" or the key of a device (its section of the case file). Flows of
            heart and vessels are in mL/s, those of devices in L/min or mL/min.

    Returns:
        The figure; only waveforms in the result are drawn.

    Raises:
        ValueError: The part is unknown, or the result has no waveform of it.
    """
    check_beat(result)
    present = available_parts(result)
    if part not in present:
        unknown = "" if part in PARTS or device_of(part) else " is not a part of the circuit"
        reason = unknown or " is not in this result"
        raise ValueError(f"part {part!r}{reason}; this result has: {', '.join(present) or 'none'}")
    names = _instances(result).get(part)
    title = case_title(result, f" – {part if names is None else names.cut(names.label, 56)}")
    return _draw_panels(result, PARTS[part] if names is None else names.panels(), title, names=names)


def plot_overview(result: xr.Dataset) -> Figure:
    """Main pressures, flows and ventricular volumes over two beats, with the main outputs."""
    lines, legend = summary_lines(result), meaning_of_figure_marks(summary_marks(result))
    note = "\n".join("   ".join(part) for part in (lines[:4], lines[4:], [legend]) if any(part))
    pumps = [pump for instance in _instances(result).values() for pump in instance.pumps()]
    panels = (
        Panel("Left heart and aorta", "mmHg", ("Plv", "Pla", "Pao")),
        Panel("Right heart and lungs", "mmHg", ("Prv", "Pra", "Ppas")),
        Panel("Flows", "L/min", ("Qlv", *(f"Q{pump}" for pump in pumps))),
        Panel("Ventricles", "mL", ("Vlv", "Vrv")),
    )
    return _draw_panels(result, panels, case_title(result), note)


@figure_style()
def _draw_panels(
    result: xr.Dataset, panels: tuple[Panel, ...], title: str, note: str = "", names: Naming | None = None
) -> Figure:
    drawn = [panel for panel in panels if any(name in result for name in panel.names)]
    rows = math.ceil(len(drawn) / 2)
    fig = new_figure(PAGE_WIDTH_MM, 14 + 54 * rows)
    axes = list(fig.subplots(rows, 2 if len(drawn) > 1 else 1, squeeze=False).flat)
    pairs = list(zip(axes, drawn, strict=False))
    for start in range(0, len(pairs), 2):
        beside = pairs[start : start + 2]
        legend_rows = max(_legend_rows(result, panel) for _, panel in beside)
        for ax, panel in beside:
            _draw_panel(ax, result, panel, legend_rows, names)
    for ax in axes[len(drawn) :]:
        ax.remove()
    fig.suptitle(title, x=0.01, ha="left")
    if note:
        fig.supxlabel(note, fontsize=7.5, x=0.01, ha="left", color=GREY)
    return fig


def _curve_label(signal: str, titled: Naming | None) -> str:
    """Name of a curve, without that of the instance if the figure's title has it."""
    label = place_label_of(signal)
    label = label.removesuffix(f" {titled.name}") if titled is not None and titled.name else label
    names = naming_at(signal[1:])
    return label if names is None else names.cut(label, _ROW_CHARACTERS)


def _draw_panel(ax: Axes, result: xr.Dataset, panel: Panel, legend_rows: int, titled: Naming | None) -> None:
    factor = in_unit(1.0, panel.unit)
    names = [name for name in panel.names if name in result]
    for index, name in enumerate(names):
        time, values = two_beats(result, name)
        label = _curve_label(name, titled)
        if panel.change:
            mean = beat_mean(result, name)
            values, label = values - mean, f"{label} (mean {number(mean, 0)} mL)"
        ax.plot(time, factor * values, label=label, **curve_style(index))  # pyright: ignore[reportArgumentType] - dict of keywords
    quantity = f"{QUANTITY[panel.unit]}{' minus mean' * panel.change}"
    ax.set_xlabel("Time [s]")
    ax.set_ylabel(f"{quantity} [{panel.unit}]")
    ax.set_xlim(0.0, 2 * beat_period(result))
    _widen_flat_axis(ax)
    columns = _legend_columns(panel)
    start = legend_start([str(line.get_label()) for line in ax.get_lines()], columns)
    draw_legend_above(ax, panel.title, legend_rows, columns, start)


def _widen_flat_axis(ax: Axes) -> None:
    """Widen the axis of a nearly constant curve, so that it does not show rounding errors."""
    low, high = ax.get_ylim()
    least = 0.02 * max(abs(low), abs(high), 1e-3)
    if high - low < least:
        middle = 0.5 * (low + high)
        ax.set_ylim(middle - least, middle + least)


def _legend_columns(panel: Panel) -> int:
    return 1 if panel.change else 2


def _legend_rows(result: xr.Dataset, panel: Panel) -> int:
    return math.ceil(sum(name in result for name in panel.names) / _legend_columns(panel))


# --- mean flows and pressures as dot charts ---------------------------------------------------------

_PATIENT = ("o", OKABE_ITO["black"])
_SPACE_FOR_NUMBERS = 0.24
"""Share of the axis that is reserved for the number beside the largest value."""


@dataclass(frozen=True)
class _Row:
    label: str
    group: str
    mark: tuple[str, str]
    value: float
    signs: str


@figure_style()
def plot_mean_flows(result: xr.Dataset) -> Figure:
    """Mean flow [L/min] out of each point and mean pressure [mmHg] at it, in the order of flow."""
    flows = _rows(result, "Q", CONNECTIONS, unit="L/min")
    pressures = _rows(result, "P", COMPARTMENTS, unit="mmHg")
    headings, height = _headings(flows, pressures)
    fig = new_figure(PAGE_WIDTH_MM, 24 + 5.2 * height)
    left, right = fig.subplots(1, 2)
    _draw_rows(left, flows, headings, "Mean flow [L/min]", digits=2)
    _draw_rows(right, pressures, headings, "Mean pressure [mmHg]", digits=1)
    for ax in (left, right):
        ax.set_ylim(height - 0.4, -0.6)
    if legend := meaning_of_figure_marks(row.signs for row in (*flows, *pressures)):
        fig.supxlabel(legend, fontsize=7.5, x=0.01, ha="left", color=GREY)
    fig.suptitle(case_title(result), x=0.01, ha="left")
    return fig


def _rows(result: xr.Dataset, kind: str, patients: dict[str, str], unit: str) -> list[_Row]:
    """Rows of one chart, those of the patient before those of devices.

    Waveforms that are in no table are last in the patient's group, with their own names; pressures are those
    of compartments.
    """
    waveforms = _places_of_curves(result, kind)
    heads = {name for name in waveforms if kind == "P" and _is_head(result, name)}
    unlisted = [name for name in waveforms if name not in patients and naming_at(name) is None]
    rows = [("Patient", _PATIENT, n) for n in (*patients, *unlisted) if n in waveforms and n not in heads]
    for names in instances_at(waveforms):
        labels = names.device.connections if kind == "Q" else names.device.compartments
        mark = (names.device.look.marker, names.device.look.colour)
        heading = names.cut(names.label, _ROW_CHARACTERS)
        rows += [(heading, mark, n) for n in map(names.place, labels) if n in waveforms]
    means = {n: in_unit(beat_mean(result, kind + n), unit) for _, _, n in rows}
    return [
        _Row(_row_label(kind, n), group, mark, means[n], _signs(result, kind + n)) for group, mark, n in rows
    ]


def _signs(result: xr.Dataset, signal: str) -> str:
    names = naming_at(signal[1:])
    return figure_marks_at(result, signal, "patient" if names is None else names.key)


_ROW_CHARACTERS = 28
"""Length of a label beside an axis; longer ones would leave no room for the axes."""


def _row_label(kind: str, place: str) -> str:
    names, label = naming_at(place), place_label_of(kind + place)
    return plain_text(label if names is None else names.cut(label, _ROW_CHARACTERS), _ROW_CHARACTERS)


def _is_head(result: xr.Dataset, name: str) -> bool:
    """Whether a pressure is that gained along a connection: of a pump, or of a place that holds no blood."""
    names = naming_at(name)
    if names is not None:
        return name in names.pumps()
    return name not in COMPARTMENTS and f"Q{name}" in result and f"V{name}" not in result


def _places_of_curves(result: xr.Dataset, kind: str) -> list[str]:
    """Places of the waveforms of a kind, "P" or "Q"."""
    curves = [str(name) for name, values in result.data_vars.items() if values.dims == ("phase",)]
    return [name[1:] for name in curves if name.startswith(kind)]


def _headings(*charts: list[_Row]) -> tuple[dict[str, int], int]:
    """Line of each group's heading, the same in all charts, and the number of lines."""
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
            group, (0.0, headings[group]), xycoords=("axes fraction", "data"), xytext=(-4, 0),
            textcoords="offset points", ha="right", va="center", weight="bold",
        )  # fmt: skip
    for where, row in zip(places, rows, strict=True):
        marker, colour = row.mark
        ax.plot([0, row.value], [where, where], color="#C4C4C4", linewidth=0.8, zorder=1)
        ax.plot(row.value, where, marker=marker, color=colour, markersize=4.5, linestyle="none")
        if np.isfinite(row.value):
            written = f"{number(row.value, digits)} {row.signs}".strip()
            ax.annotate(
                written, (max(row.value, 0.0), where), xytext=(5, 0),
                textcoords="offset points", va="center", fontsize=7,
            )  # fmt: skip
    ax.axvline(0.0, color=GREY, linewidth=0.7, zorder=0)
    ax.set_yticks(places, [row.label for row in rows])
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    ax.set_xlabel(axis_label)
    ax.margins(x=0.06)
    left, right = ax.get_xlim()
    ax.set_xlim(left, right + _SPACE_FOR_NUMBERS * (right - left))


# --- pressure-volume loops --------------------------------------------------------------------------


@figure_style()
def plot_pressure_volume(
    results: xr.Dataset | Sequence[xr.Dataset], labels: Sequence[str] | None = None, *, atria: bool = False
) -> Figure:
    """Pressure [mmHg] over volume [mL] of both ventricles, end-diastolic and end-systolic volumes marked.

    Args:
        results: one simulated case, or several to compare.
        labels: a name for each result; None for their ids.
        atria: whether the atria are drawn, too, in a second row.
    """
    import xarray as xr

    cases = [results] if isinstance(results, xr.Dataset) else list(results)
    if not cases:
        raise ValueError("no result to draw: give at least one")
    for case in cases:
        check_beat(case)
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
    volumes = [f"{name}{chamber.upper()}" for row in rows for chamber in row for name in ("EDV", "ESV")]
    meaning = legend_of_figure_marks(figure_marks_in(cases, name) for name in volumes)
    if len(cases) > 1:
        handles, texts = grid[0][0].get_legend_handles_labels()
        columns = 1 if max(map(len, texts)) > 30 else 2
        fig.legend(
            handles, texts, loc="outside lower left", ncols=columns, title=meaning or None, alignment="left"
        )
    elif meaning:
        fig.supxlabel(meaning, fontsize=7.5, x=0.01, ha="left", color=GREY)
    title = "Pressure-volume loops" if len(cases) > 1 else names[0] if labels else case_title(cases[0])
    fig.suptitle(title, x=0.01, ha="left")
    return fig


def _draw_chamber(ax: Axes, cases: Sequence[xr.Dataset], names: Sequence[str], chamber: str) -> None:
    for index, (case, name) in enumerate(zip(cases, names, strict=True)):
        volume = np.asarray(case[f"V{chamber}"].values, dtype=float)
        pressure = np.asarray(case[f"P{chamber}"].values, dtype=float)
        style = curve_style(index)
        ax.plot(volume, pressure, label=name, **style)  # pyright: ignore[reportArgumentType] - dict of keywords
        for largest in (True, False):
            _mark(ax, volume, pressure, style["color"], largest=largest)
    ax.set_title(COMPARTMENTS[chamber].capitalize(), loc="left", pad=16)
    ax.annotate(
        _volumes_text(cases, chamber),
        (0, 1),
        xytext=(0, 4),
        xycoords="axes fraction",
        textcoords="offset points",
    )
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
        volume[at], pressure[at], marker="o", markersize=5, markeredgecolor=colour,
        markerfacecolor=colour if largest else "white", linestyle="none", zorder=3,
    )  # fmt: skip


def _volumes_text(cases: Sequence[xr.Dataset], chamber: str) -> str:
    """Legend of the dots on a loop, with the volumes if there is one case."""
    edv, esv = (figure_marks_in(cases, f"{name}{chamber.upper()}") for name in ("EDV", "ESV"))
    if len(cases) > 1:
        return "   ".join((f"● EDV {edv}".rstrip(), f"○ ESV {esv}".rstrip()))
    volume = np.asarray(cases[0][f"V{chamber}"].values, dtype=float)
    largest, least = scalar(cases[0], f"EDV{chamber.upper()}"), scalar(cases[0], f"ESV{chamber.upper()}")
    largest = float(np.max(volume)) if largest is None else largest
    least = float(np.min(volume)) if least is None else least
    digits = 0 if largest > 20 else 1
    ends = marked(edv, number(largest, digits)), marked(esv, number(least, digits))
    return f"● EDV {ends[0]} mL   ○ ESV {ends[1]} mL"


# --- sweeps -----------------------------------------------------------------------------------------


MARKERS = ("o", "s", "^", "D")


@figure_style()
def plot_sweep(table: xr.Dataset) -> Figure:
    """Plot pressures, flows and volumes over the values of a sweep.

    A value without a steady beat is a gap in every curve and a cross on the axis. A beat that no patient can
    have has hollow markers. Bars mark the values at which an output violates a limit, and a grey line the
    value of the case itself.

    Args:
        table: dataset as of `eclsim.simulation.sweep.as_table`: outputs over `value`, `converged`,
            `impossible`, and the attribute `broken`.
    """
    panels, broken = panels_of(table), _broken_limits(table)
    rows = math.ceil(max(len(panels), 1) / 2)
    fig = new_figure(PAGE_WIDTH_MM, 16 + 58 * rows)
    axes = list(fig.subplots(rows, 2, squeeze=False).flat)
    for ax, panel in zip(axes, panels, strict=False):
        _draw_sweep_panel(ax, table, panel)
        draw_broken_limits(ax, panel, broken)
    for ax in axes[len(panels) :]:
        ax.remove()
    title = fitted_title(table.attrs["id"], f" – {plain_text(table.attrs['key'], 40)}")
    fig.suptitle(title, x=0.01, ha="left")
    if notes := "\n".join((*legend_of_bars(panels, broken), *legend_of_care(table, panels), *_notes(table))):
        fig.supxlabel(notes, fontsize=7.5, x=0.01, ha="left", color=GREY)
    return fig


def _draw_sweep_panel(ax: Axes, table: xr.Dataset, panel: Panel) -> None:
    places, names = _axis(table)
    settled = table["converged"].to_numpy().astype(bool)
    hollow = settled & table["impossible"].to_numpy().astype(bool)
    line = "None" if names else None
    drawn = curves_of(table, panel)
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
    ax.set_ylabel(f"{QUANTITIES[panel.unit]} [{panel.unit}]")
    start = legend_start([label for _, label in drawn])
    draw_legend_above(ax, panel.title, math.ceil(len(drawn) / 2), start=start)


def _axis(table: xr.Dataset) -> tuple[np.ndarray, list[str]]:
    """Positions of the values on the axis, and their names if they are not numbers."""
    values = table["value"].to_numpy()
    if np.issubdtype(values.dtype, np.number):
        return values.astype(float), []
    return np.arange(len(values), dtype=float), [plain_text(value, 20) for value in values]


def _mark_own_value(ax: Axes, table: xr.Dataset, names: list[str]) -> None:
    value = table.attrs.get("own_value", "")
    if isinstance(value, str) or names:
        return
    places, _ = _axis(table)
    if places.min() <= value <= places.max():
        ax.axvline(value, color=GREY, linewidth=0.8, linestyle=(0, (1, 1.5)), zorder=0)


def _broken_limits(table: xr.Dataset) -> list[BrokenLimit]:
    """Violated limits, each from halfway to the value before to halfway to the one after."""
    places, _ = _axis(table)
    outermost = 0.5 * np.diff(places)[[0, -1]] if len(places) > 1 else np.full(2, 0.5)
    middles = 0.5 * (places[:-1] + places[1:])
    edges = np.concatenate((places[:1] - outermost[0], middles, places[-1:] + outermost[1]))
    return [
        BrokenLimit(one["quantity"], one["kind"], float(edges[run[0]]), float(edges[run[-1] + 1]))
        for one in json.loads(table.attrs["broken"])
        for run in consecutive_runs(one["at"])
    ]


def _notes(table: xr.Dataset) -> list[str]:
    failed = int((table["converged"].to_numpy() == 0).sum())
    hollow = int((table["impossible"].to_numpy() * table["converged"].to_numpy() != 0).sum())
    value = table.attrs.get("own_value", "")
    messages = []
    if failed:
        messages.append(
            f"× no steady beat ({failed} of {table.sizes['value']} values), left out of the curves"
        )
    if hollow:
        messages.append("hollow: a beat that no patient can have; see the warnings")
    if not isinstance(value, str):
        messages.append(f"dotted line: {value:g}, the case as it is")
    messages.append(f"blood volume: {table.attrs['blood_volume_policy']}")
    return messages
