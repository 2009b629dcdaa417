"""Appends a table of every output to the page of outputs, from the registry, so that none can be missing."""

from eclsim.cases.sections import MEASURED
from eclsim.reporting.output_catalogue import EVERY_CASE, OutputEntry, output_catalogue

PAGE = "outputs.md"
HEAD = ["| name | meaning | unit | definition | place |", "|---|---|---|---|---|"]


def tables() -> str:
    """One section for each combination of sections of a case file that outputs need."""
    parts = []
    for needed, entries in output_catalogue().items():
        title = "In every case" if needed == EVERY_CASE else f"With {needed}"
        parts += [f"## {_text(title)}", "", *HEAD, *map(_row, entries), ""]
    return "\n".join(parts)


def _row(entry: OutputEntry) -> str:
    measured = " [(m)](#outputs)" if entry.key in MEASURED else ""
    cells = (f"`{entry.key}`{measured}", entry.label, entry.unit, entry.definition, entry.place)
    return "| " + " | ".join([cells[0], *map(_text, cells[1:])]) + " |"


def _text(words: str) -> str:
    """Words without what Markdown would read as markup."""
    for character in "\\[]|*_<":
        words = words.replace(character, "&lt;" if character == "<" else f"\\{character}")
    return words


def on_page_markdown(markdown: str, page, **_: object) -> str:
    """Add the tables."""
    return f"{markdown}\n{tables()}" if page.file.src_uri == PAGE else markdown
