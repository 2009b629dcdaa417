"""Reading case files: from bytes to a checked case, with the line of every mistake."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from eclsim.patients.checking import check_case
from eclsim.patients.lines import lines_of_keys
from eclsim.patients.mistakes import CaseError, Mistake, NumberAsWritten, shown
from eclsim.patients.settings import PLACE, merge_settings, parse_settings

if TYPE_CHECKING:
    from eclsim.patients.case import Case

MAXIMUM_BYTES = 1_000_000
_COMMA_VALUE = re.compile(r"=\s*([+-]?\d+),(\d+)\s*(#.*)?$")
_SLASH_VALUE = re.compile(r"=\s*(\d+)\s*/\s*(\d+)\s*(#.*)?$")
_UNIT_VALUE = re.compile(r"=\s*([+-]?\d[\d.]*)\s*([^\s\d#][^#]*?)\s*(#.*)?$")
_WORD_VALUE = re.compile(r"=\s*([A-Za-z][\w .-]*?)\s*(#.*)?$")


@dataclass(frozen=True, slots=True)
class CaseReading:
    """A case and what there was to say about its file.

    Attributes:
        case: The checked case.
        warnings: Doubts about values that were kept.
        notes: What was filled in, left out or overridden.
        file: Where it was read.
    """

    case: Case
    warnings: tuple[Mistake, ...]
    notes: tuple[Mistake, ...]
    file: str


def read_case(path: str | os.PathLike[str], settings: Iterable[str] = ()) -> CaseReading:
    """Read and check a case file.

    Args:
        path: A TOML file in format 1.
        settings: Values that win over the file's, such as "ecmo.speed_rpm=3000" or "Rmc=0.8".

    Raises:
        CaseError: With everything that is wrong with file and settings, each with file and line.
    """
    file = os.fsdecode(path)
    settings = list(settings)
    text = _text_of(file)
    raw = _parse(text, file)
    merged, notes = merge_settings(raw, settings, file)
    set_keys = {f"{section}.{key}" for section, key in parse_settings(settings)}
    reading = _checked(merged, file, lines_of_keys(text), set_keys)
    return CaseReading(reading.case, reading.warnings, (*reading.notes, *notes), file)


def read_mapping(raw: Any, file: str = "") -> CaseReading:
    """Check a case given as nested mappings, such as a form's values.

    Args:
        raw: Sections and values as a case file holds them.
        file: What messages call the place where it came from.

    Raises:
        CaseError: With everything that is wrong.
    """
    return _checked(raw, file, {}, set())


def _checked(raw: Any, file: str, lines: Mapping[str, int], set_keys: set[str]) -> CaseReading:
    checked = check_case(raw)

    def placed(found: list[Mistake]) -> tuple[Mistake, ...]:
        put = [_placed(mistake, file, lines, set_keys) for mistake in found]
        return tuple(sorted(put, key=lambda mistake: mistake.line or 0))

    if checked.mistakes:
        raise CaseError(placed(checked.mistakes))
    from eclsim.patients.case import Case

    return CaseReading(
        Case.model_validate(checked.values), placed(checked.warnings), placed(checked.notes), file
    )


def _placed(mistake: Mistake, file: str, lines: Mapping[str, int], set_keys: set[str]) -> Mistake:
    section = mistake.key.partition(".")[0]
    only_set = section not in lines and any(key.startswith(f"{section}.") for key in set_keys)
    if mistake.key in set_keys or only_set:
        return mistake.at(PLACE, None)
    return mistake.at(file, lines.get(mistake.key) or lines.get(section))


def _text_of(file: str) -> str:
    try:
        with open(file, "rb") as handle:
            data = handle.read(MAXIMUM_BYTES + 1)
    except (OSError, ValueError) as error:
        raise CaseError([Mistake("", _reason(error), file=_printable(file))]) from None
    if len(data) > MAXIMUM_BYTES:
        raise CaseError([Mistake("", "too large for a case file", allowed="1 MB at most", file=file)])
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise CaseError([Mistake("", "encoded as UTF-16", allowed="text in UTF-8", file=file)])
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        message = f"not UTF-8: byte 0x{data[error.start]:02x} (Latin-1 or Windows-1252?)"
        raise CaseError([Mistake("", message, allowed="text in UTF-8", file=file, line=line)]) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _reason(error: Exception) -> str:
    reasons = {
        FileNotFoundError: "no such file",
        IsADirectoryError: "a folder, not a case file",
        PermissionError: "no permission to read it",
    }
    if isinstance(error, OSError):
        return reasons.get(type(error), f"cannot be read: {error.strerror or error}")
    return f"no path: {error}"


def _printable(file: str) -> str:
    return file if file.isprintable() else file.encode("unicode_escape").decode("ascii")


def _parse(text: str, file: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text, parse_float=NumberAsWritten)
    except RecursionError:
        raise CaseError([Mistake("", "nested too deeply for a case file", file=file)]) from None
    except ValueError as error:
        raise CaseError([_syntax_mistake(str(error), text, file)]) from None


def _syntax_mistake(said: str, text: str, file: str) -> Mistake:
    """A TOML error with its line and, for the usual slips, what was meant."""
    place = re.search(r"\(at (?:line (\d+), column \d+|(end of document))\)", said)
    if "integer string conversion" in said:
        return Mistake(
            "", "a whole number of thousands of digits: no quantity of a case has so many", file=file
        )
    message = f"no valid TOML: {re.sub(r' *[(]at .*[)]$', '', said)}"
    if place is None or place[1] is None:
        return Mistake("", message, file=file, line=text.count("\n") + 1 if place else None)
    number = int(place[1])
    lines = text.split("\n")
    written = lines[number - 1].strip() if number <= len(lines) else ""
    meant = _meant(written)
    return Mistake(
        "", message, shown(written)[1:-1] if written else "", suggestion=meant, file=file, line=number
    )


def _meant(written: str) -> str:
    key = written.partition("=")[0].strip()
    if found := _COMMA_VALUE.search(written):
        return f"{key} = {found[1]}.{found[2]} (a decimal point)"
    if found := _SLASH_VALUE.search(written):
        return f"SP = {found[1]} and DP = {found[2]} on two lines"
    if found := _UNIT_VALUE.search(written):
        return f"{key} = {found[1]} (a number without a unit)"
    if found := _WORD_VALUE.search(written):
        return f'{key} = "{found[1]}" (text in quotes)'
    return ""
