"""Mistakes in an input, with the information needed to correct them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from eclsim.arguments import article


@dataclass(frozen=True, slots=True)
class Mistake:
    """One remark about one key of an input: an error, a warning or a note.

    Attributes:
        key: Dotted name of the field ("patient.age_years"); empty for a remark about the whole file.
        message: Description of the problem.
        value: Value as written, as text; empty if there was none.
        allowed: Allowed values; empty if the message states them.
        suggestion: Nearest correct spelling or value; empty if there is none.
        file: Source of the value, such as a path or "--set".
        line: Line in the file, counted from 1; None if unknown.
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
        """Return the same remark with its place in a file."""
        return replace(self, file=file, line=line)


class CaseError(ValueError):
    """An input that cannot be used; `mistakes` holds all errors found in it, in file order."""

    def __init__(self, mistakes: Sequence[Mistake]):
        self.mistakes = tuple(mistakes)
        super().__init__("\n".join(str(mistake) for mistake in self.mistakes))


class ListedError(ValueError):
    """An input that cannot be used; the message has one line for each of its `mistakes`."""

    def __init__(self, mistakes: Sequence[str]):
        self.mistakes = tuple(mistakes)
        super().__init__("\n".join(mistakes))


class InputError(ListedError):
    """Raised for inputs and uncertainties of a study that a case cannot have."""


@dataclass(slots=True)
class Remarks:
    """Collection of errors, warnings and notes about an input, so that one error does not hide another.

    Attributes:
        mistakes: Errors; with any of them the input must not be used.
        warnings: Warnings; the input is used.
        notes: Values that were filled in, converted or left out.
    """

    mistakes: list[Mistake] = field(default_factory=list)
    warnings: list[Mistake] = field(default_factory=list)
    notes: list[Mistake] = field(default_factory=list)

    def error(
        self, key: str, message: str, value: str = "", allowed: str = "", suggestion: str = "",
        line: int | None = None,
    ) -> None:  # fmt: skip
        """Add an error; the arguments are those of `Mistake`."""
        self.mistakes.append(Mistake(key, message, value, allowed, suggestion, line=line))

    def warning(
        self, key: str, message: str, value: str = "", suggestion: str = "", line: int | None = None
    ) -> None:
        """Add a warning."""
        self.warnings.append(Mistake(key, message, value, suggestion=suggestion, line=line))

    def note(self, key: str, message: str, value: str = "", line: int | None = None) -> None:
        """Add a note."""
        self.notes.append(Mistake(key, message, value, line=line))

    def refused(self) -> set[str]:
        """Return the keys given with a wrong value, so that they are not also reported as missing."""
        return {mistake.key for mistake in self.mistakes}

    def raise_mistakes(self) -> None:
        """Raise `CaseError` with all errors if there are any."""
        if self.mistakes:
            raise CaseError(self.mistakes)


class NumberAsWritten(float):
    """A number that keeps its digits as written, so that 1e400 and 1e-400 can be told from inf and 0."""

    text: str

    def __new__(cls, text: str) -> NumberAsWritten:
        """Convert the digits to a float; overflow gives inf, underflow 0."""
        number = super().__new__(cls, text)
        number.text = text
        return number


class WithoutQuotes(str):
    """A text written without quotes, as in an option, which messages repeat as it was written."""

    __slots__ = ()


def shown(value: object) -> str:
    """Format a value for a message: short, on one line, text in quotes."""
    match value:
        case NumberAsWritten():
            text = value.text
        case bool():
            text = str(value).lower()
        case float():
            text = f"{value:.12g}"
        case int() if value.bit_length() > 200:
            text = "an integer of more than 60 digits"
        case WithoutQuotes() if value.isprintable():
            text = str(value)
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
    """Return names as a tuple; a single string is one name.

    Args:
        given: names.
        what: name of the argument, for messages.

    Raises:
        TypeError: An entry is not a string.
    """
    names = (given,) if isinstance(given, str) else tuple(given) if isinstance(given, Iterable) else (given,)
    for name in names:
        if not isinstance(name, str):
            example = '["Rmc", "Emaxlv"]' if what == "parameters" else '["MAP", "CO"]'
            raise TypeError(f"{what}: {shown(name)} is not a name; allowed: names such as {example}")
    return names


Settings = TypeVar("Settings")


def as_settings(given: Settings | None, kind: type[Settings], what: str = "settings") -> Settings:
    """Return the given settings, or the default ones.

    Args:
        given: settings; None for the defaults.
        kind: class of the settings.
        what: name of the argument, for messages.

    Raises:
        TypeError: The settings are of another type, such as a dict.
    """
    if given is None:
        return kind()
    if isinstance(given, kind):
        return given
    raise TypeError(
        f"{what}: {article(type(given).__name__)} is not {article(kind.__name__)}; allowed: "
        f"eclsim.{kind.__name__}(...), whose arguments are the {what if what == 'options' else 'settings'}"
    )
