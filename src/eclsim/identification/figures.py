"""Figures of fits, cohorts, posteriors and followed patients."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator, NullFormatter

from eclsim.identification.quantities import (
    FLOWS,
    PRESSURES,
    Scale,
    axis_label,
    measured_and_simulated,
    unit_of,
)
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

Series = Mapping[str, Any]
"""A followed patient as in the JSON file."""
_MARKS = {
    "SP": ("o", "vermillion"), "DP": ("s", "blue"), "MAP": ("^", "black"), "MPAP": ("D", "bluish green"),
    "PCWP": ("v", "orange"), "CO": ("o", "vermillion"), "PF": ("s", "blue"),
}  # fmt: skip
LONGEST_BESIDE_UNIT = 12
"""Largest number of letters of an output's name that has its unit behind it, not below."""
_DOT: dict[str, Any] = {"color": OKABE_ITO["vermillion"], "markersize": 4, "clip_on": False}


def _parameter_panels(curves: CostCurves, label: str, margin_mm: float) -> tuple[Figure, list[Axes]]:
    """Create a figure with one panel per parameter from bound to bound, each axis scaled as in the search."""
    fig, panels = panel_grid(len(curves.names), 3, 46, margin_mm)
    for axes, name, values in zip(panels, curves.names, curves.values, strict=True):
        _scaled(axes.xaxis, name)
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
            if (missing := ~np.isfinite(costs)).any():
                level = np.full(missing.sum(), np.nanmin(costs))
                axes.plot(values[missing], level, "x", color=GREY, markersize=3, clip_on=False)
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
    with figure_style():
        fig, panels = _parameter_panels(refitted, "chi-square", 16)
        for k, axes in enumerate(panels):
            axes.plot(held.values[k], held.costs[k], color=GREY, label="others held")
            axes.plot(
                refitted.values[k], refitted.costs[k], "o-", color=OKABE_ITO["blue"], markersize=2.5,
                label="others fitted again",
            )  # fmt: skip
            dashed = (0, (4, 2))
            axes.axhline(low + rise, color="black", lw=0.8, ls=dashed, label="limit of the 90 % interval")
            axes.plot(refitted.optimum[k], refitted.cost, "o", label="likeliest", zorder=5, **_DOT)
            axes.set_ylim(low - 0.15 * rise, low + 4.0 * rise)
        fig.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return fig


def plot_starts(starts: Starts, names: Sequence[str], lower: np.ndarray, upper: np.ndarray) -> Figure:
    """Cost of every start before and after refinement, and the position between the bounds where it ended.

    Args:
        starts: all starts that were refined.
        names: names of the parameters.
        lower: coordinates of the lower bounds.
        upper: coordinates of the upper bounds.
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
            fig, matrix, names, names, "RdBu_r", (-1.0, 1.0), lambda v: f"{v:.2f}", lambda v: abs(v) > 0.6,
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
_ACROSS = 2
MOST_NAMES = 8
LONGEST_NAME = 6
"""With longer names (characters), the axis shows the number of the measurement."""
LONGEST_LABEL = 24
HOURS_PER_DAY = 24.0
HOURS_SHOWN_AS_DAYS = 72.0
"""Courses longer than this [h] have an axis in days."""


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
                _scaled(axis, name)
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


def _edges(name: str, values: np.ndarray) -> np.ndarray:
    """Bin edges of a histogram, equally spaced in the coordinate of a parameter."""
    between = np.linspace if Scale.of([name]).linear[0] else np.geomspace
    return between(values.min(), values.max(), BINS + 1)


def _scaled(axis: Axis, name: str, gap: float = 0.2, *, shown: bool = True) -> None:
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
        _scaled(axis, names[j if axis is ax.xaxis else i], 0.3, shown=shown)
    ax.tick_params(axis="x", labelrotation=60)
    ax.tick_params(labelsize=6)
    if i == size - 1:
        ax.set_xlabel(_axis(names[j]), fontsize=6.5)
    if j == 0 and i > 0:
        ax.set_ylabel(_axis(names[i]), fontsize=6.5)


def _axis(name: str) -> str:
    return _with_line_break(axis_label(name).replace(" [", "\n["))


def _with_line_break(label: str) -> str:
    """Break a long label after the name of its section."""
    section, dot, key = label.rpartition(".")
    return f"{section}.\n{key}" if dot and len(label) > LONGEST_LABEL and "\n" not in section else label


def _in_lines(label: str) -> str:
    """Break a long label at the underscore nearest to its middle, so that it is no longer than its panel."""
    breaks = [k + 1 for k, sign in enumerate(label) if sign == "_"]
    if len(label) < LONGEST_LABEL or not breaks:
        return label
    middle = min(breaks, key=lambda k: abs(2 * k - len(label)))
    return f"{label[:middle]}\n{label[middle:]}"


def _title(result: PosteriorResult, what: str) -> str:
    first = plain_text(result.name) + (f": {result.verdict}" if result.verdict else "")
    return f"{first}\n{what}"


# --- following a patient ----------------------------------------------------------------------------


@dataclass(frozen=True)
class TimeAxis:
    """Positions of the measurements on the time axis.

    Args:
        at: position of each measurement.
        label: label of the axis.
        names: names of the measurements where the axis counts measurements; empty where it shows time.
    """

    at: np.ndarray
    label: str
    names: tuple[str, ...] = ()

    @classmethod
    def of(cls, series: Series) -> TimeAxis:
        """Axis in hours or days where the times are known, else one unit per measurement."""
        points = series["points"]
        if series.get("assumed_interval_hours") is not None or len(points) < 2:
            names = tuple(plain_text(p["id"]) for p in points)
            at = np.arange(1.0, len(points) + 1.0)
            if max(map(len, names)) <= LONGEST_NAME:
                return cls(at, "measurement", names)
            return cls(at, "number of the measurement")
        hours = np.cumsum([p["hours_since_last"] or 0.0 for p in points])
        if hours[-1] > HOURS_SHOWN_AS_DAYS:
            return cls(hours / HOURS_PER_DAY, "days since the first measurement")
        return cls(hours, "hours since the first measurement")

    @property
    def step(self) -> float:
        """Width that a marker may take on the axis without touching its neighbour."""
        return (float(np.ptp(self.at)) or 2.0) / 60.0

    def draw(self, ax: Axes, last_row: bool) -> None:
        """Set limits, ticks and, on the last row, the label."""
        margin = 3.0 * self.step if np.ptp(self.at) else 1.0
        ax.set_xlim(self.at.min() - margin, self.at.max() + margin)
        if self.names:
            stride = -(-len(self.names) // MOST_NAMES)
            chosen = range(0, len(self.names), stride)
            ax.xaxis.set_major_locator(FixedLocator([self.at[k] for k in chosen]))
            ax.set_xticklabels([self.names[k] for k in chosen])
        else:
            ax.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        if last_row:
            ax.set_xlabel(self.label, color=GREY)


def plot_parameters(series: Series) -> Figure:
    """Every parameter after each measurement: median and 90 % interval."""

    def draw(ax: Axes, time: TimeAxis, name: str) -> None:
        _band(ax, time, _values_of_points(series, "parameters", name), "blue", "after the measurement")
        _scaled(ax.yaxis, name)
        ax.set_ylabel(_with_line_break(axis_label(name)))

    return _panels_over_time(series, "parameters", "parameters: median and 90 % after each measurement", draw)


def plot_outputs(series: Series) -> Figure:
    """Every output: forecast, measurement, and model output after the update."""

    def draw(ax: Axes, time: TimeAxis, name: str) -> None:
        expected, outputs = (_values_of_points(series, key, name) for key in ("expected", "outputs"))
        _band(ax, time, expected, "sky blue", "90 % of measurements expected")
        _band(ax, time, outputs, "blue", "model afterwards, 90 %")
        _doubted(ax, time, outputs, [name in p.get("doubtful", ()) for p in series["points"]])
        _measured(ax, time, _values_of_points(series, "measurements", name))
        ax.yaxis.set_major_locator(MaxNLocator(4))
        doubtful = any(name in p.get("doubtful", ()) for p in series["points"])
        ax.set_ylabel(_in_lines(f"{name} [{unit_of(name)}]") + "\ndoubtful" * doubtful)

    fig = _panels_over_time(series, "outputs", "outputs: expected beforehand, measured, and afterwards", draw)
    entries = [zip(*ax.get_legend_handles_labels(), strict=True) for ax in fig.axes]
    legend = {label: handle for pairs in reversed(entries) for handle, label in pairs}
    order = dict.fromkeys(label for ax in fig.axes for label in ax.get_legend_handles_labels()[1])
    with figure_style():
        fig.legend([legend[label] for label in order], list(order), loc="outside lower center", ncols=2)
    return fig


def _values_of_points(series: Series, key: str, name: str) -> list[Any]:
    return [point[key].get(name) for point in series["points"]]


def _panels_over_time(
    series: Series, key: str, title: str, draw: Callable[[Axes, TimeAxis, str], None]
) -> Figure:
    """Create one panel over time for each name that the points have under a key."""
    names, time = list(dict.fromkeys(n for p in series["points"] for n in p[key])), TimeAxis.of(series)
    with figure_style():
        fig, panels = panel_grid(len(names), _ACROSS, 36, 30)
        fig.suptitle(f"{plain_text(series['id'])}\n{title}")
        for k, (ax, name) in enumerate(zip(panels, names, strict=True)):
            draw(ax, time, name)
            time.draw(ax, k >= len(names) - _ACROSS)
    return fig


def _band(
    ax: Axes, time: TimeAxis, intervals: Sequence[Mapping[str, float] | None], colour: str, label: str
) -> None:
    rows = [[np.nan] * 3 if i is None else [i["lower"], i["median"], i["upper"]] for i in intervals]
    low, middle, high = np.array(rows, dtype=float).T
    single = colour == "sky blue"
    width = 5.5 if single else 1.6
    alpha = 0.55 if single else 1.0
    ax.vlines(time.at, low, high, color=OKABE_ITO[colour], linewidth=width, alpha=alpha, label=label)
    if not single:
        ax.plot(time.at, middle, "-o", color=OKABE_ITO[colour], linewidth=0.8, markersize=3)


def _doubted(
    ax: Axes, time: TimeAxis, outputs: Sequence[Mapping[str, float] | None], doubtful: Sequence[bool]
) -> None:
    """Draw medians in doubt as open circles."""
    chosen = {k: i["median"] for k, i in enumerate(outputs) if i is not None and doubtful[k]}
    if chosen:
        ax.plot(time.at[list(chosen)], list(chosen.values()), "o", color=OKABE_ITO["vermillion"],
                markerfacecolor="white", markersize=4.5, linestyle="", zorder=5,
                label="model afterwards, doubtful")  # fmt: skip


def _measured(ax: Axes, time: TimeAxis, measurements: Sequence[Mapping[str, Any] | None]) -> None:
    for usual, colour, marker, label in (
        (True, "black", "D", "measured"),
        (False, "vermillion", "X", "measured, does not fit"),
    ):
        chosen = {
            k: h["measured"] for k, h in enumerate(measurements) if h is not None and h["unusual"] != usual
        }
        at, values = list(chosen), list(chosen.values())
        if at:
            ax.plot(time.at[at] + time.step, values, marker, color=OKABE_ITO[colour], linestyle="",
                    markersize=3.2 if usual else 5.5, label=label)  # fmt: skip
