"""The texts of the page, from `english.toml`, and how numbers and mistakes are written."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from eclsim.inputs.mistakes import Mistake

ENGLISH: Mapping[str, str] = MappingProxyType(
    tomllib.loads((Path(__file__).parent / "english.toml").read_text(encoding="utf-8"))
)

_MINUS = re.compile(r"(?<![\w.)-])-(?=\d)")


def with_minus(sentence: str) -> str:
    """Replace the hyphens before negative numbers in a sentence by minus signs, as the page writes them."""
    return _MINUS.sub("\N{MINUS SIGN}", sentence)


def beside_field(mistake: Mistake) -> str:
    """Return a mistake as shown beside its knob or field, without the key and what only a file can have."""
    sentence = str(replace(mistake, key="", file="", line=None))
    return with_minus(sentence.replace("; a number is needed where the key is written", ""))


def text(key: str, **values: object) -> str:
    """Return the text of a key, with values inserted."""
    return ENGLISH[key].format(**values) if values else ENGLISH[key]


# --- sentences of the package ---------------------------------------------------------------------


_ADVICE = (
    (", or follow the course in time with --transient", None),
    (", or follow the course from the start with --transient", None),
    (" (see `eclsim parameters list`)", None),
    ("; or weigh them by uncertainty (--weights uncertainty)", "fit_weigh"),
    (" (--weights uncertainty)", "fit_weighted"),
    ("--bounds", "fit_bounds_elsewhere"),
    ("(--steady-only)", "timeline_steady_only"),
    (" (--posterior)", "fit_posterior_here"),
    (": see the figure pairs", "fit_loops_here"),
    ("repeat it with another seed (--seed)", "fit_seed_elsewhere"),
    ("free fewer parameters", "fit_fewer_elsewhere"),
)
"""Advice that only the command line can follow, with the keys of the texts that replace it on the page."""
_COMMAND = r"eclsim identify CASE\.toml[^;()]*"
"""A whole command, which those texts contain, stays."""
_OPTION = re.compile(
    "|".join([_COMMAND, *(re.escape(advice) for advice, _ in _ADVICE), r"\(--[^()]*\)|(?<!\S)--[a-z][\w-]*"])
)


def in_page_words(sentence: str) -> str:
    """Return a sentence without options and commands of the command line, which the page does not have."""
    advice, instead = dict(_ADVICE), text("fit_option_elsewhere")

    def words(match: re.Match[str]) -> str:
        if match[0] in advice:
            return text(key) if (key := advice[match[0]]) else ""
        if match[0].startswith("eclsim"):
            return match[0]
        return instead if match[0].startswith("(") else instead.strip("()")

    return with_minus(_OPTION.sub(words, sentence))


_NAMES = {
    key.removeprefix("parameters."): label for key, label in ENGLISH.items() if key[:11] == "parameters."
}
_NAME = re.compile(rf"\b({'|'.join(map(re.escape, _NAMES))})\b")


def in_knob_labels(sentence: str) -> str:
    """Return a sentence with the labels of knobs in place of their names in case files, such as Emaxlv."""
    return _NAME.sub(lambda match: _NAMES[match[0]], sentence)
