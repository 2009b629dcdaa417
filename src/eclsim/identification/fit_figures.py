"""Figures of one fit: profile likelihoods, residuals, correlation of the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eclsim.identification.search_figures import parameter_axis
from eclsim.reporting.style import GREY, OKABE_ITO, figure_style, new_figure


def plot_profiles(found: Any, along: Any, units: Mapping[str, str], rise: float) -> Figure:
    """Chi-square along each parameter with the others fitted again, beside that with the others held.

    Args:
        found: an `eclsim.identification.profiles.CostCurves`.
        along: likewise, through the same point.
        units: of the parameters.
        rise: a value is within the 90 % interval where the profile is at most so much above its least.
    """
    count = len(found.names)
    across = min(count, 3)
    down = -(-count // across)
    limit = float(np.nanmin(found.costs)) + rise
    with figure_style():
        fig = new_figure(height_mm=16 + 46 * down)
        for k, name in enumerate(found.names):
            axes = fig.add_subplot(down, across, k + 1)
            axes.plot(along.values[k], along.costs[k], color=GREY, label="others held")
            axes.plot(
                found.values[k], found.costs[k], "o-", color=OKABE_ITO["blue"], markersize=2.5,
                label="others fitted again",
            )  # fmt: skip
            axes.axhline(limit, color="black", lw=0.8, ls=(0, (4, 2)), label="limit of the 90 % interval")
            axes.plot(
                found.optimum[k], found.cost, "o", color=OKABE_ITO["vermillion"], markersize=4,
                label="likeliest", clip_on=False, zorder=5,
            )  # fmt: skip
            low = limit - rise
            axes.set_ylim(low - 0.15 * rise, low + 4.0 * rise)
            parameter_axis(axes, name, units.get(name, ""), found.values[k])
            if k % across == 0:
                axes.set_ylabel("chi-square")
        handles, labels = fig.axes[0].get_legend_handles_labels()
        fig.legend(handles, labels, loc="outside upper center", ncols=4)
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
    shown = {
        name: (cell["simulated"] - cell["measured"]) / uncertainties[name]
        for name, cell in outputs.items()
        if cell["measured"] is not None and cell["simulated"] is not None
    }
    with figure_style():
        fig = new_figure(height_mm=62)
        axes = fig.subplots()
        axes.axhspan(-1.0, 1.0, color=GREY, alpha=0.2, lw=0, label="one standard uncertainty")
        axes.axhline(0.0, color=GREY, lw=0.8)
        for k, (level, edge) in enumerate(edges.items()):
            for sign in (1.0, -1.0):
                axes.axhline(
                    sign * edge, color=(OKABE_ITO["orange"], OKABE_ITO["vermillion"])[k], lw=0.9,
                    ls=((0, (4, 2)), "-")[k], label=f"{level} beyond ±{edge:g}" if sign > 0.0 else None,
                )  # fmt: skip
        axes.stem(range(len(shown)), list(shown.values()), linefmt="C0-", markerfmt="C0o", basefmt=" ")
        reach = 1.15 * max(*edges.values(), *(abs(v) for v in shown.values()))
        axes.set_ylim(-reach, reach)
        axes.set_xticks(range(len(shown)), list(shown))
        axes.set_ylabel("(simulated - measured)\n/ standard uncertainty")
        fig.legend(loc="outside upper center", ncols=3)
    return fig


def plot_correlation(names: Sequence[str], matrix: np.ndarray) -> Figure:
    """Correlation of the estimates of the parameters.

    Args:
        names: of the parameters.
        matrix: shape (parameters, parameters).
    """
    size = len(names)
    with figure_style():
        side = 10.0 * max(size, 4)
        fig = new_figure(width_mm=1.08 * side + 33.0, height_mm=side + 18.0)
        axes = fig.subplots()
        shown = axes.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
        axes.set_xticks(range(size), names, rotation=45, ha="right")
        axes.set_yticks(range(size), names)
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        for row in range(size):
            for column in range(size):
                value = matrix[row, column]
                colour = "white" if abs(value) > 0.6 else "black"
                axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=6, color=colour)
        fig.colorbar(shown, ax=axes, label="correlation of the logarithms", fraction=0.05, pad=0.03)
    return fig
