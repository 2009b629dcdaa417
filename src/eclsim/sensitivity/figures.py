"""Figures of a Sobol analysis and of identifiability.

Layouts follow the paper where it has the figure: total orders of all outputs (3, 7), total less first order
(S-3, S-7), sums stacked by output (S-4, S-5), sample sizes (S-1), distributions of the outputs (S-6). Heat
maps have two layouts: columns by their sums, and that of the paper: columns in the order of the design
(resistances, compliances, inertances, elastances) and colours from 0 to 1.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from eclsim.cases.fit_mark import untrusted
from eclsim.devices.registry import parameters
from eclsim.outputs.registry import find_output
from eclsim.reporting.style import (
    CURVES,
    GREY,
    MOST_HORIZONTAL_NAMES,
    OKABE_ITO,
    PAGE_WIDTH_MM,
    broken_name,
    draw_matrix,
    figure_style,
    new_figure,
    panel_grid,
    plain_text,
    save_figure,
    short_name,
    turned_names,
    write_above,
)
from eclsim.sensitivity.inputs import GROUPS
from eclsim.sensitivity.ranges import own_ranges_text
from eclsim.sensitivity.results import Indices, SensitivityResult
from eclsim.units import unit_after_number

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.sensitivity.identifiability import Identifiability

LEADING = 7
COLUMNS = 4
"""Number of columns of panels; the last place of the last row holds the legend."""
LABELS = {"ST": "total order $S_T$", "S1": "first order $S_1$", "ST-S1": "interactions $S_T - S_1$"}
LETTER_MM = 1.7
SHORTEST_BARS_MM = 24.0
"""Least width of a panel of bars beside the names of its factors, with room for three tick labels."""
SELECTED = " *"
MOST_SIZES = 4
"""Largest number of labelled sample sizes on an axis; the others have ticks alone."""
LONGEST_LINE = 10
"""Number of letters above which the last part of a factor's name is broken at its first underscore."""
MOST_PAIRED = 10
LONGEST_SENTENCE = 300
"""Letters of a sentence above a figure, of which no end is cut off."""
TOO_FEW_ROWS_TEXT = "Only {} of {} rows have results: too few to rank from"
SMALLEST_PAIR = 0.005
_BESIDE = 0.1
"""Distance between factors at a single sample size, in powers of 2."""
_LETTERS_OF_A_PANEL = 0.33
"""Letters of an output's name above or below a panel, per mm of its share of the page."""
Layout = Literal["sums", "paper"]


def write_sensitivity_figures(result: SensitivityResult, folder: Path) -> list[Path]:
    """Write every figure of an analysis to a folder, which is made if it does not exist."""
    indices = result.indices
    figures: dict[str, Callable[[], Figure]] = {
        "total_order": lambda: plot_heat_map(indices, "ST"),
        "total_order_as_in_paper": lambda: plot_heat_map(indices, "ST", "paper"),
        "total_less_first_order": lambda: plot_heat_map(indices, "ST-S1"),
        "total_less_first_order_as_in_paper": lambda: plot_heat_map(indices, "ST-S1", "paper"),
        "bars": lambda: plot_bars(indices),
        "sums": lambda: plot_sums(indices),
        "distributions": lambda: plot_distributions(indices, result.values),
        "convergence": lambda: plot_convergence(result.convergence),
    }
    if indices.estimates.S2 is not None and len(indices.factors) > 1:
        figures["pairs"] = lambda: plot_pairs(indices)
    doubts = [] if indices.ranked else [TOO_FEW_ROWS_TEXT.format(indices.rows_used, indices.samples)]
    doubts += [f"{indices.domain[0].upper()}{indices.domain[1:]}"] if indices.domain else []
    ranges = wrap(own_ranges_text(indices.inputs), LONGEST_SENTENCE, initial_indent="Inputs: ")
    return _save(figures, folder, [*untrusted(indices.warnings), *doubts, *ranges], _title(result))


def _title(result: SensitivityResult) -> str:
    """Patient and state, as far as they are known."""
    patient = json.loads(result.case_json)["patient"]["id"] if result.case_json else ""
    state = f"{result.indices.state} state" if result.indices.state else ""
    named = f"{plain_text(patient, 50)} – sensitivity" if patient else ""
    return ", ".join(filter(None, (named, state)))


def write_identifiability_figures(result: Identifiability, folder: Path) -> list[Path]:
    """Write every figure of an identifiability analysis to a folder."""
    figures: dict[str, Callable[[], Figure]] = {
        "scaled_sensitivity": lambda: plot_scaled(result),
        "orthogonality": lambda: plot_orthogonality(result),
        "fisher_information": lambda: plot_fisher(result),
    }
    if result.subsets:
        figures["collinearity"] = lambda: plot_collinearity(result)
    return _save(
        figures, folder, untrusted(result.warnings), f"{plain_text(result.name, 50)} – identifiability"
    )


def _save(
    figures: Mapping[str, Callable[[], Figure]], folder: Path, doubts: Sequence[str], title: str
) -> list[Path]:
    """Save figures with the patient's id, doubts, and ranges that differ, above each of them."""
    written = []
    for name, draw in figures.items():
        figure = draw()
        write_above(figure, doubts, title)
        written += save_figure(figure, folder / name)
    return written


# --- Sobol indices ---------------------------------------------------------------------------------


@figure_style()
def plot_heat_map(result: Indices, index: str = "ST", layout: Layout = "sums") -> Figure:
    """Indices of every output (rows) and factor (columns) as colours, with numbers from 0.01 up.

    Args:
        result: the indices.
        index: "ST", "S1" or "ST-S1".
        layout: "sums", largest first, or "paper".
    """
    e = result.estimates
    numbers = {"ST": e.ST, "S1": e.S1, "ST-S1": e.ST - e.S1}[index]
    order = range(len(result.factors)) if layout == "paper" else by_sum(result)
    shown = np.clip(numbers[:, list(order)], 0.0, None)
    names = [result.factors[k] for k in order]
    top = 1.0 if layout == "paper" else max(float(shown.max()), 0.05)

    def text(value: float) -> str:
        return f"{value:.2f}".removeprefix("0") if value >= 0.01 else ""

    fig = new_figure(height_mm=22 + 8.5 * len(result.outputs) + _room_for_names(names))
    axes = draw_matrix(
        fig, shown, names, result.outputs, "Blues", (0.0, top), text, lambda v: v > 0.5 * top,
        label=LABELS[index], shrink=0.9,
    )  # fmt: skip
    if layout == "paper":
        _mark_kinds(axes, names)
    return fig


def _room_for_names(names: Sequence[str]) -> float:
    """Space for names along an axis [mm]; many names are rotated."""
    longest = max(len(short_name(name)) for name in names)
    return max(12.0, LETTER_MM * longest if turned_names(names) else 0.0)


def by_sum(result: Indices) -> list[int]:
    """Positions of the factors, the largest sum of total orders first."""
    return [result.factors.index(name) for name in result.sums]


def _kind(name: str) -> str:
    parameter = parameters().get(name)
    return f"{parameter.quantity}s" if parameter and parameter.quantity in GROUPS.values() else "others"


def _mark_kinds(axes: Axes, names: Sequence[str]) -> None:
    """Label the kinds above the columns and separate them by lines, if neighbours have the same kind."""
    kinds = [key for key, _ in groupby(names, key=_kind)]
    if len(names) <= MOST_HORIZONTAL_NAMES or not len(kinds) == len(set(kinds)) > 1:
        return
    first = 0
    for kind, members in groupby(names, key=_kind):
        count = len(list(members))
        axes.text(first + 0.5 * count - 0.5, -0.62, kind, ha="center", va="bottom", color=GREY, fontsize=7)
        if first:
            axes.axvline(first - 0.5, color=GREY, linewidth=0.8)
        first += count


@figure_style()
def plot_bars(result: Indices) -> Figure:
    """First and total order of the leading factors of each output, with 95 % intervals."""
    e, chosen = result.estimates, result.selected()
    longest = max(len(short_name(name)) for name in result.factors) + len(SELECTED)
    columns = int(np.clip(PAGE_WIDTH_MM // (SHORTEST_BARS_MM + LETTER_MM * longest), 1, COLUMNS))
    fig, panels, heads = _output_grid(result.outputs, columns, 44, 16)
    for k, (output, axes, head) in enumerate(zip(result.outputs, panels, heads, strict=True)):
        sizes = -e.ST[k] if result.ranked else np.zeros(len(result.factors))
        order = np.argsort(sizes, kind="stable")[: min(8, len(result.factors))]
        place = np.arange(len(order))
        for shift, numbers, widths, colour, label in (
            (-0.2, e.S1[k, order], e.S1_conf[k, order], OKABE_ITO["sky blue"], "first order $S_1$"),
            (0.2, e.ST[k, order], e.ST_conf[k, order], OKABE_ITO["blue"], "total order $S_T$"),
        ):
            axes.barh(place + shift, numbers, 0.38, color=colour, label=label)
            whiskers = {"fmt": "none", "ecolor": "black", "elinewidth": 0.7, "capsize": 1.5}
            axes.errorbar(numbers, place + shift, xerr=widths, **whiskers)
        names = [result.factors[j] for j in order]
        labels = [short_name(name) + (SELECTED if name in chosen[output] else "") for name in names]
        axes.set_yticks(place, labels)
        axes.invert_yaxis()
        axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
        axes.xaxis.set_major_locator(MaxNLocator(3, steps=(1, 2, 5, 10)))
        axes.axvline(0.0, color=GREY, linewidth=0.6)
        axes.set_title(head)
        axes.set_xlabel("index")
    ranking = "* among those that make up 90 %" if result.ranked else "not ranked: the first inputs as listed"
    _legend_below(fig, f"lines: 95 % intervals; {ranking}")
    return fig


@figure_style()
def plot_sums(result: Indices, published: Mapping[str, float] | None = None) -> Figure:
    """Total orders of each factor stacked over the outputs; those selected for any output are in bold.

    Lines are the 95 % half widths of the sums.

    Args:
        result: the indices.
        published: sums to compare with, by factor (the paper's Table 2).
    """
    order = by_sum(result)
    union = {name for names in result.selected().values() for name in names}
    names = [result.factors[k] for k in order]
    fig = new_figure(height_mm=68 + _room_for_names(names))
    axes = fig.add_subplot()
    bottom = np.zeros(len(order))
    # Hatched as well, to be distinguishable when printed in grey.
    colours = [colour for colour, _ in CURVES][1:]
    for k, output in enumerate(result.outputs):
        heights = np.clip(result.estimates.ST[k, order], 0.0, None)
        axes.bar(
            range(len(order)), heights, 0.75, bottom=bottom, label=output, edgecolor="white",
            linewidth=0.4, facecolor=colours[k % len(colours)], hatch=("", "///", "...", "xxx")[k % 4],
        )  # fmt: skip
        bottom += heights
    widths = np.array([result.sums_conf.get(name, 0.0) for name in names])
    if result.sums_conf:
        axes.errorbar(
            range(len(order)), bottom, widths, fmt="none", ecolor="black", elinewidth=0.8, capsize=2
        )
    _label_sums(axes, names, bottom, widths, published or {})
    labels = list(map(short_name, names))
    axes.set_xticks(range(len(names)), labels, rotation=turned_names(names))
    for label, name in zip(axes.get_xticklabels(), names, strict=True):
        label.set_fontweight("bold" if name in union else "normal")
    axes.set_ylabel("sum of $S_T$ over the outputs")
    axes.legend(ncols=2, title="output; bold: selected for any")
    return fig


def _label_sums(
    axes: Axes, names: Sequence[str], sums: np.ndarray, widths: np.ndarray, published: Mapping[str, float]
) -> None:
    """Write the sums above the bars and their half widths, and mark the published ones as diamonds."""
    known = [x for x, name in enumerate(names) if name in published]
    marks = [published[names[x]] for x in known]
    if known:
        look = {"marker": "D", "s": 22, "facecolor": "white", "edgecolor": "black", "linewidth": 1.0}
        axes.scatter(known, marks, zorder=3, label="paper", **look)
    tops = dict(zip(known, marks, strict=True))
    room = 0.01 * float(sums.max())
    for x, (height, width) in enumerate(zip(sums, widths, strict=True)):
        if height >= 0.005:
            place = max(height + width, tops[x] + 2.5 * room if x in tops else 0.0) + room
            axes.text(x, place, f"{height:.2f}", ha="center", va="bottom", fontsize=6)


@figure_style()
def plot_convergence(convergence: xr.Dataset) -> Figure:
    """Total orders of the seven leading factors against the number of rows."""
    numbers = convergence.sel(index="ST")
    rows = numbers["rows"].values
    sums = numbers["mean"].isel(rows=-1).sum("output")
    leading: list[str] = [str(name) for name in numbers["factor"].values[np.argsort(-sums.values)][:LEADING]]
    outputs = numbers["output"].values.astype(str).tolist()
    fig, panels, heads = _output_grid(outputs, COLUMNS, 42, 20)
    for output, axes, head in zip(outputs, panels, heads, strict=True):
        for k, name in enumerate(leading):
            curve, (colour, line) = numbers.sel(output=output, factor=name), CURVES[k]
            mean, spread = curve["mean"].values, curve["spread"].values
            spread = np.where(np.isnan(spread), curve["mean_conf"].values / 1.96, spread)
            look = {"color": colour, "linestyle": line, "marker": "o", "markersize": 2}
            places = rows if len(rows) > 1 else rows * 2.0 ** (_BESIDE * (k - (len(leading) - 1) / 2))
            axes.plot(places, mean, label=short_name(name), **look)
            if len(rows) > 1:
                axes.fill_between(rows, mean - spread, mean + spread, color=colour, alpha=0.15, lw=0)
            else:
                axes.errorbar(places, mean, spread, fmt="none", ecolor=colour, elinewidth=0.9, capsize=2)
        axes.set_xscale("log", base=2)
        if len(rows) == 1:
            axes.set_xlim(rows[0] / 2.0, rows[0] * 2.0)
        step = -(-len(rows) // MOST_SIZES)
        named = rows[::-1][::step]
        axes.set_xticks(rows, [str(n) if n in named else "" for n in rows])
        axes.minorticks_off()
        axes.set_title(head)
        axes.set_xlabel("rows N")
        axes.set_ylabel("$S_T$")
    _legend_below(fig, "mean ± standard deviation over repeats; of a single repeat from the bootstrap")
    return fig


@figure_style()
def plot_distributions(result: Indices, values: np.ndarray) -> Figure:
    """Histograms of the outputs over the sampled inputs (points A and B), with median and central 90 %."""
    points = np.concatenate([values[:, 0], values[:, -1]])
    bins = int(np.clip(np.sqrt(len(points)), 8, 40))
    fig, (*panels, legend_panel), heads = _output_grid([*result.outputs, ""], COLUMNS, 40, 4)
    for k, (output, axes, head) in enumerate(zip(result.outputs, panels, heads, strict=False)):
        low, middle, high = np.quantile(points[:, k], (0.05, 0.5, 0.95))
        axes.hist(points[:, k], bins=bins, density=True, color=OKABE_ITO["sky blue"])
        axes.axvline(middle, color="black", linewidth=1.0, label="median")
        axes.axvspan(low, high, color=GREY, alpha=0.15, lw=0, label="central 90 %")
        unit = output_unit(output)
        axes.set_title(head)
        axes.set_xlabel(f"{head} [{unit}]" if unit else head)
        of = f"({unit})" if "/" in unit else unit
        axes.set_ylabel(f"density [1/{of}]" if unit else "density")
    _legend(legend_panel, panels[0], f"{len(points)} runs")
    return fig


def _output_grid(
    outputs: Sequence[str], columns: int, row_mm: float, margin_mm: float
) -> tuple[Figure, list[Axes], list[str]]:
    """Panels for outputs, and the outputs' names in lines as wide as a panel, for which rows are higher."""
    letters = int(_LETTERS_OF_A_PANEL * PAGE_WIDTH_MM / min(columns, len(outputs)))
    heads = [broken_name(output, letters) for output in outputs]
    lines = max(head.count("\n") for head in heads)
    return *panel_grid(len(outputs), columns, row_mm + 7.0 * lines, margin_mm), heads


def output_unit(name: str) -> str:
    """Unit of an output; empty if it is dimensionless or unknown."""
    known = find_output(name)
    return "" if known is None else unit_after_number(known.unit)


def _legend_below(fig: Figure, note: str) -> None:
    """Draw the legend of the first panel below all panels, with a note above it."""
    handles, labels = fig.axes[0].get_legend_handles_labels()
    legend = fig.legend(handles, labels, loc="outside lower center", ncols=COLUMNS, title=note)
    legend.get_title().set(fontsize=7, color=GREY)


def _legend(place: Axes, panel: Axes, note: str) -> None:
    """Draw the legend of a panel in a place of its own, with a note below it."""
    place.set_axis_off()
    handles, labels = panel.get_legend_handles_labels()
    blank = Line2D([], [], linestyle="none")
    legend = place.legend(
        [*handles, blank], [*labels, note], loc="upper left", labelspacing=0.15, borderaxespad=0.0
    )
    legend.get_texts()[-1].set(fontsize=7, color=GREY)


@figure_style()
def plot_pairs(result: Indices) -> Figure:
    """For each output, factors as circles (area: first order) and pairs as lines (width: second order).

    Pairs are drawn where the index exceeds its own 95 % half width and 0.005; the ten leading factors are
    shown.
    """
    leading = [result.factors.index(n) for n in list(result.sums)[:MOST_PAIRED]]
    leading.sort()
    angle = np.linspace(0.5 * np.pi, 2.5 * np.pi, len(leading), endpoint=False)
    place = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    fig, places = panel_grid(len(result.outputs) + 1, COLUMNS, 46)
    left, right = (-2.4, 2.6) if any("." in result.factors[i] for i in leading) else (-1.95, 1.95)
    for axes in places:
        axes.set_axis_off()
        axes.set_aspect("equal")
        axes.set(xlim=(left, right), ylim=(-1.55, 1.55))
    drawn = 0
    for k, (axes, output) in enumerate(zip(places, result.outputs, strict=False)):
        drawn += _draw_pairs(axes, result, k, leading, place)
        axes.set_title(output)
    _explain_pairs(places[-1], drawn)
    return fig


def _draw_pairs(axes: Axes, result: Indices, k: int, leading: list[int], place: np.ndarray) -> int:
    """Draw one output and return the number of pairs drawn."""
    e = result.estimates
    assert e.S2 is not None
    assert e.S2_conf is not None
    drawn = 0
    for a, i in enumerate(leading):
        for b, j in enumerate(leading[a + 1 :], a + 1):
            index, width = e.S2[k, i, j], e.S2_conf[k, i, j]
            if index > max(width, SMALLEST_PAIR):
                look = {"color": OKABE_ITO["vermillion"], "linewidth": _line(index)}
                axes.plot(*place[[a, b]].T, solid_capstyle="round", zorder=1, **look)
                drawn += 1
    for a, i in enumerate(leading):
        area = _area(e.S1[k, i])
        axes.scatter(*place[a], s=area, color=OKABE_ITO["blue"], zorder=2)
        _label_factor(axes, result.factors[i], place[a], 0.5 * np.sqrt(area) + 2.0)
    return drawn


def _label_factor(axes: Axes, name: str, place: np.ndarray, away: float) -> None:
    """Write the factor's name outside its circle, `away` points from its centre."""
    across, up = (int(np.sign(np.round(x, 2))) * (abs(x) > 0.3) for x in place)
    align = {"ha": ("center", "left", "right")[across], "va": ("center", "bottom", "top")[up]}
    if across:
        align["va"] = "center"
    # Text is not considered in the layout: the panels of all outputs have the same size.
    section, dot, last = name.rpartition(".")
    last = last.replace("_", "_\n", 1) if len(last) > LONGEST_LINE else last
    shown, at = f"{section}{dot}\n{last}".lstrip(), (away * place[0], away * place[1])
    text = axes.annotate(
        shown, (place[0], place[1]), xytext=at, textcoords="offset points", fontsize=6, **align
    )
    text.set_in_layout(False)


def _line(index: float) -> float:
    return 40.0 * index


def _area(index: float) -> float:
    return 4.0 + 260.0 * max(index, 0.0)


def _explain_pairs(axes: Axes, drawn: int) -> None:
    for height, index in zip((1.3, 0.8, 0.45), (0.5, 0.1, 0.0), strict=True):
        axes.scatter(-1.4, height, s=_area(index), color=OKABE_ITO["blue"])
        axes.text(-0.9, height, f"$S_1$ = {index:g}", va="center", fontsize=7)
    for height, index in zip((0.05, -0.3, -0.65), (0.1, 0.05, 0.01), strict=True):
        axes.plot((-1.7, -1.1), (height, height), color=OKABE_ITO["vermillion"], linewidth=_line(index))
        axes.text(-0.9, height, f"$S_2$ = {index:g}", va="center", fontsize=7)
    note = "lines: pairs beyond\ntheir 95 % half width" if drawn else "no pair is beyond its\n95 % half width"
    axes.text(-1.7, -0.95, note, va="top", fontsize=7, color=GREY)


# --- Identifiability ----------------------------------------------------------------------------------


@figure_style()
def plot_scaled(result: Identifiability) -> Figure:
    """Change of each measurement, in standard uncertainties, if a parameter changes by 10 %."""
    scaled = result.scaled
    order = np.argsort(-scaled.effect, kind="stable")
    shown = 0.1 * scaled.matrix[:, order]
    top = float(np.abs(shown).max())
    fig = new_figure(height_mm=22 + 8.5 * len(scaled.outputs) + 12)
    draw_matrix(
        fig, shown, [scaled.parameters[k] for k in order], scaled.outputs, "PuOr", (-top, top),
        lambda v: f"{v:+.1f}" if abs(v) >= 0.05 else "", lambda v: abs(v) > 0.6 * top,
        label="uncertainties per 10 %",
    )  # fmt: skip
    return fig


@figure_style()
def plot_orthogonality(result: Identifiability) -> Figure:
    """Sine of the angle between the effects of two parameters; 0 if they cannot be distinguished."""
    order = np.argsort(-result.scaled.effect, kind="stable")[:14]
    names = [result.scaled.parameters[k] for k in order]
    shown = result.scaled.orthogonality[np.ix_(order, order)]
    np.fill_diagonal(shown, np.nan)
    fig = new_figure(width_mm=130, height_mm=105)
    draw_matrix(
        fig, shown, names, names, "cividis", (0.0, 1.0), lambda v: f"{v:.2f}" if np.isfinite(v) else "",
        lambda v: v < 0.5, label="orthogonality: 1 unlike, 0 alike", aspect="equal", pad=0.02,
    )  # fmt: skip
    return fig


@figure_style()
def plot_collinearity(result: Identifiability) -> Figure:
    """Collinearity index against the size of the set: smallest, and 5, 50 and 95 % quantiles of all sets."""
    sizes = np.array([s.size for s in result.subsets])
    smallest = [s.smallest for s in result.subsets]
    low, middle, high = (np.array([s.quantiles[k] for s in result.subsets]) for k in range(3))
    finite = [x for x in (*smallest, *low, *middle, *high) if np.isfinite(x)]
    ceiling = 3.0 * max([*finite, 20.0])
    fig = new_figure(width_mm=110, height_mm=85)
    axes = fig.add_subplot()
    band = {"color": OKABE_ITO["sky blue"], "alpha": 0.4, "lw": 0}
    axes.fill_between(sizes, low, np.minimum(high, ceiling), label="5 to 95 %", **band)
    axes.plot(sizes, middle, color=OKABE_ITO["blue"], label="median of all sets")
    axes.plot(sizes, smallest, "o-", color="black", markersize=3, label="best set")
    axes.axhspan(10.0, 15.0, color=GREY, alpha=0.25, lw=0, label="limit 10 to 15")
    chosen = len(result.proposal.chosen)
    if chosen > 1:
        axes.plot(
            chosen, result.proposal.collinearity, "D", color=OKABE_ITO["vermillion"], label="proposed set"
        )
    axes.set_yscale("log")
    axes.set_ylim(0.9, ceiling)
    axes.set_xticks(sizes)
    axes.set_xlabel("parameters in the set")
    axes.set_ylabel("collinearity index")
    fig.legend(loc="outside lower center", ncols=3)
    return fig


@figure_style()
def plot_fisher(result: Identifiability) -> Figure:
    """Eigenvectors of the Fisher information: combinations of parameters that the measurements determine."""
    count = min(len(result.scaled.outputs), len(result.scaled.parameters))
    order = np.argsort(-result.scaled.effect, kind="stable")[:12]
    names = [result.scaled.parameters[k] for k in order]
    vectors = result.fisher.eigenvectors[order, :count].T
    errors = 100.0 / np.sqrt(np.maximum(result.fisher.eigenvalues[:count], 1e-300))
    labels = [f"{k + 1}: ±{e:.0f} %" if e <= 100.0 else f"{k + 1}: over 100 %" for k, e in enumerate(errors)]
    fig = new_figure(height_mm=24 + 8.5 * count)
    axes = draw_matrix(
        fig, vectors, names, labels, "PuOr", (-1.0, 1.0), lambda v: f"{v:+.2f}" if abs(v) >= 0.1 else "",
        lambda v: abs(v) > 0.6, label="share of the parameter",
    )  # fmt: skip
    axes.set_ylabel("combination: standard error")
    return fig
