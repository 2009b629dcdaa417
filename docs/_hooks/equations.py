"""Renders ```math blocks as MathML while the site is built, so that no script has to be loaded."""

import re

from latex2mathml.converter import convert

BLOCK = re.compile(r"^```math\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Replace each block by the equation it holds."""
    return BLOCK.sub(
        lambda block: f'<div class="equation">{convert(block[1].strip(), display="block")}</div>', markdown
    )
