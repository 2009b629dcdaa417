"""What the figures of the CRRT study share: colours of schemes, labels at the end of curves, alarm lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from eclsim.reporting.style import GREY, OKABE_ITO, plain_text

HIGHEST_COLOUR = OKABE_ITO["vermillion"]
LOWEST_COLOUR = OKABE_ITO["blue"]
OTHERS_COLOUR = "#9A9A9A"
MOST_LABELS = 12
"""Up to so many schemes every curve is labelled; of more, the highest and the lowest."""


def style_of(letter: str, highest: str, lowest: str) -> dict[str, object]:
    """Line of a scheme: the one with the highest arterial pressure and the one with the lowest stand out."""
    if letter and letter == highest:
        return {"color": HIGHEST_COLOUR, "linewidth": 1.7, "linestyle": (0, (6, 1.2)), "zorder": 4}
    if letter and letter == lowest:
        return {"color": LOWEST_COLOUR, "linewidth": 1.7, "linestyle": "-", "zorder": 4}
    return {"color": OTHERS_COLOUR, "linewidth": 0.9, "linestyle": "-", "zorder": 3}


def colour_of(letters: Sequence[str], highest: str, lowest: str) -> str:
    """Colour of a label that stands for one or more schemes."""
    if highest in letters and lowest not in letters:
        return HIGHEST_COLOUR
    if lowest in letters and highest not in letters:
        return LOWEST_COLOUR
    return "black" if len(letters) > 1 else GREY


def label_ends(ax: Axes, ends: Mapping[str, tuple[float, float]], highest: str, lowest: str) -> None:
    """Letters beside the right end of curves; curves that end together share a label.

    Args:
        ax: axes whose limits are set.
        ends: last point (x, y) of each scheme's curve.
        highest: scheme with the highest arterial pressure.
        lowest: scheme with the lowest.
    """
    shown = {k: v for k, v in ends.items() if np.isfinite(v).all()}
    if len(shown) > MOST_LABELS:
        shown = {k: v for k, v in shown.items() if k in (highest, lowest)}
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
            va="center", ha="left", fontsize=7.5, color=colour_of(cluster, highest, lowest),
            fontweight="bold" if {highest, lowest} & set(cluster) else "normal", annotation_clip=False,
        )  # fmt: skip


def limit_line(ax: Axes, value: float, text: str, *, dotted: bool = False, above: bool = True) -> None:
    """A horizontal line at a limit with its name at the left, above or below the line."""
    ax.axhline(value, color="black", linewidth=0.9, linestyle=":" if dotted else "--", zorder=2)
    ax.annotate(
        text, (0.015, value), xycoords=("axes fraction", "data"), xytext=(0, 2 if above else -2),
        textcoords="offset points", va="bottom" if above else "top", ha="left", fontsize=7,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.4, "alpha": 0.8}, zorder=5,
    )  # fmt: skip


def mark_gaps(ax: Axes, x: np.ndarray, y: np.ndarray, colour: object) -> bool:
    """Hollow circles on the points of a curve beside which a point is not known; whether there are any.

    Args:
        ax: axes of the curve.
        x: of all points; NaN where not known.
        y: likewise.
        colour: of the curve.
    """
    known = np.isfinite(x) & np.isfinite(y)
    beside = np.r_[known[1:], True] & np.r_[True, known[:-1]]
    edge = known & ~beside
    ax.plot(x[edge], y[edge], "o", markersize=3.6, markerfacecolor="white", markeredgecolor=colour, zorder=6)
    return bool(edge.any())


GAP_WORDS = "not known beyond: no steady beat found"


def explain_colours(
    ax: Axes,
    highest: str,
    lowest: str,
    mark: str | None = None,
    missing: Sequence[str] = (),
    gaps: bool = False,
) -> None:
    """Legend of what is drawn below the figure.

    Args:
        ax: one of the figure's axes.
        highest: scheme with the highest arterial pressure; empty if none is known.
        lowest: scheme with the lowest; likewise.
        mark: name of the thin vertical line, if there is one.
        missing: schemes whose beat at the case's speed was not found.
        gaps: whether curves end in hollow circles.
    """
    among = " of those known" if missing else ""
    shown = [
        (highest, f"{plain_text(highest, 30)}: highest arterial pressure{among}"),
        (lowest, f"{plain_text(lowest, 30)}: lowest arterial pressure{among}"),
        ("", "other schemes"),
    ]
    shown = [entry for entry in shown if highest or not entry[0]][0 if highest else 2 :]
    handles = [Line2D([], [], **style_of(letter, highest, lowest)) for letter, _ in shown]  # pyright: ignore[reportArgumentType] - keywords of a line
    texts = [text for _, text in shown]
    if mark is not None:
        handles.append(Line2D([], [], color=GREY, linewidth=0.6))
        texts.append(mark)
    if gaps:
        look = {"marker": "o", "markersize": 3.6, "markerfacecolor": "white", "markeredgecolor": "black"}
        handles.append(Line2D([], [], linestyle="none", **look))  # pyright: ignore[reportArgumentType] - keywords of a line
        texts.append(GAP_WORDS)
    if missing:
        handles.append(Line2D([], [], linestyle="none"))
        texts.append(f"no steady beat at the case's speed: {_few(missing)}")
    figure = ax.get_figure(root=True)
    if figure is not None:
        columns = 3 if len(texts) == 3 else 2
        figure.legend(handles, texts, loc="lower center", bbox_to_anchor=(0.5, 0.0), ncols=columns)


def _few(letters: Sequence[str]) -> str:
    """Up to six schemes by name, of more how many."""
    if len(letters) > 6:
        return f"{len(letters)} schemes"
    return plain_text(", ".join(letters), 50)
