"""What is wrong with an input, said so that it can be put right."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True, slots=True)
class Mistake:
    """One thing to say about one key of an input: an error, a warning or a note.

    Attributes:
        key: Dotted name of the field ("patient.age_years"), empty where the whole file is meant.
        message: What is wrong.
        value: What was written, as text; empty where nothing was.
        allowed: What is allowed, empty where that is said already.
        suggestion: The nearest right spelling or value, or empty.
        file: Where it was read, such as a path or "--set".
        line: Line in the file, counted from 1, where known.
    """

    key: str
    message: str
    value: str = ""
    allowed: str = ""
    suggestion: str = ""
    file: str = ""
    line: int | None = None

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.file and self.line else self.file
        subject = f"{self.key} = {self.value}" if self.key and self.value else self.key or self.value
        text = ": ".join(part for part in (place, subject, self.message) if part)
        if self.allowed:
            text += f"; allowed: {self.allowed}"
        if self.suggestion:
            text += f"; did you mean {self.suggestion}?"
        return text

    def at(self, file: str, line: int | None) -> Mistake:
        """The same with its place in a file."""
        return replace(self, file=file, line=line)


class CaseError(ValueError):
    """An input that cannot be used; `mistakes` holds everything wrong with it, in file order."""

    def __init__(self, mistakes: list[Mistake] | tuple[Mistake, ...]):
        self.mistakes = tuple(mistakes)
        super().__init__("\n".join(str(mistake) for mistake in self.mistakes))


class NumberAsWritten(float):
    """A number that remembers its digits, so that 1e400 and 1e-400 can be told from inf and 0."""

    text: str

    def __new__(cls, text: str) -> NumberAsWritten:
        """Read the digits; too large gives inf, too small 0."""
        number = super().__new__(cls, text)
        number.text = text
        return number


def shown(value: Any) -> str:
    """A value as it stands in messages: short, on one line, text in quotes."""
    if isinstance(value, NumberAsWritten):
        text = value.text
    elif isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, float):
        text = f"{value:.12g}"
    elif isinstance(value, int) and value.bit_length() > 200:
        text = "an integer of more than 60 digits"
    elif isinstance(value, str):
        text = (
            '"' + value[:200].encode("unicode_escape").decode("ascii") + '"'
            if _unprintable(value)
            else f'"{value}"'
        )
    else:
        text = str(value) if not isinstance(value, (list, dict)) else _container(value)
    return text if len(text) <= 80 else text[:76] + " ..."


def _unprintable(text: str) -> bool:
    return not text.isprintable()


def _container(value: list[Any] | dict[str, Any]) -> str:
    if isinstance(value, list):
        return f"[a list of {len(value)}]"
    return "{" + ", ".join(str(key) for key in list(value)[:5]) + "}"
