"""Figures of one fit: profile likelihoods, residuals, correlation of the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eclsim.plotting.style import GREY, OKABE_ITO, figure_style, new_figure


def plot_profiles(found: Any, along: Any, units: Mapping[str, str]) -> Figure:
    """Cost along each parameter with the others fitted again, beside that with the others held.

    Args:
        found: an `eclsim.identification.profiles.Profiles`.
        along: an `eclsim.identification.slices.Slices` through the same optimum.
        units: of the parameters.
    """
    count = len(found.names)
    across = min(count, 3)
    down = -(-count // across)
    with figure_style():
        fig = new_figure(height_mm=16 + 46 * down)
        for k, name in enumerate(found.names):
            axes = fig.add_subplot(down, across, k + 1)
            axes.plot(along.values[k], along.costs[k], color=GREY, label="others held")
            axes.plot(
                found.values[k], found.costs[k], "o-", color=OKABE_ITO["blue"], markersize=2.5,
                label="others fitted again",
            )  # fmt: skip
            axes.plot(
                found.optimum[k], found.cost, "o", color=OKABE_ITO["vermillion"], markersize=4,
                label="optimum", clip_on=False, zorder=5,
            )  # fmt: skip
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_xlim(found.values[k][0], found.values[k][-1])
            axes.set_xlabel(f"{name} [{units.get(name, '')}]")
            if k % across == 0:
                axes.set_ylabel("sum of squared residuals")
        handles, labels = fig.axes[0].get_legend_handles_labels()
        fig.legend(handles, labels, loc="outside upper center", ncols=3)
    return fig


def plot_residuals(
    outputs: Mapping[str, Mapping[str, float | None]], uncertainties: Mapping[str, float]
) -> Figure:
    """Differences of one fit from what was measured, in standard uncertainties.

    Args:
        outputs: "measured" and "simulated" of each output, as in the JSON file.
        uncertainties: standard uncertainty of each measurement, in its unit.
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
        axes.stem(range(len(shown)), list(shown.values()), linefmt="C0-", markerfmt="C0o", basefmt=" ")
        reach = max(1.5, 1.15 * max((abs(v) for v in shown.values()), default=0.0))
        axes.set_ylim(-reach, reach)
        axes.set_xticks(range(len(shown)), list(shown))
        axes.set_ylabel("(simulated - measured)\n/ standard uncertainty")
        axes.legend(loc="upper right")
    return fig


def plot_correlation(names: Sequence[str], matrix: np.ndarray) -> Figure:
    """Correlation of the estimates of the parameters.

    Args:
        names: of the parameters.
        matrix: shape (parameters, parameters).
    """
    with figure_style():
        fig = new_figure(height_mm=92)
        axes = fig.subplots()
        shown = axes.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
        axes.set_xticks(range(len(names)), names, rotation=45, ha="right")
        axes.set_yticks(range(len(names)), names)
        axes.tick_params(length=0)
        for row in range(len(names)):
            for column in range(len(names)):
                value = matrix[row, column]
                colour = "white" if abs(value) > 0.6 else "black"
                axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=6, color=colour)
        fig.colorbar(shown, ax=axes, label="correlation of the logarithms")
    return fig
