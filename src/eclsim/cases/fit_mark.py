"""Verdict of a case file on the fit that gave its parameters: comments in its first lines.

Whoever reads the file may ignore them. A number in the mark tells whether patient, measurements, devices or
parameters were changed since: the verdict is on what was fitted.
"""

from __future__ import annotations

import json
import re
import tomllib
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

_WORDS = {
    "good": "its parameters were fitted by eclsim identify: a good fit",
    "doubtful": "its parameters are a DOUBTFUL fit of eclsim identify: see why in its report",
    "poor": "its parameters are a POOR fit of eclsim identify: not to be used",
}
LEVELS = tuple(_WORDS)
_MARK = re.compile(rf"# eclsim identify: ({'|'.join(LEVELS)}) fit \(of what has the mark ([0-9a-f]{{8}})\)")
DOUBTS = "doubts"
"""Column with the reason why no number of a table is to be trusted; only where there is one."""
POSTERIOR = "posterior: "
"""Begins a result's warnings of the posterior whose draws it is computed from."""
NOT_STUDIED = "nothing is studied of such a fit"
_HEAD = 40
"""Lines in which a mark is looked for."""


@dataclass(frozen=True)
class FitMark:
    """The verdict on a fit as a case file has it.

    Attributes:
        level: "good", "doubtful" or "poor".
        is_changed: whether what was fitted, or what it was fitted with, was changed since.
    """

    level: str
    is_changed: bool

    @property
    def sentence(self) -> str:
        """In words."""
        changed = "; the file was changed since it was fitted" if self.is_changed else ""
        return _WORDS[self.level] + changed

    @property
    def refusal(self) -> str:
        """Why studies of many leave such a patient out; empty where they do not."""
        return f"{self.sentence}; {NOT_STUDIED}" if self.level == "poor" else ""


def untrusted(sentences: Iterable[object]) -> list[str]:
    """Warnings of a result that make all its numbers doubtful: those of its fit or its posterior."""
    return [text for text in map(str, sentences) if text.startswith((*_WORDS.values(), POSTERIOR))]


def with_doubts(table: pd.DataFrame, sentences: Iterable[object]) -> pd.DataFrame:
    """A table with the column `DOUBTS`, where a result's warnings say that none of its numbers is trusted."""
    doubts = "; ".join(untrusted(sentences))
    return table.assign(**{DOUBTS: doubts}) if doubts else table


def with_mark(text: str, level: str, headline: str) -> str:
    """A case file that begins with the verdict on its fit.

    Args:
        text: of the case file.
        level: of the verdict.
        headline: the verdict in one sentence.
    """
    headline = " ".join(headline.split())
    return f"# eclsim identify: {level} fit (of what has the mark {_digest(text)})\n# {headline}\n{text}"


def read_mark(text: str) -> FitMark | None:
    """The mark of a valid case file; None where it has none."""
    for line in text.splitlines()[:_HEAD]:
        if not line.startswith("#"):
            return None
        if match := _MARK.fullmatch(line.strip()):
            return FitMark(match[1], match[2] != _digest(text))
    return None


def _digest(text: str) -> str:
    """Digest of all that a fit depends on: neither comments nor events nor the patient's id."""
    content = tomllib.loads(text)
    content.pop("events", None)
    patient = {key: value for key, value in content.get("patient", {}).items() if key != "id"}
    plain = json.dumps(content | {"patient": patient}, sort_keys=True, default=str)
    return f"{zlib.crc32(plain.encode()):08x}"
