"""Figures of the CRRT study: beats of all schemes, range of ECMO flows, limits, effect of blood uptake.

The style follows Figures 5 and 6 of Thiel et al. 2025.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

from eclsim.crrt_study.limits import LIMITS, Limit, any_bounded
from eclsim.reporting.beat_values import two_beats
from eclsim.reporting.numbers import number
from eclsim.reporting.style import GREY, OKABE_ITO, PAGE_WIDTH_MM, figure_style, new_figure, plain_text

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.crrt_study.schemes import Scheme

Ends = Mapping[str, tuple[float, float]]
"""Right end of each scheme's curve."""
_CASE_FLOW: dict[str, Any] = {"color": "black", "linewidth": 0.8, "linestyle": (0, (6, 1.5, 1, 1.5))}
"""Look of the line at the ECMO flow of the case."""
VESSELS = (("Psart", "systemic artery"), ("Ppart", "pulmonary artery"), ("Psvn", "systemic vein"))


class Extremes(NamedTuple):
    """Letters of the schemes with the highest and the lowest arterial pressure; empty if none is known."""

    highest: str
    lowest: str

    @classmethod
    def of(cls, means: xr.Dataset) -> Extremes:
        """Return the extremes of means over `scheme`."""
        pressure, letters = means["Psart"].values, means["scheme"].values.astype(str)
        if not np.isfinite(pressure).any():
            return cls("", "")
        return cls(str(letters[np.nanargmax(pressure)]), str(letters[np.nanargmin(pressure)]))

    def style(self, letter: str) -> dict[str, Any]:
        """Line style of a scheme; those with the highest and lowest arterial pressure are highlighted."""
        if letter and letter == self.highest:
            return {"color": HIGHEST_COLOUR, "linewidth": 1.7, "linestyle": (0, (6, 1.2)), "zorder": 4}
        if letter and letter == self.lowest:
            return {"color": LOWEST_COLOUR, "linewidth": 1.7, "linestyle": "-", "zorder": 4}
        return {"color": OTHERS_COLOUR, "linewidth": 0.9, "linestyle": "-", "zorder": 3}

    def colour(self, letters: Sequence[str]) -> str:
        """Colour of a label for one or more schemes."""
        if self.highest in letters and self.lowest not in letters:
            return HIGHEST_COLOUR
        if self.lowest in letters and self.highest not in letters:
            return LOWEST_COLOUR
        return "black" if len(letters) > 1 else GREY


def schemes_without_beat(means: xr.Dataset) -> list[str]:
    """Letters of the schemes whose beat was not found."""
    return means["scheme"].values.astype(str)[~np.isfinite(means["Psart"].values)].tolist()


@figure_style()
def plot_crrt_beat(
    waveforms: xr.Dataset, means: xr.Dataset, rule_limits: tuple[Limit, ...] = LIMITS
) -> Figure:
    """Plot two beats of every scheme at one speed: patient pressures, right ventricle, access and return.

    Args:
        waveforms: waveforms over `scheme` and `phase`, with `time` [s].
        means: cycle means over `scheme` at the same speed.
        rule_limits: limits to draw.
    """
    extremes = Extremes.of(means)
    fig, grid = _four_panels(_longest_label(means, extremes))
    _draw_vessels(grid[0, 0], waveforms, extremes)
    _draw_loops(grid[0, 1], waveforms, extremes)
    for ax, (line, signal) in zip(grid[1], _PRESSURES.items(), strict=True):
        _finish_line(ax, line, _curves(ax, waveforms, signal, extremes), extremes, rule_limits)
    explain_colours(grid[0, 0], extremes, missing=schemes_without_beat(means))
    return fig


def _longest_label(means: xr.Dataset, extremes: Extremes) -> int:
    """Number of characters of the longest label beside a curve."""
    return 9 if means.sizes["scheme"] <= MOST_LABELS else len(" ".join(extremes))


def _four_panels(characters: int, legend_rows: int = 2) -> tuple[Figure, np.ndarray]:
    """Create two rows of two axes at fixed positions, since automatic layout takes longer than drawing.

    Args:
        characters: space on the right of each panel, in characters.
        legend_rows: number of lines of the legend below.
    """
    height = 150.0 + 4.5 * (legend_rows - 2)
    fig = new_figure(PAGE_WIDTH_MM, height)
    fig.set_layout_engine(None)
    left, room = 0.09, min(0.008 + 0.0088 * characters, 0.2)
    width, tall = 0.5 - left - room, 52.5 / height
    bottoms = [1.0 - 59.25 / height, 1.0 - 127.5 / height]
    places = [[(left + 0.5 * column, bottom, width, tall) for column in (0, 1)] for bottom in bottoms]
    grid = np.array([[fig.add_axes(place) for place in row] for row in places])
    return fig, grid


def _curves(ax: Axes, waveforms: xr.Dataset, name: str, extremes: Extremes) -> Ends:
    time, values = two_beats(waveforms.transpose("phase", "scheme", ...), name)
    by_letter = dict(zip(waveforms["scheme"].values.astype(str), values.T, strict=True))
    for letter, row in by_letter.items():
        ax.plot(time, row, **extremes.style(letter))
    ax.set_xlim(time[0], time[-1])
    ax.set_xlabel("Time [s]")
    ax.set_ylabel("Pressure [mmHg]")
    return {letter: (float(time[-1]), float(row.mean())) for letter, row in by_letter.items()}


def _draw_vessels(ax: Axes, waveforms: xr.Dataset, extremes: Extremes) -> None:
    for name, label in VESSELS:
        _curves(ax, waveforms, name, extremes)
        values = waveforms[name].values
        values = values[np.isfinite(values)]
        if len(values):
            _name_vessel(ax, name, label, float(values.min()), float(values.max()))
    ax.set_ylim(-9.0, 1.12 * ax.get_ylim()[1])
    ax.set_title("a) Patient", loc="left")


def _name_vessel(ax: Axes, name: str, label: str, lowest: float, highest: float) -> None:
    """Write the name of a vessel at the left above its curves, or below for the veins at the bottom."""
    below = name == "Psvn"
    ax.annotate(
        label, (0.02, lowest if below else highest), xycoords=("axes fraction", "data"), fontsize=7.5,
        xytext=(0, -3 if below else 2), textcoords="offset points", va="top" if below else "bottom",
    )  # fmt: skip


def _draw_loops(ax: Axes, waveforms: xr.Dataset, extremes: Extremes) -> None:
    volumes, pressures = (waveforms[n].transpose("scheme", "phase").values for n in ("Vrv", "Prv"))
    letters = waveforms["scheme"].values.astype(str)
    for letter, volume, pressure in zip(letters, volumes, pressures, strict=True):
        ax.plot(volume, pressure, **extremes.style(letter))
    ax.set_xlabel("Right-ventricular volume [mL]")
    ax.set_ylabel("Right-ventricular pressure [mmHg]")
    ax.set_title("b) Right ventricle", loc="left")


_PRESSURES = {"access": "Pcrrttuin", "return": "Pcrrttuout"}


def _finish_line(ax: Axes, line: str, ends: Ends, extremes: Extremes, rule_limits: tuple[Limit, ...]) -> None:
    """Add alarm limits, letters at the ends of the curves, and title to the panel of a line."""
    bounds = {limit.name: (limit.low, limit.high) for limit in rule_limits}
    low, high = bounds[f"{line}_alarm"]
    limit_line(ax, high, f"high alarm {high:g}")
    limit_line(ax, low, f"low alarm {low:g}".replace("-", "−"), above=False)
    if line == "access":
        sansom = " (Sansom 2023)" * (rule_limits == LIMITS)
        limit_line(ax, bounds["access_190"][1], f"{bounds['access_190'][1]:g}{sansom}", dotted=True)
    bottom, top = ax.get_ylim()
    finite = [bound for bound in (low, high) if np.isfinite(bound)]
    bottom, top = min(bottom, *finite, np.inf), max(top, *finite, -np.inf)
    room = 0.10 * (top - bottom)
    ax.set_ylim(bottom - room, top + room)
    label_ends(ax, ends, extremes)
    ax.set_title({"access": "c) Access line", "return": "d) Return line"}[line], loc="left")


@figure_style()
def plot_crrt_speeds(means: xr.Dataset, case_speed: float, rule_limits: tuple[Limit, ...] = LIMITS) -> Figure:
    """Plot cycle means of every scheme over the ECMO flow: patient, drainage cannula, access and return line.

    Args:
        means: means over `scheme` and `speed`; pressures [mmHg] and `PF` [L/min].
        case_speed: speed that is marked [rpm]; it also determines which schemes are highlighted.
        rule_limits: limits to draw.
    """
    extremes = Extremes.of(means.sel(speed=case_speed))
    gaps = bool(np.isnan(means["Psart"].values).any())
    fig, grid = _four_panels(_longest_label(means, extremes), 3 if gaps else 2)
    for name, label in VESSELS:
        _over_flow(grid[0, 0], means, name, extremes)
        some = means[name].dropna("speed", how="all")
        if some.sizes["speed"]:
            start = some.isel(speed=0)
            highest_start = float(start.max()) if name != "Psart" else float(some.isel(speed=-1).max())
            _name_vessel(grid[0, 0], name, label, float(start.min()), highest_start)
    low, high = grid[0, 0].get_ylim()
    grid[0, 0].set_ylim(min(-9.0, low), high + 0.06 * (high - low))  # the name of the artery stands above it
    grid[0, 0].set_title("a) Patient", loc="left")
    label_ends(grid[0, 1], _over_flow(grid[0, 1], means, "Pecmodrain", extremes), extremes)
    suction = next(limit.low for limit in rule_limits if limit.name == "suction")
    limit_line(grid[0, 1], suction, f"suction feared below {suction:g}".replace("-", "−"), dotted=True)
    grid[0, 1].set_title("b) ECMO drainage cannula", loc="left")
    for ax, (line, signal) in zip(grid[1], _PRESSURES.items(), strict=True):
        _finish_line(ax, line, _over_flow(ax, means, signal, extremes), extremes, rule_limits)
    at = means["PF"].sel(speed=case_speed).median().item()
    for ax in grid.flat if np.isfinite(at) else ():
        ax.axvline(at, **_CASE_FLOW, zorder=1)
    mark = "ECMO flow of the case" if np.isfinite(at) else None
    explain_colours(grid[0, 0], extremes, mark, schemes_without_beat(means.sel(speed=case_speed)), gaps)
    return fig


def _over_flow(ax: Axes, means: xr.Dataset, name: str, extremes: Extremes) -> Ends:
    ends = {}
    values_of = {n: means[n].transpose("scheme", "speed").values for n in (name, "PF")}
    for k, letter in enumerate(means["scheme"].values.astype(str)):
        flow, values, look = values_of["PF"][k], values_of[name][k], extremes.style(letter)
        ax.plot(flow, values, **look)
        mark_gaps(ax, flow, values, look["color"])
        known = np.flatnonzero(np.isfinite(flow) & np.isfinite(values))
        if len(known):
            ends[letter] = (float(flow[known[-1]]), float(values[known[-1]]))
    ax.set_xlabel("ECMO flow [L/min]")
    ax.set_ylabel("Mean pressure [mmHg]")
    return ends


@figure_style()
def plot_crrt_uptake(uptake: xr.Dataset, means: xr.Dataset, without: xr.Dataset) -> Figure:
    """Plot arterial pressure of every scheme with both volume policies, and the effect of blood uptake.

    Args:
        uptake: differences from the patient without CRRT over `scheme`, split into `_uptake` and `_flow`.
        means: means over `policy` and `scheme` at the same speed.
        without: means over `policy` at the same speed without CRRT.
    """
    fig = new_figure(PAGE_WIDTH_MM, 20 + 6.5 * means.sizes["scheme"])
    left, right = fig.subplots(1, 2, sharey=True)
    letters = [plain_text(x, 24) for x in means["scheme"].values.astype(str)]
    rows = np.arange(len(letters))
    looks = {
        "as_published": (OKABE_ITO["vermillion"], "o", "patient's blood fills the tubing (as published)"),
        "patient_held": (OKABE_ITO["blue"], "s", "circuits primed (patient's volume held)"),
    }
    for policy in means["policy"].values.astype(str):
        colour, marker, label = looks[policy]
        left.plot(means["Psart"].sel(policy=policy), rows, marker, color=colour, markersize=5, label=label)
        left.axvline(float(without["Psart"].sel(policy=policy)), color=colour, linewidth=0.9, linestyle=":")
    _mark_unknown(left, rows, means["Psart"].isnull().any("policy").values)
    left.set_xlabel("Mean arterial pressure [mmHg]\n(dotted: without CRRT)")
    left.set_title("a) Arterial pressure", loc="left")
    parts = (("uptake", OKABE_ITO["vermillion"], "blood taken up by the tubing", -0.2),
             ("flow", OKABE_ITO["bluish green"], "changed flow", 0.2))  # fmt: skip
    for word, colour, label, shift in parts:
        right.barh(rows + shift, uptake[f"Psart_{word}"], height=0.38, color=colour, label=label)
    _mark_unknown(right, rows, np.isnan(uptake["Psart_flow"].values))
    for row, volume_ml in zip(rows, uptake["blood_taken_up"].values, strict=True):
        volume = number(float(volume_ml), 0, unit="mL", missing="– mL")
        right.annotate(volume, (1.0, row), xycoords=("axes fraction", "data"),
                       xytext=(3, 0), textcoords="offset points", va="center", fontsize=7.5)  # fmt: skip
    right.axvline(0.0, color="black", linewidth=0.7)
    right.set_xlabel("Difference to the patient without CRRT [mmHg]\n(right: blood taken up, as published)")
    right.set_title("b) What makes the difference, as published", loc="left")
    left.set_yticks(rows, letters)
    left.invert_yaxis()
    left.set_ylabel("Scheme")
    fig.legend(loc="outside lower center", ncols=2)
    return fig


def _mark_unknown(ax: Axes, rows: np.ndarray, which: np.ndarray) -> None:
    """Write a note in the rows of schemes for which something is missing."""
    for row in rows[which]:
        ax.annotate("not known: no steady beat", (0.02, row), xycoords=("axes fraction", "data"), va="center",
                    fontsize=6.5, color=GREY, zorder=6,
                    bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.4, "alpha": 0.8})  # fmt: skip


@figure_style()
def plot_crrt_limits(
    limits: xr.Dataset, case_flow: float, ranked: list[str], rule_limits: tuple[Limit, ...] = LIMITS
) -> Figure:
    """Plot the largest ECMO flow up to which every scheme keeps each limit.

    Args:
        limits: `largest_flow`, `flow_at_most` and `state` over `scheme` and `limit`.
        case_flow: ECMO flow of the case, which is marked [L/min]; NaN if not known.
        ranked: schemes from best to worst, top to bottom.
        rule_limits: limits of the rule.
    """
    fig = new_figure(PAGE_WIDTH_MM, 22 + 6.5 * max(len(ranked), 5))  # space for label and legend
    ax = fig.subplots()
    rows = np.arange(len(ranked))
    all_limits = limits.sel(limit="crrt", scheme=ranked)
    end = 1.04 * float(np.nanmax([1.0, case_flow, *limits["largest_flow"].values.ravel()]))
    flow_kept = all_limits["largest_flow"].fillna(0.0).values
    limited = any_bounded(limit for limit in rule_limits if limit.of_crrt)
    kept = "all limits of the CRRT lines kept" if limited else "studied: the rule sets no limits of the lines"
    ax.barh(rows, flow_kept, height=0.55, color="#C9D9E6", label=kept)
    unsure = np.isin(all_limits["state"].values, ("not_known_above", "not_known"))
    if unsure.any():
        further = np.minimum(all_limits["flow_at_most"].values[unsure], 0.99 * end) - flow_kept[unsure]
        ax.barh(
            rows[unsure], further, left=flow_kept[unsure], height=0.55, facecolor="white", edgecolor=GREY,
            linestyle=":", hatch="////", linewidth=0.6, label="not known: no steady beat found",
        )  # fmt: skip
    bounds = {limit.name: (limit.low, limit.high) for limit in rule_limits}
    unbounded = {limit.name for limit in rule_limits if limit.unbounded}
    marks = {
        "access_alarm": ("access alarm", OKABE_ITO["blue"], "<"),
        "return_alarm": ("return alarm", OKABE_ITO["vermillion"], ">"),
        "access_190": (f"access above {bounds['access_190'][1]:g} mmHg", OKABE_ITO["bluish green"], "o"),
        "suction": (f"drainage below {bounds['suction'][0]:g} mmHg".replace("-", "−"), "black", "|"),
    }
    for name, (label, colour, marker) in marks.items():
        if name in unbounded:
            continue
        limit_data = limits.sel(limit=name, scheme=ranked)
        flows = limit_data["largest_flow"].where(limit_data["state"] == "broken_above")
        ax.plot(flows, rows, marker, color=colour, markersize=6, label=f"{label} from here")
    if np.isfinite(case_flow):
        ax.axvline(case_flow, color="black", linewidth=0.9, linestyle="--", label="ECMO flow of the case")
    ax.set_yticks(rows, [plain_text(letter, 24) for letter in ranked])
    ax.invert_yaxis()
    ax.set_xlim(0.0, end)
    ax.set_xlabel("ECMO flow [L/min]")
    ax.set_ylabel("Scheme, best first")
    fig.legend(loc="outside lower center", ncols=3)
    return fig


# --- colours of schemes, labels at the end of curves, lines of limits -----------------------------


HIGHEST_COLOUR = OKABE_ITO["vermillion"]
LOWEST_COLOUR = OKABE_ITO["blue"]
OTHERS_COLOUR = "#9A9A9A"
MOST_LABELS = 12
"""With more schemes than this, only the highest and the lowest curves are labelled."""


def label_ends(ax: Axes, ends: Ends, extremes: Extremes) -> None:
    """Write letters at the right ends of curves; curves with the same end share a label."""
    shown = {k: v for k, v in ends.items() if np.isfinite(v).all()}
    if len(shown) > MOST_LABELS:
        shown = {k: v for k, v in shown.items() if k in extremes}
    bottom, top = ax.get_ylim()
    gap = 0.06 * (top - bottom)
    clusters: list[list[str]] = []
    for letter in sorted(shown, key=lambda k: shown[k][1]):
        if clusters and shown[letter][1] - shown[clusters[-1][-1]][1] < 0.5 * gap:
            clusters[-1].append(letter)
        else:
            clusters.append([letter])
    heights = [float(np.mean([shown[k][1] for k in cluster])) for cluster in clusters]
    for i in range(1, len(heights)):
        heights[i] = max(heights[i], heights[i - 1] + gap)
    for cluster, height in zip(clusters, heights, strict=True):
        text = "all" if len(cluster) == len(ends) > 2 else plain_text(" ".join(sorted(cluster)), 40)
        ax.annotate(
            text, (max(shown[k][0] for k in cluster), height), xytext=(3, 0), textcoords="offset points",
            va="center", ha="left", fontsize=7.5, color=extremes.colour(cluster),
            fontweight="bold" if {*extremes} & set(cluster) else "normal", annotation_clip=False,
        )  # fmt: skip


def limit_line(ax: Axes, value: float, text: str, *, dotted: bool = False, above: bool = True) -> None:
    """Draw a horizontal line at a limit, with its name at the left, above or below the line."""
    ax.axhline(value, color="black", linewidth=0.9, linestyle=":" if dotted else "--", zorder=2)
    ax.annotate(
        text, (0.015, value), xycoords=("axes fraction", "data"), xytext=(0, 2 if above else -2),
        textcoords="offset points", va="bottom" if above else "top", ha="left", fontsize=7,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.4, "alpha": 0.8}, zorder=5,
    )  # fmt: skip


def mark_gaps(ax: Axes, x: np.ndarray, y: np.ndarray, colour: object) -> None:
    """Draw hollow circles where a curve ends at an unknown point.

    Args:
        ax: axes of the curve.
        x: coordinates of all points; NaN if not known.
        y: coordinates of all points; NaN if not known.
        colour: colour of the curve.
    """
    known = np.isfinite(x) & np.isfinite(y)
    beside = np.r_[known[1:], True] & np.r_[True, known[:-1]]
    edge = known & ~beside
    ax.plot(x[edge], y[edge], "o", markersize=3.6, markerfacecolor="white", markeredgecolor=colour, zorder=6)


GAP_LABEL = "not known beyond: no steady beat found"


def explain_colours(
    ax: Axes, extremes: Extremes, mark: str | None = None, missing: Sequence[str] = (), gaps: bool = False
) -> None:
    """Add a legend below the figure.

    Args:
        ax: one of the figure's axes.
        extremes: schemes that are highlighted.
        mark: name of the thin vertical line, if there is one.
        missing: schemes whose beat at the case's speed was not found.
        gaps: whether curves end in hollow circles.
    """
    among = " of those known" if missing else ""
    shown = [*zip(extremes, ("highest", "lowest"), strict=True)] if extremes.highest else []
    handles = [Line2D([], [], **extremes.style(letter)) for letter in (*(k for k, _ in shown), "")]
    texts = [f"{plain_text(k, 30)}: {word} arterial pressure{among}" for k, word in shown]
    texts.append("other schemes")
    if mark is not None:
        handles.append(Line2D([], [], **_CASE_FLOW))
        texts.append(mark)
    if gaps:
        look: dict[str, Any] = {"marker": "o", "markerfacecolor": "white", "markeredgecolor": "black"}
        handles.append(Line2D([], [], linestyle="none", markersize=3.6, **look))
        texts.append(GAP_LABEL)
    if missing:
        handles.append(Line2D([], [], linestyle="none"))
        few = ", ".join(missing) if len(missing) <= 6 else f"{len(missing)} schemes"
        texts.append(f"no steady beat at the case's speed: {plain_text(few, 50)}")
    figure = ax.get_figure(root=True)
    if figure is not None:
        columns = 3 if len(texts) == 3 else 2
        figure.legend(handles, texts, loc="lower center", bbox_to_anchor=(0.5, 0.0), ncols=columns)


# --- the schemes as small drawings ------------------------------------------------------------------


POSITIONS = {
    "post_dc": 1.0, "pre_pump": 2.4, "post_pump": 4.0, "pre_oxy": 5.2, "post_oxy": 7.2, "pre_rc": 8.6,
}  # fmt: skip
PUMP, OXYGENATOR = 3.2, 6.2
ECMO_COLOUR, CRRT_COLOUR, RETURN_COLOUR = GREY, OKABE_ITO["blue"], OKABE_ITO["vermillion"]
COLUMNS = 3
MOST_DRAWN = 18


@figure_style()
def draw_schemes(schemes: Sequence[Scheme], places: Mapping[str, str] | None = None) -> Figure:
    """Draw schemes as small diagrams, three in a row.

    Args:
        schemes: schemes to draw; of more than 18, only the 18 best ones.
        places: rank of each by letter, best first, written in the title; "–" if not known.
    """
    shown = list(schemes)
    if len(shown) > MOST_DRAWN:
        order = {letter: k for k, letter in enumerate(places or ())}
        shown = sorted(shown, key=lambda scheme: order.get(scheme.letter, 0))[:MOST_DRAWN]
    rows = -(-len(shown) // COLUMNS)
    fig = new_figure(PAGE_WIDTH_MM, 4 + 31 * rows)
    fig.set_layout_engine(None)
    edges = {"left": 0.005, "right": 0.995, "bottom": 0.005, "top": 0.995, "wspace": 0.03, "hspace": 0.03}
    grid = fig.subplots(rows, COLUMNS, squeeze=False, gridspec_kw=edges)
    for index, ax in enumerate(grid.flat):
        ax.set_axis_off()
        if index < len(shown):
            draw_scheme(ax, shown[index], None if places is None else places.get(shown[index].letter))
    return fig


def draw_scheme(ax: Axes, scheme: Scheme, place: str | None = None) -> None:
    """One scheme: drainage cannula, pump, oxygenator and return cannula from left to right, CRRT below."""
    ax.set_xlim(-0.4, 10.0)
    ax.set_ylim(-3.7, 2.2)
    ax.set_aspect("equal")
    rank = "" if place is None else f"  rank {'not known' if place == '–' else place}"
    title = f"{plain_text(scheme.letter, 20)}){rank}"
    ax.text(-0.3, 1.85, title, fontsize=8.5, fontweight="bold", va="center")
    ax.text(-0.3, 1.2, plain_text(scheme.name, 46), fontsize=6.4, va="center", color="black")
    arrow = {"arrowstyle": "->", "color": ECMO_COLOUR, "linewidth": 1.6}
    ax.annotate("", (9.9, 0), (-0.3, 0), arrowprops=arrow)
    ax.add_patch(Circle((PUMP, 0), 0.45, facecolor="white", edgecolor=ECMO_COLOUR, linewidth=1.2, zorder=3))
    ax.text(PUMP, 0, "P", ha="center", va="center", fontsize=6.5, zorder=4)
    box = Rectangle((OXYGENATOR - 0.55, -0.42), 1.1, 0.84, facecolor="white", edgecolor=ECMO_COLOUR, zorder=3)
    ax.add_patch(box)
    ax.text(OXYGENATOR, 0, "Oxy", ha="center", va="center", fontsize=6, zorder=4)
    for x, text in ((0.1, "DC"), (9.4, "RC")):
        ax.text(x, 0.3, text, ha="center", fontsize=6, color=ECMO_COLOUR)
    _draw_crrt(ax, scheme)


def _draw_crrt(ax: Axes, scheme: Scheme) -> None:
    access_x, return_x = _x(scheme.access_site, -0.1), _x(scheme.return_site, 0.1)
    if abs(access_x - return_x) < 0.5:
        access_x, return_x = access_x - 0.22, return_x + 0.22
    middle = min(max(0.5 * (access_x + return_x), 2.2), 7.4)
    low, wide = -2.75, 1.15
    forward = access_x <= return_x
    left, right = middle - wide, middle + wide
    enter, leave = (left, right) if forward else (right, left)
    body = FancyBboxPatch((left, low - 0.42), 2 * wide, 0.84, boxstyle="round,pad=0.02", facecolor="white",
                          edgecolor=CRRT_COLOUR, linewidth=1.2, zorder=3)  # fmt: skip
    ax.add_patch(body)
    ax.text(middle, low, "CRRT", ha="center", va="center", fontsize=6.5, color=CRRT_COLOUR, zorder=4)
    inwards = [(access_x, 0.0), (access_x, -1.35), (enter, -1.35), (enter, low)]
    outwards = [(leave, low), (leave, -1.35), (return_x, -1.35)]
    ax.plot(*zip(*inwards, strict=True), color=CRRT_COLOUR, linewidth=1.2, zorder=2)
    ax.plot(
        *zip(*outwards, strict=True), color=RETURN_COLOUR, linewidth=1.2, linestyle=(0, (4, 1.2)), zorder=2
    )
    arrow = {"arrowstyle": "->", "color": RETURN_COLOUR, "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", (return_x, 0.02), (return_x, outwards[2][1]), arrowprops=arrow, zorder=2)
    ax.plot([access_x], [0], "o", markersize=3.5, color=CRRT_COLOUR, zorder=5)
    ax.plot([return_x], [0], "s", markersize=3.2, color=RETURN_COLOUR, zorder=5)


def _x(site: str, shift: float) -> float:
    """Position of a site along the ECMO circuit; the patient's compartments are beyond its ends."""
    return POSITIONS.get(site, -0.1 + shift)
