"""Pieces of a self-contained HTML page: nothing is loaded from elsewhere, text is escaped, A4 prints well."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

from eclsim._version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLE = """
@page { size: A4; margin: 16mm 15mm; }
* { box-sizing: border-box; }
body { font: 10.5pt/1.45 "Segoe UI", "Helvetica Neue", Arial, sans-serif; color: #1a1a1a;
  max-width: 180mm; margin: 0 auto; padding: 8mm 4mm; background: #fff; }
h1 { font-size: 18pt; line-height: 1.2; margin: 0 0 2mm; }
h2 { font-size: 13pt; margin: 9mm 0 2mm; border-bottom: 1px solid #bbb; padding-bottom: 1mm;
  break-after: avoid; }
h3 { font-size: 10.5pt; margin: 5mm 0 1mm; break-after: avoid; }
p, ul, ol { margin: 0 0 3mm; }
li { margin-bottom: 0.8mm; }
.lead { color: #444; }
.box { border-left: 4px solid #0072b2; background: #f1f6fa; padding: 3mm 4mm; margin: 4mm 0;
  break-inside: avoid; }
.warn { border-left-color: #d55e00; background: #fdf3ec; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: 8.6pt; margin: 2mm 0 4mm; }
th, td { text-align: left; vertical-align: top; padding: 0.9mm 1.4mm; border-bottom: 1px solid #ddd; }
th { border-bottom: 1.5px solid #555; vertical-align: bottom; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; }
td.n { white-space: nowrap; }
tr { break-inside: avoid; }
thead { display: table-header-group; }
tr.foot td { font-weight: 600; border-top: 1.5px solid #555; }
figure { margin: 3mm 0 5mm; break-inside: avoid; }
figure svg { max-width: 100%; height: auto; display: block; }
figcaption { font-size: 9pt; color: #444; margin-top: 1mm; }
footer { margin-top: 8mm; border-top: 1px solid #bbb; padding-top: 2mm; font-size: 8.5pt; color: #555; }
@media print { body { padding: 0; max-width: none; font-size: 9.5pt; } .scroll { overflow: visible; } }
"""


FOOTER = (
    f"Computed with eclsim {__version__}. A research model, not a medical device: it supports thinking about "
    "a patient and decides nothing."
)


def page(title: str, body: Iterable[str]) -> str:
    """A whole page; `body` are pieces of HTML made by the functions of this module."""
    policy = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{text(title)}</title>",
            f"<style>{STYLE}</style>",
            "</head>",
            "<body>",
            *body,
            f"<footer>{text(FOOTER)}</footer>",
            "</body>",
            "</html>",
            "",
        ]
    )


def text(value: object) -> str:
    """Text made safe for HTML; characters that have no place in a page are replaced."""
    allowed = (
        c if c in "\n\t" or (ord(c) >= 32 and not 127 <= ord(c) < 160) else "\ufffd" for c in str(value)
    )
    printable = "".join(allowed)
    return escape(printable.encode("utf-8", "replace").decode("utf-8"), quote=True)


def heading(words: str, level: int = 2) -> str:
    """A heading."""
    return f"<h{level}>{text(words)}</h{level}>"


def paragraph(words: str, kind: str = "") -> str:
    """A paragraph; `kind` is the style "lead"."""
    return f'<p class="{text(kind)}">{text(words)}</p>' if kind else f"<p>{text(words)}</p>"


def box(words: Sequence[str], *, warn: bool = False) -> str:
    """Sentences that stand out; the first one in bold."""
    first, *rest = words
    inner = f"<strong>{text(first)}</strong>" + "".join(f"<br>{text(line)}" for line in rest)
    return f'<div class="box{" warn" if warn else ""}">{inner}</div>'


def bullets(lines: Iterable[str], *, numbered: bool = False) -> str:
    """A list."""
    tag = "ol" if numbered else "ul"
    return f"<{tag}>" + "".join(f"<li>{text(line)}</li>" for line in lines) + f"</{tag}>"


def table(
    head: Sequence[str], rows: Iterable[Sequence[object]], numeric: Sequence[int] = (), foot: int = 0
) -> str:
    """A table.

    Args:
        head: names of the columns, with units.
        rows: cells.
        numeric: columns that are set flush right.
        foot: so many last rows are set off.
    """
    body = [list(row) for row in rows]
    kind = [' class="n"' if index in numeric else "" for index in range(len(head))]
    top = "".join(f"<th{k}>{text(cell)}</th>" for k, cell in zip(kind, head, strict=True))
    lines = []
    for index, row in enumerate(body):
        cells = "".join(f"<td{k}>{text(cell)}</td>" for k, cell in zip(kind, row, strict=True))
        set_off = ' class="foot"' if index >= len(body) - foot else ""
        lines.append(f"<tr{set_off}>{cells}</tr>")
    inner = f"<thead><tr>{top}</tr></thead><tbody>{''.join(lines)}</tbody>"
    return f'<div class="scroll"><table>{inner}</table></div>'


def figure(svg: str, caption: str, key: str) -> str:
    """A drawing (SVG text) inline; `key` makes the names inside it its own."""
    label = text(caption.partition(".")[0])
    drawn = inline_svg(svg, key).replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
    return f"<figure>{drawn}<figcaption>{text(caption)}</figcaption></figure>"


def svg_text(drawing: Figure) -> str:
    """A figure as SVG text."""
    from eclsim.reporting.style import figure_style

    buffer = io.StringIO()
    with figure_style():
        drawing.savefig(buffer, format="svg", metadata={"Date": None, "Creator": "eclsim"})
    return buffer.getvalue()


def inline_svg(svg: str, key: str) -> str:
    """SVG to stand inside a page: without prolog, metadata and namespaces, and with names of its own."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\s+xmlns(:\w+)?="[^"]*"', "", svg)
    svg = svg.replace("xlink:href=", "href=")
    svg = re.sub(r'(\sid=")', rf"\g<1>{key}-", svg)
    svg = re.sub(r'(href="#)', rf"\g<1>{key}-", svg)
    return re.sub(r"(url\(#)", rf"\g<1>{key}-", svg).strip()
