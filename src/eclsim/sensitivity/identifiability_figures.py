"""Figures of identifiability: scaled sensitivities, angles, collinearity by size, Fisher information."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eclsim.reporting.style import GREY, OKABE_ITO, figure_style, new_figure, save_figure


def write_identifiability_figures(
    found: Any, folder: Path, formats: Sequence[str] = ("svg", "png")
) -> list[Path]:
    """Write every figure of an `eclsim.sensitivity.case_identifiability.Identifiability` to a folder."""
    figures: dict[str, Callable[[], Figure]] = {
        "scaled_sensitivity": lambda: plot_scaled(found),
        "orthogonality": lambda: plot_orthogonality(found),
        "collinearity": lambda: plot_collinearity(found),
        "fisher_information": lambda: plot_fisher(found),
    }
    if not found.subsets:
        del figures["collinearity"]
    return [path for name, draw in figures.items() for path in save_figure(draw(), folder / name, formats)]


def plot_scaled(found: Any) -> Figure:
    """Change of each measurement, in standard uncertainties, for a change of a parameter by 10 %."""
    order = np.argsort(-found.scaled.effect, kind="stable")
    shown = 0.1 * found.scaled.matrix[:, order]
    with figure_style():
        fig = new_figure(height_mm=22 + 8.5 * len(found.scaled.outputs) + 12)
        axes = fig.add_subplot()
        top = float(np.abs(shown).max())
        image = axes.imshow(shown, cmap="PuOr", vmin=-top, vmax=top, aspect="auto")
        for (i, j), value in np.ndenumerate(shown):
            if abs(value) >= 0.05:
                text = f"{value:+.1f}"
                colour = "white" if abs(value) > 0.6 * top else "black"
                axes.text(j, i, text, ha="center", va="center", fontsize=6, color=colour)
        _ticks(axes, [found.scaled.parameters[k] for k in order], found.scaled.outputs)
        fig.colorbar(image, ax=axes, label="uncertainties per 10 %", fraction=0.05, pad=0.01)
    return fig


def plot_orthogonality(found: Any) -> Figure:
    """Sine of the angle between the effects of two parameters: 0, they cannot be told apart."""
    order = np.argsort(-found.scaled.effect, kind="stable")[:14]
    names = [found.scaled.parameters[k] for k in order]
    shown = found.scaled.orthogonality[np.ix_(order, order)]
    np.fill_diagonal(shown, np.nan)
    with figure_style():
        fig = new_figure(width_mm=130, height_mm=105)
        axes = fig.add_subplot()
        image = axes.imshow(shown, cmap="cividis", vmin=0.0, vmax=1.0)
        for (i, j), value in np.ndenumerate(shown):
            if np.isfinite(value):
                colour = "white" if value < 0.5 else "black"
                axes.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=6, color=colour)
        _ticks(axes, names, names)
        fig.colorbar(image, ax=axes, label="orthogonality: 1 unlike, 0 alike", fraction=0.05, pad=0.02)
    return fig


def plot_collinearity(found: Any) -> Figure:
    """Collinearity index against the size of the set: smallest, and 5, 50, 95 % of all sets."""
    sizes = np.array([s.size for s in found.subsets])
    smallest = [s.smallest for s in found.subsets]
    low, middle, high = (np.array([s.quantiles[k] for s in found.subsets]) for k in range(3))
    finite = [x for x in (*smallest, *low, *middle, *high) if np.isfinite(x)]
    ceiling = 3.0 * max([*finite, 20.0])
    with figure_style():
        fig = new_figure(width_mm=110, height_mm=85)
        axes = fig.add_subplot()
        axes.fill_between(
            sizes,
            low,
            np.minimum(high, ceiling),
            color=OKABE_ITO["sky blue"],
            alpha=0.4,
            lw=0,
            label="5 to 95 %",
        )
        axes.plot(sizes, middle, color=OKABE_ITO["blue"], label="median of all sets")
        axes.plot(sizes, smallest, "o-", color="black", markersize=3, label="best set")
        axes.axhspan(10.0, 15.0, color=GREY, alpha=0.25, lw=0, label="limit 10 to 15")
        chosen = len(found.proposal.chosen)
        if chosen > 1:
            axes.plot(
                chosen, found.proposal.collinearity, "D", color=OKABE_ITO["vermillion"], label="proposed set"
            )
        axes.set_yscale("log")
        axes.set_ylim(0.9, ceiling)
        axes.set_xticks(sizes)
        axes.set_xlabel("parameters in the set")
        axes.set_ylabel("collinearity index")
        fig.legend(loc="outside upper center", ncols=3)
    return fig


def plot_fisher(found: Any) -> Figure:
    """Eigenvectors of the Fisher information: combinations of parameters that the measurements determine."""
    count = min(len(found.scaled.outputs), len(found.scaled.parameters))
    order = np.argsort(-found.scaled.effect, kind="stable")[:12]
    names = [found.scaled.parameters[k] for k in order]
    vectors = found.fisher.eigenvectors[order, :count].T
    errors = 100.0 / np.sqrt(np.maximum(found.fisher.eigenvalues[:count], 1e-300))
    with figure_style():
        fig = new_figure(height_mm=24 + 8.5 * count)
        axes = fig.add_subplot()
        image = axes.imshow(vectors, cmap="PuOr", vmin=-1.0, vmax=1.0, aspect="auto")
        for (i, j), value in np.ndenumerate(vectors):
            if abs(value) >= 0.1:
                colour = "white" if abs(value) > 0.6 else "black"
                axes.text(j, i, f"{value:+.2f}", ha="center", va="center", fontsize=6, color=colour)
        labels = [
            f"{k + 1}: ±{e:.0f} %" if e <= 100.0 else f"{k + 1}: over 100 %" for k, e in enumerate(errors)
        ]
        _ticks(axes, names, labels)
        axes.set_ylabel("combination: standard error")
        fig.colorbar(image, ax=axes, label="share of the parameter", fraction=0.05, pad=0.01)
    return fig


def _ticks(axes: Any, across: Sequence[str], down: Sequence[str]) -> None:
    axes.set_xticks(range(len(across)), across, rotation=90 if len(across) > 12 else 0)
    axes.set_yticks(range(len(down)), down)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
