"""Figure of the CRRT study of a cohort: the place of every scheme in every data point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eclsim.reporting.style import GREY, OKABE_ITO, PAGE_WIDTH_MM, figure_style, new_figure, plain_text

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
        ranks: place of each scheme (columns) in each data point (rows), 1 is best; NaN where not known.
        letters: of the schemes.
        names: of the data points.
        flows: ECMO flow of each data point [L/min]; NaN where not known, sorted last.
        limits: flow up to which each scheme keeps all limits of its lines [L/min], shape of the ranks; 0 if
            at no speed, NaN where not known.
    """
    order = np.argsort(flows, kind="stable").tolist()
    height = max(34 + min(4.2 * len(names), 190.0), 85.0)
    fig = new_figure(PAGE_WIDTH_MM, height)
    left, right = fig.subplots(1, 2, width_ratios=(1.25, 1.0))
    _draw_places(left, ranks[order], letters, [_row_name(str(names[k]), float(flows[k])) for k in order])
    _draw_flows(right, limits, letters, flows)
    return fig


def _row_name(name: str, flow: float) -> str:
    return f"{plain_text(name, 18)}  {f'{flow:.1f}' if np.isfinite(flow) else '–'}"


def _draw_places(ax: Axes, ranks: np.ndarray, letters: Sequence[str], labels: Sequence[str]) -> None:
    image = ax.imshow(ranks, cmap="Blues_r", aspect="auto", vmin=1, vmax=max(len(letters), 2) + 2)
    image.set_rasterized(True)
    if len(labels) <= MOST_NAMED:
        for (row, column), place in np.ndenumerate(ranks):
            colour = "white" if place <= 0.4 * len(letters) else "black"
            weight = "bold" if place == 1 else "normal"
            look = {"ha": "center", "va": "center", "fontsize": 6, "color": colour, "fontweight": weight}
            ax.text(column, row, f"{place:.0f}" if np.isfinite(place) else "–", fontdict=look)
        ax.set_yticks(range(len(labels)), labels, fontsize=6.5)
    ax.set_xticks(range(len(letters)), [plain_text(letter, 12) for letter in letters])
    ax.tick_params(length=0)
    ax.set_xlabel("Scheme")
    ax.set_ylabel("Data point and its ECMO flow [L/min]")
    doubt = " (–: not known)" if np.isnan(ranks).any() else ""
    ax.set_title(f"a) Place of each scheme{doubt}", loc="left")


def _draw_flows(ax: Axes, limits: np.ndarray, letters: Sequence[str], flows: Sequence[float]) -> None:
    columns = np.arange(len(letters))
    ax.plot(columns, limits.T, "o", color=OKABE_ITO["blue"], markersize=3, alpha=0.45, markeredgewidth=0.0)
    known = [(k, column[np.isfinite(column)]) for k, column in enumerate(limits.T)]
    middle = [(k, np.median(values)) for k, values in known if len(values)]
    ax.plot(*np.array(middle).reshape(-1, 2).T, "_", color="black", markersize=13, markeredgewidth=1.6)
    shown = [flow for flow in flows if np.isfinite(flow)]
    if shown:
        ax.axhspan(min(shown), max(shown), color=GREY, alpha=0.15, linewidth=0)
        ax.annotate(
            "flows of the data points", (0.985, min(shown)), xycoords=("axes fraction", "data"), ha="right",
            va="bottom", xytext=(0, 2), textcoords="offset points", fontsize=7, color=GREY,
        )  # fmt: skip
    missing = int(np.isnan(limits).sum())
    if missing:
        ax.annotate(
            f"not known, not shown: {missing} of {limits.size}", (0.985, 0.985), xycoords="axes fraction",
            ha="right", va="top", fontsize=7,
        )  # fmt: skip
    ax.set_xticks(columns, [plain_text(letter, 12) for letter in letters])
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("Scheme")
    ax.set_ylabel("Limits of the lines kept up to [L/min]")
    ax.set_title("b) ECMO flow kept (dash: median)", loc="left")
