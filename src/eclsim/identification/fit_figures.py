"""Figures of one fit (slices, profiles, starts, residuals, correlation) and of a cohort (scatter, boxes)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from eclsim.identification.observation import FLOWS, PRESSURES, measured_and_simulated
from eclsim.identification.scale import Scale, short
from eclsim.reporting.style import GREY, OKABE_ITO, figure_style, new_figure

if TYPE_CHECKING:
    from eclsim.identification.multi_start import Starts
    from eclsim.identification.profiles import CostCurves

_MARKS = {
    "SP": ("o", "vermillion"), "DP": ("s", "blue"), "MAP": ("^", "black"), "MPAP": ("D", "bluish green"),
    "PCWP": ("v", "orange"), "CO": ("o", "vermillion"), "PF": ("s", "blue"),
}  # fmt: skip
_DOT: dict[str, Any] = {"color": OKABE_ITO["vermillion"], "markersize": 4, "clip_on": False}


def _parameter_panels(
    curves: CostCurves, units: Mapping[str, str], label: str, margin_mm: float
) -> tuple[Figure, Iterator[tuple[int, Axes]]]:
    """A figure with a panel for each parameter from bound to bound, its axis as it is sought."""
    count = len(curves.names)
    across = min(count, 3)
    down = -(-count // across)
    fig = new_figure(height_mm=margin_mm + 46 * down)

    def panels() -> Iterator[tuple[int, Axes]]:
        for k, (name, values) in enumerate(zip(curves.names, curves.values, strict=True)):
            axes = fig.add_subplot(down, across, k + 1)
            yield k, axes
            if not Scale.of([name]).linear[0]:
                axes.set_xscale("log")
                wide = values[-1] / values[0] > 8.0
                axes.xaxis.set_major_locator(LogLocator(subs=(1.0,) if wide else (1.0, 2.0, 5.0)))
                axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
                axes.xaxis.set_minor_formatter(NullFormatter())
            axes.set_xlim(values[0], values[-1])
            axes.set_xlabel(f"{name} [{unit}]" if (unit := units.get(name, "")) not in ("", "1") else name)
            if k % across == 0:
                axes.set_ylabel(label)

    return fig, panels()


def plot_slices(slices: CostCurves, units: Mapping[str, str]) -> Figure:
    """Cost along each parameter from bound to bound, the others at the optimum.

    Args:
        slices: costs along each parameter.
        units: of the parameters.
    """
    with figure_style():
        fig, panels = _parameter_panels(slices, units, "sum of squared residuals", 12)
        for k, axes in panels:
            values, costs = slices.values[k], slices.costs[k]
            axes.plot(values, costs, color="black")
            axes.plot(slices.optimum[k], slices.cost, "o", **_DOT)
            if (missing := ~np.isfinite(costs)).any():
                level = np.full(missing.sum(), np.nanmin(costs))
                axes.plot(values[missing], level, "x", color=GREY, markersize=3, clip_on=False)
            axes.set_yscale("log")
        crosses = "; crosses: no steady heartbeat" if np.isnan(slices.costs).any() else ""
        fig.suptitle(f"Cost along each parameter, the others at the optimum (dot){crosses}")
    return fig


def plot_profiles(refitted: CostCurves, held: CostCurves, units: Mapping[str, str], rise: float) -> Figure:
    """Chi-square along each parameter with the others fitted again, beside that with the others held.

    Args:
        refitted: the others fitted again.
        held: the others held, through the same point.
        units: of the parameters.
        rise: a value is within the 90 % interval where the profile is at most so much above its least.
    """
    low = float(np.nanmin(refitted.costs))
    with figure_style():
        fig, panels = _parameter_panels(refitted, units, "chi-square", 16)
        for k, axes in panels:
            axes.plot(held.values[k], held.costs[k], color=GREY, label="others held")
            axes.plot(
                refitted.values[k], refitted.costs[k], "o-", color=OKABE_ITO["blue"], markersize=2.5,
                label="others fitted again",
            )  # fmt: skip
            dashed = (0, (4, 2))
            axes.axhline(low + rise, color="black", lw=0.8, ls=dashed, label="limit of the 90 % interval")
            axes.plot(refitted.optimum[k], refitted.cost, "o", label="likeliest", zorder=5, **_DOT)
            axes.set_ylim(low - 0.15 * rise, low + 4.0 * rise)
        handles, labels = fig.axes[0].get_legend_handles_labels()
        fig.legend(handles, labels, loc="outside upper center", ncols=4)
    return fig


def plot_starts(starts: Starts, names: Sequence[str], lower: np.ndarray, upper: np.ndarray) -> Figure:
    """Cost of every start before and after its refinement, and where in the bounds it ended.

    Args:
        starts: all that were refined.
        names: of the parameters.
        lower: logarithms of their lower bounds.
        upper: of their upper bounds.
    """
    good, number = starts.agreeing, np.arange(1, len(starts.agreeing) + 1)
    place = (starts.end - lower) / (upper - lower)
    kinds = (
        (~good, OKABE_ITO["blue"], "s", "refined, another end", 0.6),
        (good, OKABE_ITO["vermillion"], "o", "refined, the optimum", 1.0),
    )
    with figure_style():
        fig = new_figure(height_mm=75)
        left, right = fig.subplots(1, 2, width_ratios=(1.15, 1.0))
        left.plot(
            number, starts.first_costs, "o", mfc="none", color=GREY, markersize=4, label="explored point"
        )
        for rows, colour, mark, label, width in kinds:
            if rows.any():
                costs = starts.last_costs[rows]
                left.plot(number[rows], costs, mark, color=colour, markersize=4, label=label)
                right.plot(range(len(names)), place[rows].T, color=colour, lw=width, alpha=0.7)
        left.set_yscale("log")
        left.xaxis.get_major_locator().set_params(integer=True)
        left.set_xlabel("start")
        left.set_ylabel("sum of squared residuals")
        left.legend(loc="best", frameon=True, framealpha=0.9)
        right.set_xticks(range(len(names)), list(map(short, names)), rotation=45, ha="right")
        right.set_yticks((0.0, 0.5, 1.0), ("lower\nbound", "middle", "upper\nbound"))
        right.set_ylim(-0.06, 1.06)
        right.set_ylabel("where it ended")
    return fig


def plot_residuals(
    outputs: Mapping[str, Mapping[str, float | None]],
    uncertainties: Mapping[str, float],
    edges: Mapping[str, float],
) -> Figure:
    """Differences of one fit from what was measured, in standard uncertainties.

    Args:
        outputs: "measured" and "simulated" of each output, as in the JSON file.
        uncertainties: standard uncertainty of each measurement, in its unit.
        edges: difference beyond which a fit is called so, the milder word first.
    """
    pairs = {n: measured_and_simulated([{"outputs": outputs}], [n]) for n in outputs}
    shown = {n: (each[0, 1] - each[0, 0]) / uncertainties[n] for n, each in pairs.items() if len(each)}
    looks = (("orange", (0, (4, 2))), ("vermillion", "-"))
    with figure_style():
        fig = new_figure(height_mm=62)
        axes = fig.subplots()
        axes.axhspan(-1.0, 1.0, color=GREY, alpha=0.2, lw=0, label="one standard uncertainty")
        axes.axhline(0.0, color=GREY, lw=0.8)
        for (colour, line), (level, edge) in zip(looks, edges.items(), strict=False):
            axes.axhline(edge, color=OKABE_ITO[colour], ls=line, lw=0.9, label=f"{level} beyond ±{edge:g}")
            axes.axhline(-edge, color=OKABE_ITO[colour], ls=line, lw=0.9)
        axes.stem(range(len(shown)), list(shown.values()), linefmt="C0-", markerfmt="C0o", basefmt=" ")
        reach = 1.15 * max(*edges.values(), *(abs(v) for v in shown.values()))
        axes.set_ylim(-reach, reach)
        axes.set_xticks(range(len(shown)), list(shown))
        axes.set_ylabel("(simulated - measured)\n/ standard uncertainty")
        fig.legend(loc="outside upper center", ncols=3)
    return fig


def plot_correlation(names: Sequence[str], matrix: np.ndarray) -> Figure:
    """Correlation of the estimates of the parameters; matrix (parameters, parameters)."""
    size = len(names)
    with figure_style():
        side = 10.0 * max(size, 4)
        fig = new_figure(width_mm=1.08 * side + 33.0, height_mm=side + 18.0)
        axes = fig.subplots()
        image = axes.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
        axes.set_xticks(range(size), list(map(short, names)), rotation=45, ha="right")
        axes.set_yticks(range(size), list(map(short, names)))
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        for (row, column), value in np.ndenumerate(matrix):
            colour = "white" if abs(value) > 0.6 else "black"
            axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=6, color=colour)
        fig.colorbar(image, ax=axes, label="correlation of the estimates", fraction=0.05, pad=0.03)
    return fig


def plot_scatter(results: Sequence[Mapping[str, Any]], r2: Mapping[str, float | None]) -> Figure:
    """Simulated against measured values of a cohort (Figure 4 a and b).

    Args:
        results: data points as in the JSON file.
        r2: of "pressures" and "flows".
    """
    kinds = ((PRESSURES, "pressures", "mmHg"), (FLOWS, "flows", "L/min"))
    with figure_style():
        fig = new_figure(height_mm=88)
        for ax, (names, key, unit) in zip(fig.subplots(1, 2), kinds, strict=True):
            shown = _shown(results, names)
            ends = [v for values in shown.values() for v in values.ravel()] or [0.0, 1.0]
            top = 1.05 * max(ends)
            ax.plot((0.0, top), (0.0, top), color=GREY, lw=0.8, zorder=0)
            for name, values in shown.items():
                mark, colour = _MARKS[name]
                ax.plot(
                    *values.T, mark, color=OKABE_ITO[colour], markersize=3.6, mfc="none", mew=0.9, label=name
                )
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
    kinds = ((PRESSURES, "pressure [mmHg]"), (FLOWS, "flow [L/min]"))
    sides = (("measured", -0.19, "sky blue", ""), ("simulated", 0.19, "orange", "////"))
    with figure_style():
        fig = new_figure(height_mm=75)
        for ax, (names, label) in zip(fig.subplots(1, 2, width_ratios=(5, 2)), kinds, strict=True):
            ax.set_ylabel(label)
            shown = _shown(results, names)
            for column, (side, shift, colour, hatch) in enumerate(sides if shown else ()):
                face = {"facecolor": OKABE_ITO[colour], "linewidth": 0.7}
                drawn = ax.boxplot(
                    [values[:, column] for values in shown.values()], positions=np.arange(len(shown)) + shift,
                    widths=0.32, patch_artist=True, manage_ticks=False, medianprops={"color": "black"},
                    flierprops={"markersize": 2.5},
                    boxprops={**face, "hatch": hatch, "edgecolor": "black"},
                )  # fmt: skip
                drawn["boxes"][0].set_label(side)
            ax.set_xticks(range(len(shown)), list(shown))
            ax.set_ylim(bottom=0.0)
            if shown and names is PRESSURES:
                ax.legend(loc="upper right")
    return fig


def _shown(results: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, np.ndarray]:
    """Measured and simulated values of each output that has any."""
    each = {name: measured_and_simulated(results, [name]) for name in names}
    return {name: values for name, values in each.items() if len(values)}
