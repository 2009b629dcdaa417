"""Common style of all figures: colours, sizes, fonts, ticks, and saving.

Colours are those of Okabe and Ito (2008), which people with colour-blindness can tell apart; line styles
differ as well, so that figures can be read in grey print. Sizes are in millimetres and fit on A4.
"""

import re
import textwrap
import unicodedata
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import matplotlib.style
import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextToPath
from matplotlib.ticker import FuncFormatter, Locator, MaxNLocator, NullFormatter, NullLocator

from eclsim.files import NOTICE, VERSION_NAME, whole_file

MM_PER_INCH, POINTS_PER_INCH = 25.4, 72.0
PAGE_WIDTH_MM = 170.0
DOTS_PER_INCH = 200
MOST_LETTERS = 80
"""Names along an axis are turned if all of the longest one's length have more letters than this."""
MOST_HORIZONTAL_NAMES = 12
LONGEST_FULL_NAME = 16
"""Number of characters; a longer parameter name is shown without its section."""

OKABE_ITO = {
    "black": "#000000",
    "orange": "#E69F00",
    "sky blue": "#56B4E9",
    "bluish green": "#009E73",
    "yellow": "#F0E442",
    "blue": "#0072B2",
    "vermillion": "#D55E00",
    "reddish purple": "#CC79A7",
}
GREY = "#6B6B6B"
_LETTERS_PER_MM, _LINE_MM = (0.54, 0.45), 4.0
"""Letters of smaller words and of a title that fit beside each other, and the height of a line."""

_LONGEST_TITLE, _SHORTEST_TITLE = 120, 20
"""Largest and smallest number of letters of the external text at the beginning of a title."""

# Yellow is omitted: as a line on white it is too faint to print.
CURVES: tuple[tuple[str, object], ...] = (
    (OKABE_ITO["black"], "-"),
    (OKABE_ITO["vermillion"], (0, (5, 1.6))),
    (OKABE_ITO["blue"], (0, (6, 1.4, 1.2, 1.4))),
    (OKABE_ITO["bluish green"], (0, (1.2, 1.2))),
    (OKABE_ITO["orange"], (0, (9, 2))),
    (OKABE_ITO["reddish purple"], (0, (4, 1.2, 1.2, 1.2, 1.2, 1.2))),
    (OKABE_ITO["sky blue"], (0, (2.5, 1))),
)

SVG_METADATA = {"Date": None, "Creator": VERSION_NAME, "Description": NOTICE}
PNG_METADATA = {"Software": VERSION_NAME, "Description": NOTICE}
_STYLE = Path(__file__).with_name("eclsim.mplstyle")


@contextmanager
def figure_style() -> Iterator[None]:
    """Apply eclsim's style while a figure is made, whatever the user's own matplotlib settings are."""
    with matplotlib.style.context(["default", _STYLE]):
        yield


def new_figure(width_mm: float = PAGE_WIDTH_MM, height_mm: float = 110.0) -> Figure:
    """Create a figure of a given size [mm] that belongs to no window and is not registered with pyplot."""
    return Figure(figsize=(width_mm / MM_PER_INCH, height_mm / MM_PER_INCH), layout="constrained")


def panel_grid(count: int, columns: int, row_mm: float, margin_mm: float = 0.0) -> tuple[Figure, list[Axes]]:
    """Create a figure with a number of panels, row by row; the rest of the last row stays empty.

    Args:
        count: number of panels.
        columns: largest number of panels in a row.
        row_mm: height of a row [mm].
        margin_mm: height of title and legend [mm].
    """
    columns = min(columns, count)
    rows = -(-count // columns)
    fig = new_figure(height_mm=margin_mm + row_mm * rows)
    return fig, [fig.add_subplot(rows, columns, k + 1) for k in range(count)]


def draw_matrix(
    fig: Figure,
    numbers: np.ndarray,
    across: Sequence[str],
    down: Sequence[str],
    colours: str,
    limits: tuple[float, float],
    text: Callable[[float], str],
    white: Callable[[float], bool],
    *,
    label: str,
    turned: float | None = None,
    aspect: Literal["auto", "equal"] = "auto",
    pad: float = 0.01,
    shrink: float = 1.0,
) -> Axes:
    """Draw numbers as coloured cells with text, names along both sides, and a colour bar.

    Args:
        fig: figure to draw in.
        numbers: array of shape (down, across).
        across: column names; long ones are shown without their section.
        down: row names; long ones are shown without their section.
        colours: name of a matplotlib colour map.
        limits: numbers at the ends of the colour map.
        text: returns the text of a number.
        white: returns whether the text is white, for dark cells.
        label: label of the colour bar.
        turned: rotation of the column names [degrees]; None for 90 if there are many, else 0.
        aspect: aspect ratio of the cells, as for `imshow`.
        pad: gap between cells and colour bar, as a fraction of the figure.
        shrink: height of the colour bar, as a fraction of that of the cells.
    """
    axes = fig.add_subplot()
    image = axes.imshow(numbers, cmap=colours, vmin=limits[0], vmax=limits[1], aspect=aspect)
    for (i, j), value in np.ndenumerate(numbers):
        if shown := text(value):
            colour = "white" if white(value) else "black"
            axes.text(j, i, shown, ha="center", va="center", color=colour, fontsize=6)
    turned = turned_names(across) if turned is None else turned
    align = "right" if 0.0 < turned < 90.0 else "center"
    axes.set_xticks(range(len(across)), list(map(short_name, across)), rotation=turned, ha=align)
    axes.set_yticks(range(len(down)), list(map(short_name, down)))
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    fig.colorbar(image, ax=axes, label=label, fraction=0.05, pad=pad, shrink=shrink)
    return axes


def turned_names(names: Sequence[str]) -> float:
    """Return the rotation of names along an axis [degrees]: 90 if there are many or they are long, else 0."""
    letters = len(names) * max((len(short_name(name)) for name in names), default=0)
    return 90.0 if len(names) > MOST_HORIZONTAL_NAMES or letters > MOST_LETTERS else 0.0


def short_name(name: str) -> str:
    """Return the name of a parameter, without its section if it is long."""
    return name.rpartition(".")[2] if len(name) > LONGEST_FULL_NAME else name


def curve_style(index: int) -> dict[str, object]:
    """Return colour and line style of the curve with an index; they repeat after seven curves."""
    colour, line = CURVES[index % len(CURVES)]
    return {"color": colour, "linestyle": line}


def plain_text(value: object, limit: int = 70) -> str:
    """Make external text (an id, a label) safe to draw: one line, no formulas, at most `limit` characters."""
    printable = "".join(" " if unicodedata.category(char)[0] in "CZ" else char for char in str(value))
    text = " ".join(printable.split())
    if len(text) > limit:
        text = text[: limit - 1] + "…"
    return text.replace("$", r"\$")


def fitted_title(name: object, suffix: str = "", width_mm: float = PAGE_WIDTH_MM) -> str:
    """Title of a figure that begins with external text, which is cut only where the line has no room for it.

    Args:
        name: external text, such as a patient's id.
        suffix: rest of the title, never cut.
        width_mm: width of the figure [mm].
    """
    limit = _LONGEST_TITLE
    while limit > _SHORTEST_TITLE and _title_width_mm(plain_text(name, limit) + suffix) > 0.97 * width_mm:
        limit -= 2
    return plain_text(name, limit) + suffix


def _title_width_mm(title: str) -> float:
    """Width of a title in its font [mm]."""
    with figure_style(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        font = FontProperties(size=rcParams["figure.titlesize"], weight=rcParams["figure.titleweight"])
        points, _, _ = TextToPath().get_text_width_height_descent(title.replace(r"\$", "$"), font, False)
    return points / POINTS_PER_INCH * MM_PER_INCH


def broken_name(name: str, letters: int) -> str:
    """Break a long name after underscores and dots into lines of at most so many letters, where it can be."""
    lines = [""]
    for part in re.findall(r"[^_.]*[_.]|[^_.]+", name):
        if lines[-1] and len(lines[-1] + part) > letters:
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)


def write_above(fig: Figure, sentences: Sequence[str], title: str = "") -> None:
    """Write a title and sentences above a figure, at the left; the figure grows by their height.

    Args:
        fig: figure; if it has a title, this stands between the two.
        sentences: external text, such as doubts about all numbers.
        title: first line, such as the patient's id.
    """
    own = fig.get_suptitle()
    letters = int(_LETTERS_PER_MM[bool(own)] * MM_PER_INCH * fig.get_figwidth())
    lines = [line for text in sentences for line in textwrap.wrap(plain_text(text, 330), letters)]
    if not (title or lines):
        return
    _grow_upwards(fig, len(lines) + bool(title))
    there = next((text for text in fig.texts if own and text.get_text() == own), None)
    if there is None:
        with figure_style():
            there = fig.suptitle("", fontsize=8)
    there.set(text="\n".join([*filter(None, (title, own)), *lines]), x=0.01, horizontalalignment="left")


def _grow_upwards(fig: Figure, lines: int) -> None:
    """Make room for lines of text at the top; axes at fixed positions keep their size."""
    fixed = fig.get_layout_engine() is None
    height = fig.get_figheight()
    taller = height + (_LINE_MM * lines + (4.0 if fixed else 0.0)) / MM_PER_INCH
    fig.set_figheight(taller)
    if fixed:
        for axes in fig.axes:
            left, bottom, width, tall = axes.get_position(original=True).bounds
            axes.set_position((left, bottom * height / taller, width, tall * height / taller))


def save_figure(
    fig: Figure,
    path_without_suffix: str | Path,
    formats: Sequence[str] = ("svg", "png"),
    above: Sequence[str] = (),
) -> list[Path]:
    """Write the figure in each format, with sentences above it, and return the paths of the files.

    Each file is complete when it appears under its name. The same figure gives the same SVG, byte for byte.
    """
    write_above(fig, above)
    stem = Path(path_without_suffix)
    stem.parent.mkdir(parents=True, exist_ok=True)
    with figure_style(), warnings.catch_warnings():
        # The font lacks the glyphs of some scripts: PNG shows boxes for them, SVG uses the reader's fonts.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        with _layout_fixed(fig):
            return [_write(fig, stem.with_name(f"{stem.name}.{suffix}"), suffix) for suffix in formats]


def save_figures(figures: Mapping[str, Figure], folder: Path) -> list[Path]:
    """Write figures by name to a folder and return the paths of the files."""
    return [path for name, figure in figures.items() for path in save_figure(figure, folder / name)]


@contextmanager
def _layout_fixed(fig: Figure) -> Iterator[None]:
    """Compute a figure's layout once, not for each format: it takes most of the time of saving.

    Text is wider at some resolutions than at others, so the layout is that of the resolution of the file.
    """
    engine, dpi = fig.get_layout_engine(), fig.dpi
    if engine is None:
        yield
        return
    fig.set_dpi(DOTS_PER_INCH)
    fig.draw_without_rendering()
    fig.set_layout_engine("none")
    try:
        yield
    finally:
        fig.set_layout_engine(engine)
        fig.set_dpi(dpi)


def _write(fig: Figure, target: Path, suffix: str) -> Path:
    metadata = {"svg": SVG_METADATA, "png": PNG_METADATA}.get(suffix)
    with whole_file(target) as partial:
        fig.savefig(partial, format=suffix, dpi=DOTS_PER_INCH, metadata=metadata)
    return target


# --- ticks of logarithmic axes: a few plain numbers that do not overlap ---------------------------

_STEPS = (
    (1.0,),
    (1.0, 3.0),
    (1.0, 2.0, 5.0),
    (1.0, 1.5, 2.0, 3.0, 5.0, 7.0),
    tuple(np.arange(1.0, 10.0, 0.5).tolist()),
)
"""Leading digits allowed for ticks, from the roundest numbers to less round ones."""


class PlainLogLocator(Locator):
    """Locator of the roundest numbers of which enough fit on a logarithmic axis.

    Args:
        gap: smallest distance between two ticks, as a fraction of the axis.
    """

    def __init__(self, gap: float):
        self.gap = gap

    def __call__(self) -> Sequence[float]:
        """Return the ticks for the current limits of the axis."""
        assert isinstance(self.axis, Axis)
        low, high = sorted(self.axis.get_view_interval())
        return self.tick_values(low, high)

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """Return the ticks between two numbers above 0."""
        if not 0.0 < vmin < vmax:
            return []
        decades = 10.0 ** np.arange(np.floor(np.log10(vmin)), np.ceil(np.log10(vmax)) + 1.0)
        for digits in _STEPS:
            ticks = np.sort(np.outer(decades, digits).ravel())
            chosen = self._without_overlaps(ticks[(ticks >= vmin) & (ticks <= vmax)], vmin, vmax)
            if len(chosen) > 1:
                return chosen
        even = np.array(MaxNLocator(4).tick_values(vmin, vmax))
        return self._without_overlaps(even[(even >= vmin) & (even <= vmax)], vmin, vmax)

    def _without_overlaps(self, ticks: np.ndarray, low: float, high: float) -> list[float]:
        chosen: list[float] = []
        for tick in ticks.tolist():
            if not chosen or np.log(tick / chosen[-1]) >= self.gap * np.log(high / low):
                chosen.append(tick)
        return chosen


def plain_log_ticks(axis: Axis, gap: float = 0.2, *, shown: bool = True) -> None:
    """Put a few round numbers on a logarithmic axis, or ticks without labels."""
    axis.set_major_locator(PlainLogLocator(gap))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}") if shown else NullFormatter())
