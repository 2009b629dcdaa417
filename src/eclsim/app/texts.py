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
    """Return a mistake as shown beside its knob or field, without the key."""
    return with_minus(str(replace(mistake, key="", file="", line=None)))


def text(key: str, **values: object) -> str:
    """Return the text of a key, with values inserted."""
    return ENGLISH[key].format(**values) if values else ENGLISH[key]
