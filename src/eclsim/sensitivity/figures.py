"""Figures of a Sobol analysis: heat maps, bars with intervals, convergence, densities, network of pairs.

Layouts follow the paper where it has the figure: total orders of all outputs (3, 7), total less first order
(S-3, S-7), sums stacked by output (S-4, S-5), sample sizes (S-1), distributions of the outputs (S-6).
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure

from eclsim.reporting.style import CURVES, GREY, OKABE_ITO, curve_style, figure_style, new_figure, save_figure
from eclsim.sensitivity.heat_map import FEW_FACTORS, by_sum, plot_heat_map
from eclsim.sensitivity.pair_network import plot_pairs

UNITS = {
    "SP": "mmHg",
    "DP": "mmHg",
    "MAP": "mmHg",
    "MPAP": "mmHg",
    "PCWP": "mmHg",
    "CO": "L/min",
    "PF": "L/min",
}
LEADING = 7


class SobolResult(Protocol):
    """What the figures need of `eclsim.sensitivity.indices.Indices`."""

    @property
    def factors(self) -> tuple[str, ...]: ...  # noqa: D102  # a description of another class
    @property
    def outputs(self) -> tuple[str, ...]: ...  # noqa: D102  # likewise
    @property
    def estimates(self) -> Any: ...  # noqa: D102  # likewise
    @property
    def sums(self) -> dict[str, float]: ...  # noqa: D102  # likewise
    def selected(self) -> dict[str, list[str]]: ...  # noqa: D102  # likewise


def write_sensitivity_figures(
    result: SobolResult,
    folder: Path,
    values: np.ndarray,
    settled: Any = None,
    formats: Sequence[str] = ("svg", "png"),
) -> list[Path]:
    """Write every figure of an analysis.

    Args:
        result: the indices.
        folder: is made if it does not exist.
        values: outputs of the runs, shape (rows, runs per row, outputs).
        settled: `eclsim.sensitivity.convergence.Convergence`, or None.
        formats: one file of each per figure.
    """
    figures: dict[str, Callable[[], Figure]] = {
        "total_order": lambda: plot_heat_map(result, "ST"),
        "total_order_as_in_paper": lambda: plot_heat_map(result, "ST", "paper"),
        "total_less_first_order": lambda: plot_heat_map(result, "ST-S1"),
        "total_less_first_order_as_in_paper": lambda: plot_heat_map(result, "ST-S1", "paper"),
        "bars": lambda: plot_bars(result),
        "sums": lambda: plot_sums(result),
        "distributions": lambda: plot_distributions(result, values),
    }
    if settled is not None:
        figures["convergence"] = lambda: plot_convergence(settled)
    if result.estimates.S2 is not None and len(result.factors) > 1:
        figures["pairs"] = lambda: plot_pairs(result)
    written: list[Path] = []
    for name, draw in figures.items():
        written += save_figure(draw(), folder / name, formats)
    return written


def plot_bars(result: SobolResult) -> Figure:
    """First and total order of the leading factors of each output, with 95 % intervals."""
    e, chosen = result.estimates, result.selected()
    with figure_style():
        fig, panels = _panels(len(result.outputs), height_mm=44)
        for k, (output, axes) in enumerate(zip(result.outputs, panels, strict=True)):
            order = np.argsort(-e.ST[k], kind="stable")[: min(8, len(result.factors))]
            place = np.arange(len(order))
            for shift, numbers, widths, colour, label in (
                (-0.2, e.S1[k, order], e.S1_conf[k, order], OKABE_ITO["sky blue"], "first order $S_1$"),
                (0.2, e.ST[k, order], e.ST_conf[k, order], OKABE_ITO["blue"], "total order $S_T$"),
            ):
                axes.barh(place + shift, numbers, 0.38, color=colour, label=label)
                whiskers = {"fmt": "none", "ecolor": "black", "elinewidth": 0.7, "capsize": 1.5}
                axes.errorbar(numbers, place + shift, xerr=widths, **whiskers)
            names = [result.factors[j] + (" *" if result.factors[j] in chosen[output] else "") for j in order]
            axes.set_yticks(place, names)
            axes.invert_yaxis()
            axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
            axes.axvline(0.0, color=GREY, linewidth=0.6)
            axes.set_title(output)
            axes.set_xlabel("index")
        _legend(fig, panels, len(result.outputs), "bars: 95 % intervals\n* among those that\n  make up 90 %")
    return fig


def plot_sums(result: SobolResult, published: Mapping[str, float] | None = None) -> Figure:
    """Total orders of each factor stacked over the outputs; those selected for any output are in bold.

    Args:
        result: the indices.
        published: sums to compare with, by factor (the paper's Table 2).
    """
    order = by_sum(result)
    union = {name for names in result.selected().values() for name in names}
    with figure_style():
        fig = new_figure(height_mm=80)
        axes = fig.add_subplot()
        bottom = np.zeros(len(order))
        # Hatched as well: told apart when printed in grey.
        colours = [colour for colour, _ in CURVES][1:]
        edge: dict[str, Any] = {"edgecolor": "white", "linewidth": 0.4}
        for k, output in enumerate(result.outputs):
            heights = np.clip(result.estimates.ST[k, order], 0.0, None)
            edge["facecolor"], edge["hatch"] = colours[k % len(colours)], ("", "///", "...", "xxx")[k % 4]
            axes.bar(range(len(order)), heights, 0.75, bottom=bottom, label=output, **edge)
            bottom += heights
        names = [result.factors[k] for k in order]
        _label_sums(axes, names, bottom, published or {})
        axes.set_xticks(range(len(names)), names, rotation=90 if len(names) > FEW_FACTORS else 0)
        for label in axes.get_xticklabels():
            label.set_fontweight("bold" if label.get_text() in union else "normal")
        axes.set_ylabel("sum of $S_T$ over the outputs")
        axes.legend(ncols=2, title="output; bold: selected for any")
    return fig


def _label_sums(axes: Any, names: Sequence[str], sums: np.ndarray, published: Mapping[str, float]) -> None:
    """The sums in figures above the bars, and the published ones as diamonds."""
    known = [x for x, name in enumerate(names) if name in published]
    marks = [published[names[x]] for x in known]
    if known:
        look = {"marker": "D", "s": 22, "facecolor": "white", "edgecolor": "black", "linewidth": 1.0}
        axes.scatter(known, marks, zorder=3, label="paper", **look)
    tops = dict(zip(known, marks, strict=True))
    room = 0.01 * float(sums.max())
    for x, height in enumerate(sums):
        if height >= 0.005:
            place = max(height, tops[x] + 2.5 * room if x in tops else 0.0) + room
            axes.text(x, place, f"{height:.2f}", ha="center", va="bottom", fontsize=6)


def plot_convergence(settled: Any) -> Figure:
    """Total orders of the seven leading factors against the number of rows."""
    with figure_style():
        fig, panels = _panels(len(settled.outputs), height_mm=42)
        leading = [settled.factors[j] for j in np.argsort(-settled.mean["ST"][-1].sum(axis=0))]
        look = {name: curve_style(k) for k, name in enumerate(leading[:LEADING])}
        for k, (output, axes) in enumerate(zip(settled.outputs, panels, strict=True)):
            for name in leading[:LEADING]:
                j = settled.factors.index(name)
                mean, spread = settled.mean["ST"][:, k, j], settled.spread["ST"][:, k, j]
                width = settled.width["ST"][:, k, j]
                spread = np.where(np.isnan(spread), width / 1.96, spread)
                axes.plot(settled.rows, mean, label=name, **look[name])
                band = {"color": look[name]["color"], "alpha": 0.15, "lw": 0}
                axes.fill_between(settled.rows, mean - spread, mean + spread, **band)
            axes.set_xscale("log", base=2)
            axes.set_xticks(settled.rows[-1::-3], [str(n) for n in settled.rows[-1::-3]])
            axes.minorticks_off()
            axes.set_title(output)
            axes.set_xlabel("rows N")
            axes.set_ylabel("$S_T$")
        _legend(
            fig,
            panels,
            len(settled.outputs),
            "mean ± standard deviation\nover repeats; at the last N\nfrom the bootstrap",
        )
    return fig


def plot_distributions(result: SobolResult, values: np.ndarray) -> Figure:
    """Histograms of the outputs over the sampled inputs (points A and B), with median and central 90 %."""
    points = np.concatenate([values[:, 0], values[:, -1]])
    bins = int(np.clip(np.sqrt(len(points)), 8, 40))
    with figure_style():
        fig, panels = _panels(len(result.outputs), height_mm=40)
        for k, (output, axes) in enumerate(zip(result.outputs, panels, strict=True)):
            low, middle, high = np.quantile(points[:, k], (0.05, 0.5, 0.95))
            axes.hist(points[:, k], bins=bins, density=True, color=OKABE_ITO["sky blue"])
            axes.axvline(middle, color="black", linewidth=1.0, label="median")
            axes.axvspan(low, high, color=GREY, alpha=0.15, lw=0, label="central 90 %")
            unit = UNITS.get(output, "")
            axes.set_title(output)
            axes.set_xlabel(f"{output} [{unit}]" if unit else output)
            axes.set_ylabel(f"density [1/{unit}]" if "/" not in unit else f"density [1/({unit})]")
        _legend(fig, panels, len(result.outputs), f"{len(points)} runs")
    return fig


def _panels(count: int, height_mm: float, columns: int = 4) -> tuple[Figure, list[Any]]:
    """Panels in rows of four; there is always one place more than panels, for the legend."""
    columns = min(columns, count + 1)
    rows = -(-(count + 1) // columns)
    fig = new_figure(height_mm=height_mm * rows + 4)
    grid = fig.subplots(rows, columns, squeeze=False)
    for axes in grid.flat[count:]:
        axes.set_axis_off()
    return fig, list(grid.flat[:count])


def _legend(fig: Figure, panels: list[Any], count: int, note: str) -> None:
    """Legend of the first panel in the place after the last one."""
    place = fig.axes[count]
    place.legend(*panels[0].get_legend_handles_labels(), loc="upper left", labelspacing=0.15)
    place.text(0.05, -0.3, note, transform=place.transAxes, va="bottom", fontsize=7, color=GREY)
