"""Self-contained HTML pages from Jinja2 templates: nothing is loaded from elsewhere, all text is escaped.

A package keeps its templates beside its modules, such as `crrt_study/report.html`. They extend
`reporting/page.html` and use the macros of `reporting/blocks.html` for tables, boxes, lists and figures.
"""

from __future__ import annotations

import io
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import lru_cache
from html import escape
from typing import TYPE_CHECKING

import jinja2

from eclsim._version import __version__
from eclsim.reporting.numbers import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Table:
    """A table on a page.

    Args:
        head: column names, with units.
        rows: cells of each row.
        numeric: indices of right-aligned columns.
        foot: number of last rows that are set apart.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[object]]
    numeric: Collection[int] = ()
    foot: int = 0

    def __post_init__(self) -> None:
        if wrong := [row for row in self.rows if len(row) != len(self.head)]:
            raise ValueError(f"a row has {len(wrong[0])} cells, the head {len(self.head)}: {wrong[0]}")


def render(template: str, **values: object) -> str:
    """Render a page.

    Args:
        template: path below the package, such as "crrt_study/report.html".
        values: names used by the template; a missing one is an error.
    """
    return _environment().get_template(template).render(values)


@lru_cache(maxsize=1)
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("eclsim", ""), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, finalize=_printable,
    )  # fmt: skip
    environment.globals["version"] = __version__
    environment.filters |= {"inline_svg": _labelled_svg, "number": number}
    return environment


def _printable(value: object) -> object:
    """Replace characters that are not allowed in a page; `autoescape` does the rest."""
    if hasattr(value, "__html__"):  # already HTML
        return value
    allowed = (
        c if c in "\n\t" or (ord(c) >= 32 and not 127 <= ord(c) < 160) else "\ufffd" for c in str(value)
    )
    return "".join(allowed).encode("utf-8", "replace").decode("utf-8")


def _labelled_svg(svg: str, key: str, label: str) -> str:
    return inline_svg(svg, key).replace("<svg", f'<svg role="img" aria-label="{escape(label)}"', 1)


def svg_text(drawing: Figure) -> str:
    """Return a figure as SVG text."""
    from eclsim.reporting.style import SVG_METADATA, figure_style

    buffer = io.StringIO()
    with figure_style():
        drawing.savefig(buffer, format="svg", metadata=SVG_METADATA)
    return buffer.getvalue()


def inline_svg(svg: str, key: str) -> str:
    """Prepare SVG for embedding in a page: no prolog, metadata or namespaces, and ids prefixed with a key."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\s+xmlns(:\w+)?="[^"]*"', "", svg)
    svg = svg.replace("xlink:href=", "href=")
    svg = re.sub(r'(\sid=")', rf"\g<1>{key}-", svg)
    svg = re.sub(r'(href="#)', rf"\g<1>{key}-", svg)
    return re.sub(r"(url\(#)", rf"\g<1>{key}-", svg).strip()
