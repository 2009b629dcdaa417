"""Heat maps of Sobol indices: outputs in rows, factors in columns.

Two layouts: columns by their sums, and that of the paper (Figures 3, 7, S-3, S-7): columns in the order of
the design, resistances, compliances, inertances, elastances, and colours from 0 to 1.
"""

from collections.abc import Sequence
from itertools import groupby
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from eclsim.parameters import all_parameters
from eclsim.reporting.style import GREY, figure_style, new_figure

HEAT = "Blues"
FEW_FACTORS = 12
LABELS = {"ST": "total order $S_T$", "S1": "first order $S_1$", "ST-S1": "interactions $S_T - S_1$"}
KINDS = {
    "resistance": "resistances", "compliance": "compliances", "inertance": "inertances",
    "elastance": "elastances",
}  # fmt: skip
Layout = Literal["sums", "paper"]


def plot_heat_map(result: Any, index: str = "ST", layout: Layout = "sums") -> Figure:
    """Indices of every output (rows) and factor (columns); numbers from 0.01 up.

    Args:
        result: `eclsim.sensitivity.indices.Indices`.
        index: "ST", "S1" or "ST-S1".
        layout: "sums", largest first, or "paper".
    """
    e = result.estimates
    numbers = {"ST": e.ST, "S1": e.S1, "ST-S1": e.ST - e.S1}[index]
    order = range(len(result.factors)) if layout == "paper" else by_sum(result)
    shown = np.clip(numbers[:, list(order)], 0.0, None)
    names = [result.factors[k] for k in order]
    top = 1.0 if layout == "paper" else max(float(shown.max()), 0.05)
    with figure_style():
        fig = new_figure(height_mm=22 + 8.5 * len(result.outputs) + 12)
        axes = fig.add_subplot()
        image = axes.imshow(shown, cmap=HEAT, vmin=0.0, vmax=top, aspect="auto")
        for (i, j), value in np.ndenumerate(shown):
            if value >= 0.01:
                colour = "white" if value > 0.5 * top else "black"
                text = f"{value:.2f}".removeprefix("0")
                axes.text(j, i, text, ha="center", va="center", color=colour, fontsize=6)
        axes.set_xticks(range(len(names)), names, rotation=90 if len(names) > FEW_FACTORS else 0)
        axes.set_yticks(range(len(result.outputs)), result.outputs)
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        if layout == "paper":
            _mark_kinds(axes, names)
        fig.colorbar(image, ax=axes, label=LABELS[index], fraction=0.05, pad=0.01, shrink=0.9)
    return fig


def by_sum(result: Any) -> list[int]:
    """Positions of the factors, the largest sum of total orders first."""
    return [result.factors.index(name) for name in result.sums]


def in_kinds(names: Sequence[str]) -> bool:
    """Whether neighbouring parameters share their kind, so that the paper's layout groups them."""
    kinds = [key for key, _ in groupby(names, key=_kind)]
    return len(names) > FEW_FACTORS and len(kinds) == len(set(kinds)) > 1


def _kind(name: str) -> str:
    parameter = all_parameters().get(name)
    return KINDS.get(parameter.quantity or "", "others") if parameter else "others"


def _mark_kinds(axes: Any, names: Sequence[str]) -> None:
    """Kinds above the columns, with lines between them."""
    if not in_kinds(names):
        return
    first = 0
    for kind, members in groupby(names, key=_kind):
        count = len(list(members))
        axes.text(first + 0.5 * count - 0.5, -0.62, kind, ha="center", va="bottom", color=GREY, fontsize=7)
        if first:
            axes.axvline(first - 0.5, color=GREY, linewidth=0.8)
        first += count
