"""Renders ```math blocks, $$...$$ and $...$ as MathML while the site is built: no script has to be loaded."""

import re

from latex2mathml.converter import convert

CODE = r"^```(?!math\n).*?^```$|`[^`\n]+`"
BLOCK = r"^```math\n(?P<fenced>.*?)^```$|\$\$(?P<block>.+?)\$\$"
INLINE = r"\$(?P<inline>[^$\n]+)\$"
PARTS = re.compile(f"{CODE}|{BLOCK}|{INLINE}", re.MULTILINE | re.DOTALL)


def rendered(part: re.Match[str]) -> str:
    """Code as it is, an equation as MathML."""
    if inline := part["inline"]:
        return f"<span>{convert(inline.strip(), display='inline')}</span>"  # bare, it would end a paragraph
    if block := part["fenced"] or part["block"]:
        return f'<div class="equation">{convert(block.strip(), display="block")}</div>'
    return part[0]


def on_page_markdown(markdown: str, **_: object) -> str:
    """Replace each equation of a page."""
    return PARTS.sub(rendered, markdown)
