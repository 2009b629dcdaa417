"""Options of the command line that name their values, such as "Rmc=0.1:2,Csart=0.5:5"."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple


class NamedText(NamedTuple):
    """A part of an option.

    Attributes:
        name: what stands before the first equals sign.
        text: what stands after it; empty if there is none.
        written: the whole part, for messages.
    """

    name: str
    text: str
    written: str

    @property
    def twice(self) -> str:
        """End of a message about a part whose name an earlier part has."""
        return f"{self.name} is given twice; leave one of them out"


def named_texts(texts: Iterable[str]) -> Iterator[NamedText]:
    """Yield the parts of an option, which are separated by commas; spaces and empty parts are left out.

    Args:
        texts: the option as written, once for each time that it was given.
    """
    for written in (part.strip() for given in texts for part in given.split(",") if part.strip()):
        name, _, text = (side.strip() for side in written.partition("="))
        yield NamedText(name, text, written)
