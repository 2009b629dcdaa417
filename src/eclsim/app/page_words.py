"""Sentences of the package in the words of the page, which has no command line."""

from __future__ import annotations

import re

from eclsim.app.texts import text, with_minus

_ADVICE = (
    (", or follow the course in time with --transient", None),
    (", or follow the course from the start with --transient", None),
    ("; see `eclsim parameters list`", None),
    ("; or weigh them by uncertainty (--weights uncertainty)", "fit_weigh"),
    (" (--weights uncertainty)", "fit_weighted"),
    ("--bounds", "fit_bounds_elsewhere"),
    (" (--posterior)", "fit_posterior_here"),
    (": see the figure pairs", "fit_loops_here"),
)
"""Advice that only the command line can follow, with the keys of the texts that replace it on the page."""
_OPTION = re.compile(r"\(--[^()]*\)|(?<!\S)--[a-z][\w-]*")


def in_page_words(sentence: str) -> str:
    """Return a sentence without options and commands of the command line, which the page does not have."""
    for advice, key in _ADVICE:
        sentence = sentence.replace(advice, text(key) if key else "")
    instead = text("fit_option_elsewhere")

    def words(match: re.Match[str]) -> str:
        return instead if match[0].startswith("(") else instead.strip("()")

    return with_minus(_OPTION.sub(words, sentence))
