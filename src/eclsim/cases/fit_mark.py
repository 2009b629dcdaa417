"""Verdict of a case file on the fit that gave its parameters, stored in comments in its first lines.

Other programs may ignore the comments. A checksum in the mark shows whether patient, measurements, devices or
parameters have changed since the fit, as the verdict applies only to what was fitted.
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
_CHECKSUM = "checksum of the fitted case: "
_MARK = re.compile(
    rf"# eclsim identify: ({'|'.join(LEVELS)}) fit \((?:{_CHECKSUM}|of what has the mark )([0-9a-f]{{8}})\)"
)
"""First line of a fitted case, also in the words of files that were written before December 2026."""
DOUBTS = "doubts"
"""Column with the reason why no number of a table can be trusted; present only if there is such a reason."""
POSTERIOR = "posterior: "
"""Prefix of a result's warnings about the posterior from which it was computed."""
NOT_STUDIED = "studies leave such a fit out"
_HEAD = 40
"""Number of lines in which a mark is searched for."""


@dataclass(frozen=True)
class FitMark:
    """Verdict on a fit, as stored in a case file.

    Attributes:
        level: "good", "doubtful" or "poor".
        is_changed: whether the fitted parameters or the data of the fit have changed since.
    """

    level: str
    is_changed: bool

    @property
    def sentence(self) -> str:
        """The verdict as a sentence."""
        changed = "; the file was changed since it was fitted" if self.is_changed else ""
        return _WORDS[self.level] + changed

    @property
    def refusal(self) -> str:
        """Reason why studies of many patients exclude this one; empty if they include it."""
        return f"{self.sentence}; {NOT_STUDIED}" if self.level == "poor" else ""


def untrusted(sentences: Iterable[object]) -> list[str]:
    """Return the warnings that make all numbers of a result doubtful: those on its fit or posterior."""
    return [text for text in map(str, sentences) if text.startswith((*_WORDS.values(), POSTERIOR))]


def with_doubts(table: pd.DataFrame, sentences: Iterable[object]) -> pd.DataFrame:
    """Add the column `DOUBTS` to a table if a result's warnings make all its numbers doubtful."""
    doubts = "; ".join(untrusted(sentences))
    return table.assign(**{DOUBTS: doubts}) if doubts else table


def with_mark(text: str, level: str, headline: str) -> str:
    """Return a case file that begins with the verdict on its fit.

    Args:
        text: text of the case file.
        level: level of the verdict.
        headline: the verdict in one sentence.
    """
    headline = " ".join(headline.split())
    return f"# eclsim identify: {level} fit ({_CHECKSUM}{_digest(text)})\n# {headline}\n{text}"


def read_mark(text: str) -> FitMark | None:
    """Return the mark of a valid case file; None if it has none."""
    for line in text.splitlines()[:_HEAD]:
        if not line.startswith("#"):
            return None
        if match := _MARK.fullmatch(line.strip()):
            return FitMark(match[1], match[2] != _digest(text))
    return None


def _digest(text: str) -> str:
    """Return a digest of all that a fit depends on; comments, events and the patient's id are excluded."""
    content = tomllib.loads(text)
    content.pop("events", None)
    patient = {key: value for key, value in content.get("patient", {}).items() if key != "id"}
    plain = json.dumps(content | {"patient": patient}, sort_keys=True, default=str)
    return f"{zlib.crc32(plain.encode()):08x}"
