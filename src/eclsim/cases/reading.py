"""Reading and writing of case files: from bytes to a checked case, with the line of each error, and back."""

from __future__ import annotations

import os
import re
import tomllib
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from eclsim.arguments import written
from eclsim.cases.case import Case
from eclsim.cases.checking import check_case
from eclsim.cases.fit_mark import read_mark
from eclsim.cases.sections import PATIENT_SECTIONS, POLICY, POLICY_KEY, Measurements, Patient
from eclsim.cases.settings import SETTING_SOURCE, keys_set, merge_settings, texts_of
from eclsim.devices.registry import parameter_of
from eclsim.files import write_text
from eclsim.inputs.files import MOST_DOTS, decoded, read_bytes, too_deep
from eclsim.inputs.mistakes import CaseError, Mistake, NumberAsWritten, shown
from eclsim.inputs.sections import CHECKED, Raw, Section

if TYPE_CHECKING:
    from tomlkit.items import AoT, Item, Table


POLICY_PLACE = "--volume-policy"
MAXIMUM_BYTES = 200_000
MOST_SLIPS = 20
_BARE_VALUE = re.compile(r"""([^=#]*=\s*)([^\s=#"'\[\]{}\\][^#"'\[\]{}\\]*?)(\s*(?:#.*)?)""")
_WORD_VALUE = re.compile(r"=\s*([A-Za-z][\w .-]*?)\s*(#.*)?$")

_HEADER = re.compile(r"\s*\[\[?\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"""\s*((?:"[^"]*"|'[^']*'|[\w-]+)(?:\s*\.\s*(?:"[^"]*"|'[^']*'|[\w-]+))*)\s*=""")
_TABLE_HEADER = re.compile(r"""\s*["']?patient_id["']?\s*[,;\t]""")
_LONG_TEXT = re.compile(r'"""|' + "'''")


@dataclass(frozen=True, slots=True)
class CaseReading:
    """A case with the remarks about its file.

    Attributes:
        case: The checked case.
        warnings: Warnings about values that were kept.
        notes: Values that were filled in, left out or overridden.
        file: Path of the file.
    """

    case: Case
    warnings: tuple[Mistake, ...]
    notes: tuple[Mistake, ...]
    file: str

    def __repr__(self) -> str:
        remarks = f"{len(self.warnings)} warnings, {len(self.notes)} notes"
        return f"<CaseReading of {self.file}: case {self.case.patient.id}, {remarks}>"


def read_case(
    path: str | os.PathLike[str], settings: Iterable[str] = (), volume_policy: str | None = None
) -> CaseReading:
    """Read and check a case file.

    Args:
        path: A TOML file in format 1.
        settings: Settings that override the file, such as "ecmo.speed_rpm=3000" or "Rmc=0.8".
        volume_policy: Blood volume policy that overrides the file's.

    Raises:
        CaseError: File or settings have errors; all are listed, each with file and line.
        TypeError: `path` is not a path.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise TypeError(f"{written(path)} is not a path; allowed: the path of a case file")
    file = os.fsdecode(path)
    settings = texts_of(settings)
    text = _text_of(file)
    raw, slips = _parse(text, file)
    merged, remarks = merge_settings(raw, settings, file)
    notes = remarks.notes
    if volume_policy is not None:
        notes += _with_policy(merged, volume_policy, file)
    reading = _checked(merged, file, lines_of_keys(text), keys_set(settings), remarks.mistakes, slips)
    case = reading.case.model_copy(update={"fit_mark": read_mark(text), "changed": bool(settings)})
    if settings and case.regulation and case.regulation.open_set_points:
        case = case.model_copy(update={"as_written": _as_written(raw)})
    doubts = (Mistake("", sentence, file=file) for sentence in case.doubts)
    return CaseReading(case, (*reading.warnings, *doubts), (*reading.notes, *notes), file)


def _as_written(raw: dict[str, Any]) -> Case | None:
    """Return the case of the file without the settings; None if it is invalid without them."""
    checked = check_case(raw)
    return None if checked.mistakes else Case.model_validate(checked.values, context=CHECKED)


def _with_policy(merged: dict[str, Any], policy: str, file: str) -> list[Mistake]:
    """Set the blood volume policy; return a note if it overrides the file's."""
    of_file = merged.get(POLICY_KEY)
    merged[POLICY_KEY] = policy
    if of_file in (None, policy):
        return []
    message = f"overrides {shown(of_file)} of {file}, with which the case may have been fitted"
    return [Mistake(POLICY_KEY, message, shown(policy), file=POLICY_PLACE)]


def read_mapping(raw: object, file: str = "", refused: Sequence[Mistake] = ()) -> CaseReading:
    """Check a case given as nested mappings, such as the values of a form.

    Args:
        raw: Sections and values as in a case file.
        file: Name of the source, for messages.
        refused: Errors in settings that are not in `raw`; they are listed with those of the case.

    Raises:
        CaseError: The case has errors; all are listed.
    """
    return _checked(raw, file, {}, set(), refused)


class EventFile(NamedTuple):
    """Events of a file, which may be a case or hold nothing else.

    Attributes:
        events: events as written.
        lines: line of each key.
        file: name of the file.
    """

    events: object
    lines: Mapping[str, int]
    file: str

    def applied_to(self, case: Case) -> CaseReading:
        """Return a case with these events in place of its own.

        Raises:
            CaseError: Events are not possible for this case; all mistakes are listed.
        """
        return _checked(case.as_mapping() | {"events": self.events}, self.file, self.lines, set(), ())


def read_events(path: str | os.PathLike[str]) -> EventFile:
    """Read the events of a file; they are checked when they are applied to a case.

    Args:
        path: A TOML file with [[events]]; other sections are not read.

    Raises:
        CaseError: The file is not valid TOML or holds no events.
    """
    file = os.fsdecode(path)
    text = _text_of(file)
    raw, slips = _parse(text, file)
    if slips:
        raise CaseError(slips)
    if not raw.get("events"):
        raise CaseError([Mistake("", "holds no [[events]]", file=file)])
    lines = {key: line for key, line in lines_of_keys(text).items() if key.startswith("events")}
    return EventFile(raw["events"], lines, file)


def _checked(
    raw: object,
    file: str,
    lines: Mapping[str, int],
    set_keys: set[str],
    refused: Sequence[Mistake],
    slips: Sequence[Mistake] = (),
) -> CaseReading:
    checked = check_case(raw)

    def placed(result: list[Mistake]) -> tuple[Mistake, ...]:
        put = [_placed(mistake, file, lines, set_keys) for mistake in result]
        return tuple(sorted(put, key=lambda mistake: mistake.line or 0))

    if refused or slips or checked.mistakes:
        raise CaseError((*refused, *_with_slips(placed(checked.mistakes), slips)))
    case = Case.model_validate(checked.values, context=CHECKED)
    return CaseReading(case, placed(checked.warnings), placed(checked.notes), file)


def _with_slips(mistakes: Sequence[Mistake], slips: Sequence[Mistake]) -> list[Mistake]:
    """Return the errors of a file with those of lines read as text of which nothing else is wrong."""
    bare = {slip.line for slip in slips}
    shown_bare = [replace(m, value=m.value.strip('"')) if m.line in bare else m for m in mistakes]
    others = [slip for slip in slips if slip.line not in {mistake.line for mistake in mistakes}]
    return sorted((*shown_bare, *others), key=lambda mistake: mistake.line or 0)


def _placed(mistake: Mistake, file: str, lines: Mapping[str, int], set_keys: set[str]) -> Mistake:
    """Return the remark with the line of its key, or else of the section that contains it."""
    parts = mistake.key.split(".")
    within = [".".join(parts[:count]) for count in range(len(parts), 0, -1)]
    section = within[1] if len(within) > 1 else within[0]
    only_set = section not in lines and any(key.startswith(f"{section}.") for key in set_keys)
    if mistake.key in set_keys or only_set:
        return mistake.at(SETTING_SOURCE, None)
    return mistake.at(file, next((lines[key] for key in within if key in lines), None))


def _text_of(file: str) -> str:
    text = decoded(read_bytes(file, MAXIMUM_BYTES, "a case file"), file)
    if _TABLE_HEADER.match(text):
        allowed = "a case file; eclsim identify TABLE.csv --out DIR writes one for each row to DIR/cases"
        raise CaseError([Mistake("", "a table of measurements", allowed=allowed, file=file)])
    if line := too_deep(text):
        message = f"more than {MOST_DOTS} dots: nested too deeply for a case file"
        raise CaseError([Mistake("", message, file=file, line=line)])
    return text


def _parse(text: str, file: str) -> tuple[dict[str, Any], list[Mistake]]:
    """Return the content of a file, and the errors of lines such as `weight_kg = 130 lb`.

    Their values are read as texts, so that the checks of a case find what is wrong with them and with others.
    """
    slips: dict[int | None, Mistake] = {}
    while True:
        try:
            return tomllib.loads(text, parse_float=NumberAsWritten), list(slips.values())
        except RecursionError:
            raise CaseError([Mistake("", "nested too deeply for a case file", file=file)]) from None
        except ValueError as error:
            mistake = _syntax_mistake(str(error), text, file)
        quoted = _with_text(text, mistake.line)
        if quoted == text or mistake.line in slips or len(slips) == MOST_SLIPS:
            slips.setdefault(mistake.line, mistake)
            raise CaseError(list(slips.values()))
        slips[mistake.line], text = mistake, quoted


def _with_text(text: str, number: int | None) -> str:
    """Return a file with the value of one line in quotes, or unchanged if the line has no such value."""
    lines = text.split("\n")
    result = _BARE_VALUE.fullmatch(lines[number - 1]) if number else None
    if result is None or number is None:
        return text
    lines[number - 1] = f'{result[1]}"{result[2]}"{result[3]}'
    return "\n".join(lines)


def _syntax_mistake(reason: str, text: str, file: str) -> Mistake:
    """Return a TOML error with its line and, for common slips, a suggested correction."""
    place = re.search(r"\(at (?:line (\d+), column \d+|(end of document))\)", reason)
    if "integer string conversion" in reason:
        return Mistake(
            "", "a whole number with thousands of digits: no quantity of a case has so many", file=file
        )
    if "Cannot overwrite a value" in reason:
        reason = reason.replace("Cannot overwrite a value", "this key already has a value, on another line")
    message = f"not valid TOML: {re.sub(r' *[(]at .*[)]$', '', reason)}"
    if place is None or place[1] is None:
        return Mistake("", message, file=file, line=text.count("\n") + 1 if place else None)
    number = int(place[1])
    lines = text.split("\n")
    written = lines[number - 1].strip() if number <= len(lines) else ""
    word = _WORD_VALUE.search(written)
    suggestion = f'{written.partition("=")[0].strip()} = "{word[1]}" (text in quotes)' if word else ""
    return Mistake(
        "", message, shown(written)[1:-1] if written else "", suggestion=suggestion, file=file, line=number
    )


def lines_of_keys(text: str) -> dict[str, int]:
    """Return the line, from 1, of each section ("patient") and key ("patient.age_years") of valid TOML.

    Tables of a list are numbered: "events[2]", "events[2].at_min".
    """
    result: dict[str, int] = {}
    section = ""
    in_long_text, tables = False, Counter[str]()
    for number, line in enumerate(text.split("\n"), start=1):
        if not in_long_text:
            if header := _HEADER.match(line):
                section = _dotted(header[1])
                result.setdefault(section, number)
                if line.lstrip().startswith("[["):
                    tables[section] += 1
                    section = f"{section}[{tables[section]}]"
                    result[section] = number
            elif key := _KEY.match(line):
                path = f"{section}.{_dotted(key[1])}" if section else _dotted(key[1])
                result.setdefault(path, number)
        if len(_LONG_TEXT.findall(line)) % 2:
            in_long_text = not in_long_text
    return result


def _dotted(name: str) -> str:
    """Remove quotes and spaces around the parts of a dotted key."""
    return ".".join(part.strip().strip("\"'") for part in name.split("."))


# --- writing --------------------------------------------------------------------------------------


def case_text(case: Case) -> str:
    """Format a case as the text of a case file, with meaning and unit in a comment on every line."""
    import tomlkit

    mapping = as_file(case)
    document = tomlkit.document()
    document["format"] = mapping["format"]
    if POLICY_KEY in mapping:
        document[POLICY_KEY] = mapping[POLICY_KEY]
        document[POLICY_KEY].comment(POLICY.description)
    for section in (Patient, Measurements, *PATIENT_SECTIONS):
        if section.section in mapping:
            document[section.section] = _table(section, mapping[section.section])
    for instance in case.instances():
        table = _table(
            instance.device.section, instance.section.model_dump(exclude_none=True, exclude_unset=True)
        )
        if not instance.name:
            document[instance.key] = table
            continue
        if instance.device.key not in document:
            document[instance.device.key] = tomlkit.table(is_super_table=True)
        document[instance.device.key][instance.name] = table
    if mapping.get("parameters"):
        document["parameters"] = _parameter_table(case.parameters, [i.key for i in case.instances()])
    if case.events:
        document["events"] = _event_tables(mapping["events"])
    return tomlkit.dumps(document)


def as_file(case: Case) -> dict[str, Any]:
    """Return the case as written to a file: what was given, as an assumed shunt would be read as known."""
    return case.as_mapping(only_given=True)


def write_case(case: Case, path: str | os.PathLike[str]) -> None:
    """Write a case file, completely or not at all; reading it gives the same case.

    Raises:
        OSError: The file cannot be written.
    """
    write_text(case_text(case), Path(path))


def _table(section: type[Section], values: Raw) -> Table:
    """Format a section, with meaning and unit in a comment on every line."""
    import tomlkit

    table = tomlkit.table()
    for name, item in section.fields().items():
        if name in values:
            written = _toml_value(values[name])
            table.add(name, written)
            written.comment(f"{item.description}{f' [{item.unit}]' if item.unit not in ('', '1') else ''}")
    return table


def _parameter_table(values: dict[str, float], connected: Collection[str]) -> Table:
    import tomlkit

    table = tomlkit.table()
    for key, value in values.items():
        parameter = parameter_of(key, connected)
        assert parameter is not None  # the case was checked
        table[key] = _toml_value(value)
        table[key].comment(f"{parameter.description} [{parameter.unit}]")
    return table


def _event_tables(events: Sequence[Raw]) -> AoT:
    import tomlkit

    tables = tomlkit.aot()
    for event in events:
        table = tomlkit.table()
        for key, value in event.items():
            table[key] = _toml_value(value)
        tables.append(table)
    return tables


def _toml_value(value: object) -> Item:
    import tomlkit

    if isinstance(value, dict):
        inline = tomlkit.inline_table()
        inline.update(value)
        return inline
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return tomlkit.item(int(value))
    return tomlkit.item(value)
