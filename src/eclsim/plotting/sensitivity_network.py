"""The network of pairs: which factors act together, from second-order indices."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eclsim.plotting.style import GREY, OKABE_ITO, figure_style, new_figure

MOST_FACTORS = 10
FAINTEST = 0.005


def plot_pairs(result: Any) -> Figure:
    """A circle for each factor (area: first order), a line for each pair (width: second order) per output.

    Pairs are drawn where the index exceeds its own 95 % half width and 0.005; the ten leading factors are
    shown.
    """
    leading = [result.factors.index(n) for n in list(result.sums)[:MOST_FACTORS]]
    leading.sort()
    angle = np.linspace(0.5 * np.pi, 2.5 * np.pi, len(leading), endpoint=False)
    place = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    with figure_style():
        columns = min(4, len(result.outputs) + 1)
        rows = -(-(len(result.outputs) + 1) // columns)
        fig = new_figure(height_mm=44 * rows)
        grid = fig.subplots(rows, columns, squeeze=False)
        for axes in grid.flat:
            axes.set_axis_off()
            axes.set_aspect("equal")
            axes.set(xlim=(-1.8, 1.8), ylim=(-1.45, 1.55))
        for k, output in enumerate(result.outputs):
            _draw(grid.flat[k], result, k, leading, place)
            grid.flat[k].set_title(output)
        _explain(grid.flat[len(result.outputs)])
    return fig


def _draw(axes: Any, result: Any, k: int, leading: list[int], place: np.ndarray) -> None:
    e = result.estimates
    for a, i in enumerate(leading):
        for b, j in enumerate(leading[a + 1 :], a + 1):
            index, width = e.S2[k, i, j], e.S2_conf[k, i, j]
            if index > max(width, FAINTEST):
                ends = place[[a, b]].T
                axes.plot(
                    *ends,
                    color=OKABE_ITO["vermillion"],
                    linewidth=_line(index),
                    solid_capstyle="round",
                    zorder=1,
                )
    for a, i in enumerate(leading):
        axes.scatter(*place[a], s=_area(e.S1[k, i]), color=OKABE_ITO["blue"], zorder=2)
        across = {-1: "right", 0: "center", 1: "left"}[int(np.sign(np.round(place[a, 0], 2)))]
        away = 1.12 + 0.012 * np.sqrt(_area(e.S1[k, i]))
        axes.text(*(away * place[a]), result.factors[i], ha=across, va="center", fontsize=6)


def _line(index: float) -> float:
    return 40.0 * index


def _area(index: float) -> float:
    return 4.0 + 260.0 * max(index, 0.0)


def _explain(axes: Any) -> None:
    for height, index in zip((1.2, 0.75, 0.4), (0.5, 0.1, 0.0), strict=True):
        axes.scatter(-1.3, height, s=_area(index), color=OKABE_ITO["blue"])
        axes.text(-0.8, height, f"$S_1$ = {index:g}", va="center", fontsize=7)
    for height, index in zip((-0.1, -0.4, -0.7), (0.1, 0.05, 0.01), strict=True):
        axes.plot((-1.6, -1.0), (height, height), color=OKABE_ITO["vermillion"], linewidth=_line(index))
        axes.text(-0.8, height, f"$S_2$ = {index:g}", va="center", fontsize=7)
    axes.text(-1.6, -1.5, "pairs beyond their\n95 % half width", va="bottom", fontsize=7, color=GREY)
