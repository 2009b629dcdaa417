"""Mistakes in an input, with what is needed to correct them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from eclsim.arguments import article


@dataclass(frozen=True, slots=True)
class Mistake:
    """One thing to say about one key of an input: an error, a warning or a note.

    Attributes:
        key: Dotted name of the field ("patient.age_years"), empty where the whole file is meant.
        message: What is wrong.
        value: What was written, as text; empty where nothing was.
        allowed: What is allowed, empty where the message has it.
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

    def __init__(self, mistakes: Sequence[Mistake]):
        self.mistakes = tuple(mistakes)
        super().__init__("\n".join(str(mistake) for mistake in self.mistakes))


@dataclass(slots=True)
class Remarks:
    """Collects mistakes, warnings and notes about an input, so that one mistake does not hide another.

    Attributes:
        mistakes: Errors; with any of them the input must not be used.
        warnings: Doubts; the input is used.
        notes: What was filled in, converted or left out.
    """

    mistakes: list[Mistake] = field(default_factory=list)
    warnings: list[Mistake] = field(default_factory=list)
    notes: list[Mistake] = field(default_factory=list)

    def error(
        self, key: str, message: str, value: str = "", allowed: str = "", suggestion: str = "",
        line: int | None = None,
    ) -> None:  # fmt: skip
        """Add a mistake; the arguments are those of `Mistake`."""
        self.mistakes.append(Mistake(key, message, value, allowed, suggestion, line=line))

    def warning(
        self, key: str, message: str, value: str = "", suggestion: str = "", line: int | None = None
    ) -> None:
        """Add a doubt."""
        self.warnings.append(Mistake(key, message, value, suggestion=suggestion, line=line))

    def note(self, key: str, message: str, value: str = "", line: int | None = None) -> None:
        """Add a note."""
        self.notes.append(Mistake(key, message, value, line=line))

    def refused(self) -> set[str]:
        """Keys that were given with a wrong value, so that they are not missing."""
        return {mistake.key for mistake in self.mistakes}

    def raise_mistakes(self) -> None:
        """Raise `CaseError` with all mistakes if there are any."""
        if self.mistakes:
            raise CaseError(self.mistakes)


class NumberAsWritten(float):
    """A number that remembers its digits, so that 1e400 and 1e-400 differ from inf and 0."""

    text: str

    def __new__(cls, text: str) -> NumberAsWritten:
        """Read the digits; too large gives inf, too small 0."""
        number = super().__new__(cls, text)
        number.text = text
        return number


def shown(value: object) -> str:
    """A value as it stands in messages: short, on one line, text in quotes."""
    match value:
        case NumberAsWritten():
            text = value.text
        case bool():
            text = str(value).lower()
        case float():
            text = f"{value:.12g}"
        case int() if value.bit_length() > 200:
            text = "an integer of more than 60 digits"
        case str() if not value.isprintable():
            text = '"' + value[:200].encode("unicode_escape").decode("ascii") + '"'
        case str():
            text = f'"{value}"'
        case list():
            text = f"[a list of {len(value)}]"
        case dict():
            text = "{" + ", ".join(str(key) for key in list(value)[:5]) + "}"
        case _:
            text = str(value)
    return text if len(text) <= 80 else text[:76] + " ..."


def as_names(given: Sequence[str], what: str) -> tuple[str, ...]:
    """Names as a tuple; one text is one name.

    Args:
        given: names.
        what: the argument is called.

    Raises:
        TypeError: It is no list of texts.
    """
    names = (given,) if isinstance(given, str) else tuple(given) if isinstance(given, Iterable) else (given,)
    for name in names:
        if not isinstance(name, str):
            raise TypeError(f'{what}: {shown(name)} is no name; allowed: names such as ["MAP", "CO"]')
    return names


Settings = TypeVar("Settings")


def as_settings(given: Settings | None, kind: type[Settings], what: str = "settings") -> Settings:
    """The settings given, or the usual ones.

    Args:
        given: settings; None for the usual ones.
        kind: class of them.
        what: the argument is called.

    Raises:
        TypeError: Of another kind, such as a dict.
    """
    if given is None:
        return kind()
    if isinstance(given, kind):
        return given
    raise TypeError(
        f"{what}: {article(type(given).__name__)} is no {kind.__name__}; allowed: "
        f"eclsim.{kind.__name__}(...), "
        f"whose arguments are the {what if what == 'options' else 'settings'}"
    )
