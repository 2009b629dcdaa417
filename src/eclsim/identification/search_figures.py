"""Figures of fits: slices through the objective, convergence of starts, a cohort's scatter and box plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eclsim.reporting.style import GREY, OKABE_ITO, figure_style, new_figure

PRESSURES = ("SP", "DP", "MAP", "MPAP", "PCWP")
FLOWS = ("CO", "PF")
_MARKS = {
    "SP": ("o", "vermillion"), "DP": ("s", "blue"), "MAP": ("^", "black"), "MPAP": ("D", "bluish green"),
    "PCWP": ("v", "orange"), "CO": ("o", "vermillion"), "PF": ("s", "blue"),
}  # fmt: skip


def parameter_axis(axes: Any, name: str, unit: str, values: np.ndarray) -> None:
    """A logarithmic axis from bound to bound, with ticks written as plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    axes.set_xlim(values[0], values[-1])
    wide = values[-1] / values[0] > 8.0
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0,) if wide else (1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel(f"{name} [{unit}]" if unit else name)


def plot_slices(found: Any, units: Mapping[str, str]) -> Figure:
    """Cost along each parameter from bound to bound, of an `eclsim.identification.profiles.CostCurves`.

    Args:
        found: slices.
        units: of the parameters.
    """
    count = len(found.names)
    across = min(count, 3)
    down = -(-count // across)
    with figure_style():
        fig = new_figure(height_mm=12 + 46 * down)
        for k, name in enumerate(found.names):
            axes = fig.add_subplot(down, across, k + 1)
            axes.plot(found.values[k], found.costs[k], color="black")
            axes.plot(
                found.optimum[k], found.cost, "o", color=OKABE_ITO["vermillion"], markersize=4, clip_on=False
            )
            lost = ~np.isfinite(found.costs[k])
            if lost.any():
                level = np.full(lost.sum(), np.nanmin(found.costs[k]))
                axes.plot(found.values[k][lost], level, "x", color=GREY, markersize=3, clip_on=False)
            axes.set_yscale("log")
            parameter_axis(axes, name, units.get(name, ""), found.values[k])
            if k % across == 0:
                axes.set_ylabel("sum of squared residuals")
        lost = "; crosses: no steady heartbeat" if np.isnan(found.costs).any() else ""
        fig.suptitle(f"Cost along each parameter, the others at the optimum (dot){lost}")
    return fig


def plot_starts(starts: Any, names: Sequence[str], lower: np.ndarray, upper: np.ndarray) -> Figure:
    """Cost of every start before and after its refinement, and where in the bounds it ended.

    Args:
        starts: an `eclsim.identification.multi_start.Starts`.
        names: of the parameters.
        lower: logarithms of their lower bounds.
        upper: of their upper bounds.
    """
    good, number = starts.agreeing, np.arange(1, len(starts.agreeing) + 1)
    with figure_style():
        fig = new_figure(height_mm=75)
        left, right = fig.subplots(1, 2, width_ratios=(1.15, 1.0))
        left.plot(
            number, starts.first_costs, "o", mfc="none", color=GREY, markersize=4, label="explored point"
        )
        for chosen, colour, mark, label in (
            (~good, OKABE_ITO["blue"], "s", "refined, elsewhere"),
            (good, OKABE_ITO["vermillion"], "o", "refined, the optimum"),
        ):
            if chosen.any():
                left.plot(
                    number[chosen], starts.last_costs[chosen], mark, color=colour, markersize=4, label=label
                )
        left.set_yscale("log")
        left.xaxis.get_major_locator().set_params(integer=True)
        left.set_xlabel("start")
        left.set_ylabel("sum of squared residuals")
        left.legend(loc="best", frameon=True, framealpha=0.9)
        place = (starts.end - lower) / (upper - lower)
        for rows, colour, width in ((~good, OKABE_ITO["blue"], 0.6), (good, OKABE_ITO["vermillion"], 1.0)):
            if rows.any():
                right.plot(range(len(names)), place[rows].T, color=colour, lw=width, alpha=0.7)
        right.set_xticks(range(len(names)), names, rotation=45, ha="right")
        right.set_yticks((0.0, 0.5, 1.0), ("lower\nbound", "middle", "upper\nbound"))
        right.set_ylim(-0.06, 1.06)
        right.set_ylabel("where it ended (log scale)")
    return fig


def plot_scatter(results: Sequence[Mapping[str, Any]], r2: Mapping[str, float | None]) -> Figure:
    """Simulated against measured values of a cohort (Figure 4 a and b).

    Args:
        results: data points as in the JSON file.
        r2: of "pressures" and "flows".
    """
    with figure_style():
        fig = new_figure(height_mm=88)
        axes = fig.subplots(1, 2)
        for ax, names, key, unit in zip(
            axes, (PRESSURES, FLOWS), ("pressures", "flows"), ("mmHg", "L/min"), strict=True
        ):
            shown = {n: values for n in names if len(values := _pairs(results, n))}
            ends = [v for values in shown.values() for v in values.ravel()] or [0.0, 1.0]
            top = 1.05 * max(ends)
            ax.plot((0.0, top), (0.0, top), color=GREY, lw=0.8, zorder=0)
            for name, values in shown.items():
                mark, colour = _MARKS[name]
                ax.plot(
                    values[:, 0], values[:, 1], mark, color=OKABE_ITO[colour], markersize=3.6, mfc="none",
                    mew=0.9, label=name,
                )  # fmt: skip
            ax.set(xlim=(0.0, top), ylim=(0.0, top), aspect="equal")
            ax.set_xlabel(f"measured [{unit}]")
            ax.set_ylabel(f"simulated [{unit}]")
            value = r2.get(key)
            ax.set_title(f"{key}: R² = {value:.3f}" if value is not None else key)
            if shown:
                ax.legend(loc="upper left", handletextpad=0.2)
    return fig


def plot_boxes(results: Sequence[Mapping[str, Any]]) -> Figure:
    """Distributions of measured and simulated values of a cohort (Figure 4 c and d)."""
    with figure_style():
        fig = new_figure(height_mm=75)
        axes = fig.subplots(1, 2, width_ratios=(5, 2))
        for ax, names, label in zip(
            axes, (PRESSURES, FLOWS), ("pressure [mmHg]", "flow [L/min]"), strict=True
        ):
            ax.set_ylabel(label)
            shown = {n: values for n in names if len(values := _pairs(results, n))}
            for side, whose, colour in ((0, "measured", "sky blue"), (1, "simulated", "orange")):
                if shown:
                    drawn = ax.boxplot(
                        [values[:, side] for values in shown.values()],
                        positions=np.arange(len(shown)) + (-0.19, 0.19)[side],
                        widths=0.32, patch_artist=True, manage_ticks=False,
                        medianprops={"color": "black"}, flierprops={"markersize": 2.5},
                        boxprops={"facecolor": OKABE_ITO[colour], "linewidth": 0.7,
                                  "hatch": ("", "////")[side], "edgecolor": "black"},
                    )  # fmt: skip
                    drawn["boxes"][0].set_label(whose)
            ax.set_xticks(range(len(shown)), list(shown))
            ax.set_ylim(bottom=0.0)
            if shown and names is PRESSURES:
                ax.legend(loc="upper right")
    return fig


def _pairs(results: Sequence[Mapping[str, Any]], name: str) -> np.ndarray:
    """Measured and simulated values of one output, shape (values, 2)."""
    cells = [result["outputs"].get(name) or {} for result in results]
    kept = [
        (c["measured"], c["simulated"]) for c in cells if None not in (c.get("measured"), c.get("simulated"))
    ]
    return np.array(kept, dtype=float).reshape(-1, 2)
