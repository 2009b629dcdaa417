"""Figures of fits, cohorts and posteriors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullFormatter

from eclsim.identification.quantities import (
    FLOWS,
    PRESSURES,
    Scale,
    axis_label,
    measured_and_simulated,
    unit_of,
)
from eclsim.reporting.numbers import number
from eclsim.reporting.style import (
    GREY,
    OKABE_ITO,
    curve_style,
    draw_matrix,
    figure_style,
    new_figure,
    panel_grid,
    plain_log_ticks,
    plain_text,
    short_name,
)

if TYPE_CHECKING:
    from eclsim.identification.multi_start import Starts
    from eclsim.identification.posterior import PosteriorResult
    from eclsim.identification.profiles import CostCurves

_MARKS = {
    "SP": ("o", "vermillion"), "DP": ("s", "blue"), "MAP": ("^", "black"), "MPAP": ("D", "bluish green"),
    "PCWP": ("v", "orange"), "CO": ("o", "vermillion"), "PF": ("s", "blue"),
}  # fmt: skip
NARROWEST_SHARE = 0.02
"""Smallest span of an axis of predictions, as a share of its values: rounding is not shown as a change."""
LONGEST_BESIDE_UNIT = 12
"""Largest number of letters of an output's name that has its unit behind it, not below."""
_DOT: dict[str, Any] = {"color": OKABE_ITO["vermillion"], "markersize": 4, "clip_on": False}


def _parameter_panels(curves: CostCurves, label: str, margin_mm: float) -> tuple[Figure, list[Axes]]:
    """Create a figure with one panel per parameter from bound to bound, each axis scaled as in the search."""
    fig, panels = panel_grid(len(curves.names), 3, 46, margin_mm)
    for axes, name, values in zip(panels, curves.names, curves.values, strict=True):
        scaled_axis(axes.xaxis, name)
        axes.set_xlim(values[0], values[-1])
        axes.set_xlabel(axis_label(name))
    for axes in panels[::3]:
        axes.set_ylabel(label)
    return fig, panels


def plot_slices(slices: CostCurves) -> Figure:
    """Cost along each parameter from bound to bound, the others at the optimum."""
    with figure_style():
        fig, panels = _parameter_panels(slices, "sum of squared residuals", 12)
        for k, axes in enumerate(panels):
            values, costs = slices.values[k], slices.costs[k]
            axes.plot(values, costs, color="black")
            axes.plot(slices.optimum[k], slices.cost, "o", **_DOT)
            _mark_missing(axes, values, costs, float(np.nanmin(costs)))
            axes.set_yscale("log")
        crosses = ", crosses: no steady heartbeat" if np.isnan(slices.costs).any() else ""
        fig.suptitle(f"Cost along each parameter (dot: optimum{crosses})")
    return fig


def plot_profiles(refitted: CostCurves, held: CostCurves, rise: float) -> Figure:
    """Chi-square along each parameter, with the others refitted and with the others held.

    Args:
        refitted: curves with the other parameters fitted again.
        held: curves through the same point with the other parameters held.
        rise: a value lies within the 90 % interval where the profile is at most this far above its minimum.
    """
    low = float(np.nanmin(refitted.costs))
    dot = "likeliest" if refitted.cost <= low + 0.05 * rise else "point that the curves go through"
    with figure_style():
        fig, panels = _parameter_panels(refitted, "chi-square", 16)
        for k, axes in enumerate(panels):
            axes.plot(held.values[k], held.costs[k], color=GREY, label="others held")
            axes.plot(
                refitted.values[k], refitted.costs[k], "o-", color=OKABE_ITO["blue"], markersize=2.5,
                label="others fitted again",
            )  # fmt: skip
            _mark_missing(axes, refitted.values[k], refitted.costs[k], low)
            dashed = (0, (4, 2))
            axes.axhline(low + rise, color="black", lw=0.8, ls=dashed, label="limit of the 90 % interval")
            axes.plot(refitted.optimum[k], refitted.cost, "o", label=dot, zorder=5, **_DOT)
            axes.set_ylim(low - 0.15 * rise, low + 4.0 * rise)
        if np.isnan(refitted.costs).any():
            fig.suptitle("crosses: no steady heartbeat")
        fig.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return fig


def _mark_missing(axes: Axes, values: np.ndarray, costs: np.ndarray, level: float) -> None:
    """Mark values without a steady heartbeat by crosses at a cost."""
    missing = values[~np.isfinite(costs)]
    if missing.size:
        axes.plot(missing, np.full(missing.size, level), "x", color=GREY, markersize=3, clip_on=False)


def plot_starts(starts: Starts, names: Sequence[str], lower: np.ndarray, upper: np.ndarray) -> Figure:
    """Cost of every start before and after refinement, and the position between the bounds where it ended.

    Args:
        starts: all starts that were refined.
        names: names of the parameters.
        lower: coordinates of the lower bounds.
        upper: coordinates of the upper bounds.
    """
    good, order = starts.agreeing, np.arange(1, len(starts.agreeing) + 1)
    place = (starts.end - lower) / (upper - lower)
    kinds = (
        (~good, OKABE_ITO["blue"], "s", "refined, another end", 0.6),
        (good, OKABE_ITO["vermillion"], "o", "refined, the optimum", 1.0),
    )
    with figure_style():
        fig = new_figure(height_mm=75)
        left, right = fig.subplots(1, 2, width_ratios=(1.15, 1.0))
        left.plot(
            order, starts.first_costs, "o", mfc="none", color=GREY, markersize=4, label="explored point"
        )
        for rows, colour, mark, label, width in kinds:
            if rows.any():
                costs = starts.last_costs[rows]
                left.plot(order[rows], costs, mark, color=colour, markersize=4, label=label)
                right.plot(range(len(names)), place[rows].T, color=colour, lw=width, alpha=0.7)
        left.set_yscale("log")
        left.xaxis.get_major_locator().set_params(integer=True)
        left.set_xlabel("start")
        left.set_ylabel("sum of squared residuals")
        left.legend(loc="best", frameon=True, framealpha=0.9)
        right.set_xticks(range(len(names)), list(map(short_name, names)), rotation=45, ha="right")
        right.set_yticks((0.0, 0.5, 1.0), ("lower\nbound", "middle", "upper\nbound"))
        right.set_ylim(-0.06, 1.06)
        right.set_ylabel("where it ended")
    return fig


def plot_residuals(
    outputs: Mapping[str, Mapping[str, float | None]],
    uncertainties: Mapping[str, float],
    edges: Mapping[str, float],
) -> Figure:
    """Differences between one fit and the measurements, in standard uncertainties.

    Args:
        outputs: "measured" and "simulated" of each output, as in the JSON file.
        uncertainties: standard uncertainty of each measurement, in its unit.
        edges: by level ("doubtful", "poor"), the difference beyond which a fit has this level, milder first.
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
        names = [name.replace("_", "\n") for name in shown]
        axes.set_xticks(range(len(shown)), names, size="small" if any("\n" in n for n in names) else None)
        axes.set_ylabel("(simulated - measured)\n/ standard uncertainty")
        fig.legend(loc="outside lower center", ncols=3)
    return fig


def plot_correlation(names: Sequence[str], matrix: np.ndarray) -> Figure:
    """Correlation matrix of the estimates of the parameters, shape (parameters, parameters)."""
    side = 10.0 * max(len(names), 4)
    with figure_style():
        fig = new_figure(width_mm=1.08 * side + 33.0, height_mm=side + 18.0)
        draw_matrix(
            fig, matrix, names, names, "RdBu_r", (-1.0, 1.0), lambda v: number(v, 2), lambda v: abs(v) > 0.6,
            label="correlation of the estimates", turned=45.0, aspect="equal", pad=0.03,
        )  # fmt: skip
    return fig


def plot_scatter(results: Sequence[Mapping[str, Any]], r2: Mapping[str, float | None]) -> Figure:
    """Simulated against measured values of a cohort (Figure 4 a and b).

    Args:
        results: data points as in the JSON file.
        r2: R2 of "pressures" and "flows".
    """
    kinds = ((PRESSURES, "pressures", "mmHg"), (FLOWS, "flows", "L/min"))
    with figure_style():
        fig = new_figure(height_mm=88)
        for ax, (names, key, unit) in zip(fig.subplots(1, 2), kinds, strict=True):
            shown = _shown(results, names)
            ends = [v for values in shown.values() for v in values.ravel()] or [0.0, 1.0]
            low, top = 1.05 * min(0.0, *ends), 1.05 * max(ends)
            ax.plot((low, top), (low, top), color=GREY, lw=0.8, zorder=0)
            for name, values in shown.items():
                mark, colour = _MARKS[name]
                ax.plot(
                    *values.T, mark, color=OKABE_ITO[colour], markersize=3.6, mfc="none", mew=0.9, label=name
                )
            ax.set(xlim=(low, top), ylim=(low, top), aspect="equal")
            ax.set_xlabel(f"measured [{unit}]")
            ax.set_ylabel(f"simulated [{unit}]")
            value = r2.get(key)
            ax.set_title(f"{key}: R² = {value:.3f}" if value is not None else key)
            if shown:
                ax.legend(loc="upper left", handletextpad=0.2)
        _count_poor_fits(fig, results)
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
            if not any((values < 0.0).any() for values in shown.values()):
                ax.set_ylim(bottom=0.0)
            if shown and names is PRESSURES:
                ax.legend(loc="upper right")
        _count_poor_fits(fig, results)
    return fig


def _count_poor_fits(fig: Figure, results: Sequence[Mapping[str, Any]]) -> None:
    """Say above a figure how many of its fits are poor."""
    poor = sum(result.get("verdict", {}).get("level") == "poor" for result in results)
    if poor:
        fig.suptitle(f"{poor} of {len(results)} fits {'are' if poor > 1 else 'is'} poor, and included")


def _shown(results: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, np.ndarray]:
    """Measured and simulated values of each output that has at least one pair."""
    each = {name: measured_and_simulated(results, [name]) for name in names}
    return {name: values for name, values in each.items() if len(values)}


# --- posteriors -------------------------------------------------------------------------------------


SHOWN_DRAWS = 1500
"""Largest number of draws plotted."""
BINS = 28
LONGEST_LABEL = 24


def plot_traces(result: PosteriorResult) -> Figure:
    """Draws of every parameter in order, chain by chain, and the distribution of each chain."""
    names, draws = result.names, result.samples
    with figure_style():
        fig = new_figure(height_mm=16 + 30 * len(names))
        fig.suptitle(_title(result, "draws of each chain, and their distributions"))
        for k, name in enumerate(names):
            left = fig.add_subplot(len(names), 2, 2 * k + 1)
            right = fig.add_subplot(len(names), 2, 2 * k + 2)
            edges = _edges(name, draws[:, :, k])
            for chain, values in enumerate(draws[:, :, k]):
                style = curve_style(chain)
                left.plot(values, color=style["color"], linewidth=0.35)
                share = np.histogram(values, edges)[0] / len(values)
                right.stairs(share, edges, color=style["color"], linestyle=style["linestyle"], linewidth=0.9)
            left.set_ylabel(_axis(name))
            right.set_yticks([])
            for axis in (left.yaxis, right.xaxis):
                scaled_axis(axis, name)
            if (d := result.diagnostics) is not None:
                effective = min(d.effective_bulk[k], d.effective_tail[k])
                mixing = f"R-hat {d.r_hat[k]:.3f}, {effective:.0f} effective draws"
                right.set_title(mixing, loc="right", fontsize=7, fontweight="normal")
            if k == len(names) - 1:
                left.set_xlabel("draw")
            else:
                left.set_xticklabels([])
    return fig


def plot_pairs(result: PosteriorResult) -> Figure:
    """Draws of every pair of parameters, with the 90 % ellipse of the Gaussian approximation."""
    names = result.names
    size = len(names)
    flat = result.flat[:: max(1, len(result.flat) // SHOWN_DRAWS)]
    gaussian = result.gaussian_draws(4000)
    with figure_style():
        fig = new_figure(height_mm=175)
        drawn = "draws (points); Gaussian approximation, 90 % (line)"
        drawn = drawn if result.checked else "draws (points) and 90 % (line)"
        fig.suptitle(_title(result, f"{result.kind}, {drawn}"))
        axes = fig.subplots(size, size, squeeze=False)
        for i in range(size):
            for j in range(size):
                ax = axes[i, j]
                if j > i:
                    ax.set_visible(False)
                elif i == j:
                    _histogram(ax, names[i], flat[:, i], gaussian[:, i] if result.checked else None)
                else:
                    ax.plot(flat[:, j], flat[:, i], ".", color=OKABE_ITO["blue"], markersize=1.2, alpha=0.5,
                            rasterized=True)  # fmt: skip
                    _ellipse(ax, result, j, i)
                _outer_labels(ax, names, i, j, size)
    return fig


def plot_predictive(result: PosteriorResult) -> Figure:
    """Predictions of every output at all settings, beside the measurements."""
    outputs = list(dict.fromkeys(n for p in result.predictions for n in p.outputs))
    labels = [
        plain_text(p.settings or "as measured", 40).replace("=", "=\n").replace(",", ",\n")
        + "\nNOT TO BE TRUSTED" * bool(p.doubts)
        for p in result.predictions
    ]
    rows, across = len(labels), 4
    with figure_style():
        fig, panels = panel_grid(len(outputs), across, 24 + 7 * rows, 22)
        fig.suptitle(_title(result, "90 % intervals of the model's outputs"))
        for k, (ax, name) in enumerate(zip(panels, outputs, strict=True)):
            _intervals(ax, result, name)
            ax.set_yticks(range(rows), [] if k % across else labels, fontsize=6)
            ax.set_ylim(rows - 0.4, -0.6)
            long = len(name) > LONGEST_BESIDE_UNIT  # it would run into the name of the next panel
            label = f"{name}\n[{unit_of(name)}]" if long else f"{name} [{unit_of(name)}]"
            ax.set_xlabel(label, fontsize=6.5 if long else None)
        legend = panels[0].get_legend_handles_labels()
        fig.legend(*legend, loc="outside lower center", ncols=3, columnspacing=1.4, fontsize=7)
    return fig


def _intervals(ax: Axes, result: PosteriorResult, name: str) -> None:
    name_of_gaussian = "Gaussian approximation, unchecked" + ("" if result.checked else ": median and 90 %")
    of_gaussian = (result.gaussian_predictions, 0.12, "vermillion", "s", name_of_gaussian)
    styles = [(result.predictions, -0.12, "blue", "o", f"{result.kind}: median and 90 %"), of_gaussian]
    for predictions, shift, colour, marker, label in styles if result.checked else [of_gaussian]:
        for row, p in enumerate(predictions):
            if name not in p.outputs:
                continue
            low, middle, high = p.intervals[p.outputs.index(name)]
            ax.plot([low, high], [row + shift] * 2, color=OKABE_ITO[colour], linewidth=1.6)
            dot = {"color": OKABE_ITO[colour], "markersize": 3.5}
            ax.plot(middle, row + shift, marker, label="" if row else label, **dot)
    if name in result.density.outputs:
        value, error = result.density.measured[name], result.density.errors[name]
        ax.errorbar(value, 0.36, xerr=1.645 * error, fmt="D", color=GREY, markersize=3, linewidth=0.9,
                    capsize=2, label="measured and its 90 %")  # fmt: skip
    low, high = ax.get_xlim()
    if (short := NARROWEST_SHARE * max(abs(low), abs(high)) - (high - low)) > 0.0:
        ax.set_xlim(low - 0.5 * short, high + 0.5 * short)


def _edges(name: str, values: np.ndarray) -> np.ndarray:
    """Bin edges of a histogram, equally spaced in the coordinate of a parameter."""
    between = np.linspace if Scale.of([name]).linear[0] else np.geomspace
    return between(values.min(), values.max(), BINS + 1)


def scaled_axis(axis: Axis, name: str, gap: float = 0.2, *, shown: bool = True) -> None:
    """Set the axis of a parameter: logarithmic, or linear for a parameter with a linear coordinate."""
    if not Scale.of([name]).linear[0]:
        (axis.axes.set_xscale if axis is axis.axes.xaxis else axis.axes.set_yscale)("log")
        plain_log_ticks(axis, gap, shown=shown)
        return
    axis.set_major_locator(MaxNLocator(3))
    if not shown:
        axis.set_major_formatter(NullFormatter())


def _histogram(ax: Axes, name: str, values: np.ndarray, gaussian: np.ndarray | None) -> None:
    """Plot the shares of draws as bars and those of the Gaussian approximation as a line."""
    histograms = [(values, "blue", True)] + ([] if gaussian is None else [(gaussian, "vermillion", False)])
    pooled = np.concatenate([drawn for drawn, _, _ in histograms])
    edges = _edges(name, pooled)
    for drawn, colour, fill in histograms:
        share = np.histogram(drawn, edges)[0] / len(drawn)
        ax.stairs(share, edges, color=OKABE_ITO[colour], fill=fill, alpha=0.5 if fill else 1.0, linewidth=0.9)
    ax.set_yticks([])


def _ellipse(ax: Axes, result: PosteriorResult, j: int, i: int) -> None:
    """Plot the 90 % ellipse of two latent variables, converted to parameters."""
    gaussian, prior = result.gaussian, result.density.prior
    root = np.linalg.cholesky(gaussian.covariance[np.ix_([j, i], [j, i])])
    angle = np.linspace(0.0, 2.0 * np.pi, 90)
    circle = np.sqrt(4.605) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    z = np.tile(gaussian.centre, (len(angle), 1))
    z[:, [j, i]] += circle @ root.T
    drawn = prior.values_of(z)
    ax.plot(drawn[:, j], drawn[:, i], color=OKABE_ITO["vermillion"], linewidth=0.9)


def _outer_labels(ax: Axes, names: Sequence[str], i: int, j: int, size: int) -> None:
    """Label the outer axes with names and reduce the tick labels of all axes."""
    for axis, shown in ((ax.xaxis, i == size - 1), (ax.yaxis, j == 0 and i > 0)):
        if axis is ax.yaxis and i == j:
            continue
        scaled_axis(axis, names[j if axis is ax.xaxis else i], 0.3, shown=shown)
    ax.tick_params(axis="x", labelrotation=60)
    ax.tick_params(labelsize=6)
    if i == size - 1:
        ax.set_xlabel(_axis(names[j]), fontsize=6.5)
    if j == 0 and i > 0:
        ax.set_ylabel(_axis(names[i]), fontsize=6.5)


def _axis(name: str) -> str:
    return with_line_break(axis_label(name).replace(" [", "\n["))


def with_line_break(label: str) -> str:
    """Break a long label after the name of its section."""
    section, dot, key = label.rpartition(".")
    return f"{section}.\n{key}" if dot and len(label) > LONGEST_LABEL and "\n" not in section else label


def _title(result: PosteriorResult, what: str) -> str:
    first = plain_text(result.name) + (f": {result.verdict}" if result.verdict else "")
    return f"{first}\n{what}"
