"""Explains abbreviations of the glossary in a tooltip wherever a page uses them."""

import re
from functools import cache
from pathlib import Path

GLOSSARY = Path(__file__).parents[1] / "glossary.md"
ENTRY = re.compile(r"^(?P<terms>\S.*)\n:   (?P<words>(?:.+\n)(?:    .+\n)*)", re.MULTILINE)
ABBREVIATION = re.compile(r"[A-Z][A-Za-z]*[A-Z][A-Za-z0-9]*")


@cache
def abbreviations() -> dict[str, str]:
    """Abbreviations that are explained by themselves, with their sentence."""
    entries = ENTRY.findall(GLOSSARY.read_text(encoding="utf-8"))
    return {
        terms: " ".join(re.sub(r"\[([^]]*)\]\([^)]*\)|`", r"\1", words).split())
        for terms, words in entries
        if ABBREVIATION.fullmatch(terms)
    }


def on_page_markdown(markdown: str, page, **_: object) -> str:
    """Append the definitions of the abbreviations that the page contains."""
    if page.file.src_uri == GLOSSARY.name:
        return markdown
    used = (
        f"*[{short}]: {words}"
        for short, words in abbreviations().items()
        if re.search(rf"\b{re.escape(short)}\b", markdown)
    )
    return "\n".join([markdown, "", *used, ""])
