"""Figure of the CRRT study of a cohort: the place of every scheme in every data point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eclsim.plotting.style import GREY, OKABE_ITO, PAGE_WIDTH_MM, figure_style, new_figure, plain_text

if TYPE_CHECKING:
    from collections.abc import Sequence

MOST_NAMED = 60


@figure_style()
def plot_cohort_ranks(
    ranks: np.ndarray,
    letters: Sequence[str],
    names: Sequence[str],
    flows: Sequence[float],
    limits: np.ndarray,
) -> Figure:
    """Places of the schemes by data point, sorted by ECMO flow; beside it the flow that each scheme keeps.

    Args:
        ranks: place of each scheme (columns) in each data point (rows), 1 is best.
        letters: of the schemes.
        names: of the data points.
        flows: ECMO flow of each data point [L/min].
        limits: flow up to which each scheme keeps all limits of its lines [L/min], shape of the ranks.
    """
    order = np.argsort(flows, kind="stable")
    height = max(34 + min(4.2 * len(names), 190.0), 85.0)
    fig = new_figure(PAGE_WIDTH_MM, height)
    left, right = fig.subplots(1, 2, width_ratios=(1.25, 1.0))
    _draw_places(left, ranks[order], letters, [f"{plain_text(names[k], 18)}  {flows[k]:.1f}" for k in order])
    _draw_flows(right, limits, letters, flows)
    return fig


def _draw_places(ax: Axes, ranks: np.ndarray, letters: Sequence[str], labels: Sequence[str]) -> None:
    image = ax.imshow(ranks, cmap="Blues_r", aspect="auto", vmin=1, vmax=max(len(letters), 2) + 2)
    image.set_rasterized(True)
    if len(labels) <= MOST_NAMED:
        for (row, column), place in np.ndenumerate(ranks):
            colour = "white" if place <= 0.4 * len(letters) else "black"
            weight = "bold" if place == 1 else "normal"
            look = {"ha": "center", "va": "center", "fontsize": 6, "color": colour, "fontweight": weight}
            ax.text(column, row, str(place), fontdict=look)
        ax.set_yticks(range(len(labels)), labels, fontsize=6.5)
    ax.set_xticks(range(len(letters)), [plain_text(letter, 12) for letter in letters])
    ax.tick_params(length=0)
    ax.set_xlabel("Scheme")
    ax.set_ylabel("Data point and its ECMO flow [L/min]")
    ax.set_title("a) Place of each scheme", loc="left")


def _draw_flows(ax: Axes, limits: np.ndarray, letters: Sequence[str], flows: Sequence[float]) -> None:
    columns = np.arange(len(letters))
    ax.plot(columns, limits.T, "o", color=OKABE_ITO["blue"], markersize=3, alpha=0.45, markeredgewidth=0.0)
    ax.plot(columns, np.median(limits, axis=0), "_", color="black", markersize=13, markeredgewidth=1.6)
    ax.axhspan(min(flows), max(flows), color=GREY, alpha=0.15, linewidth=0)
    ax.annotate(
        "flows of the data points", (0.985, min(flows)), xycoords=("axes fraction", "data"), ha="right",
        va="bottom", xytext=(0, 2), textcoords="offset points", fontsize=7, color=GREY,
    )  # fmt: skip
    ax.set_xticks(columns, [plain_text(letter, 12) for letter in letters])
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("Scheme")
    ax.set_ylabel("Limits of the lines kept up to [L/min]")
    ax.set_title("b) ECMO flow kept (dash: median)", loc="left")
