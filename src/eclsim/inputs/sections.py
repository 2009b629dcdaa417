"""Sections of a case file: pydantic models whose annotations describe the values allowed for each key."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, ValidationInfo, model_validator

from eclsim.inputs.fields import Field, setting
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.numbers import RefusedValueError, is_missing, is_number, read_number
from eclsim.parameters import Parameter
from eclsim.spelling import did_you_mean

MAXIMUM_ID_LENGTH = 64
CHECKED = {"checked": True}
"""Validation context for data that are already checked."""
Raw = Mapping[str, Any]
"""Keys and values as in a case file."""

_BIRTH_DATE = re.compile(r"(19|20)\d\d[-./ ]?\d\d[-./ ]?\d\d|\d{1,2}[-./]\d{1,2}[-./](19|20)?\d\d")
_RECORD_NUMBER = re.compile(r"\d{6,}")
_WORD = r"[^\W\d_]{2,}(?:['-][^\W\d_]+)*"
_PERSON = re.compile(rf"{_WORD},\s*{_WORD}|[A-ZÀ-Þ]\w+\s+[A-ZÀ-Þ]\w+|[A-Z]\.\s*[A-ZÀ-Þ]\w+")
_MARKS = "not fitted|fitted|doubtful fit|poor fit|fit without a verdict|central draw"
_MARK = re.compile(rf" \((?:(?:{_MARKS})(?:, changed)?|changed)\)$")
"""Mark that the page adds to an id in files; its comma is not that between surname and first name."""
_LONGEST_CHECKED_TEXT = 100
NOT_FITTED = "not measured, so not fitted"
"""Note on a measurement that is written as missing."""


class Section(BaseModel):
    """A section of a case file.

    Each attribute is annotated with its `Field`, as in

        speed_rpm: Annotated[float, number("Speed", "rpm", 0, 15000, typical=5000)]

    or takes the description of the parameter of the same name, such as "gas.fio2" for `fio2` of [gas]. A key
    with a default, as in `= 5000`, may be left out.

    Creating an instance runs the checks of a case file.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    section: ClassVar[str]
    """Name of the section in a case file."""
    parameters: ClassVar[Mapping[str, Parameter]] = {}
    """Parameters that describe the attributes without a `Field`, by key."""
    exclusive: ClassVar[tuple[tuple[str, str], ...]] = ()
    """Pairs of mutually exclusive keys: setting one removes the other."""
    second: ClassVar[str] = ""
    """What to do for a second one where a case has one at most, after "one such section"; may be empty."""

    @classmethod
    def fields(cls) -> Mapping[str, Field]:
        """Return the fields by key, in the order in which they are written."""
        return _fields(cls)

    @classmethod
    def complete(cls, raw: Raw, values: dict[str, Any], key: str, remarks: Remarks) -> None:
        """Fill in values that follow from other keys, and check what depends on several keys.

        Args:
            raw: values as given.
            values: the valid ones of these values; values that are filled in are added.
            key: key of the section, such as "ecmo" or "ecmo.left".
            remarks: collects errors, warnings and notes.
        """

    @classmethod
    def check(cls, sections: Mapping[str, Raw], remarks: Remarks) -> None:
        """Check that the section agrees with the other sections; called even if the case lacks this section.

        Args:
            sections: valid values of each section of the case, by section key.
            remarks: collects errors, warnings and notes.
        """

    @model_validator(mode="before")
    @classmethod
    def _check(cls, data: object, info: ValidationInfo) -> object:
        if not isinstance(data, dict) or info.context == CHECKED:
            return data
        remarks = Remarks()
        values = check_section(cls, plain(data), cls.section, remarks)
        remarks.raise_mistakes()
        return values


@cache
def _fields(section: type[Section]) -> Mapping[str, Field]:
    result = {}
    for name, info in section.model_fields.items():
        entry = next((item for item in info.metadata if isinstance(item, Field)), None)
        found = entry or _parameter_field(section, name)
        result[name] = replace(found, name=name, required=found.required and info.is_required())
    return result


def _parameter_field(section: type[Section], name: str) -> Field:
    parameter = section.parameters.get(f"{section.section}.{name}")
    if parameter is None:
        raise ValueError(f"{section.__name__}.{name} has no Field")
    return setting(parameter)


def plain(data: Raw) -> dict[str, Any]:
    """Convert models in a mapping to mappings, and drop keys whose value is None."""
    dumped = {
        key: value.model_dump(exclude_none=True) if isinstance(value, BaseModel) else value
        for key, value in data.items()
    }
    return {key: value for key, value in dumped.items() if value is not None}


def check_section(
    section: type[Section],
    raw: object,
    key: str,
    remarks: Remarks,
    other_place: Callable[[str], str] = lambda key: "",
    several: bool = False,
) -> dict[str, Any]:
    """Check the fields of one section one by one, then fill in values that follow from others.

    Args:
        section: class of the section.
        raw: section as given.
        key: key of the section in the case file.
        remarks: collects errors, warnings and notes.
        other_place: returns the other sections in which a key belongs, as text; empty for none.
        several: whether a case may have several of these sections, each with a name.

    Returns:
        The valid values.
    """
    values: dict[str, Any] = {}
    if not isinstance(raw, Mapping):
        _refuse_section(key, raw, section.second, remarks)
        return values
    fields = section.fields()
    for name, value in raw.items():
        if name in fields:
            check_field(f"{key}.{name}", value, fields[name], values, remarks)
        elif isinstance(value, Mapping) and not several:
            message, allowed = "a case has one such section at most, without a name", f"one [{key}] section"
            remarks.error(f"{key}.{short(name)}", message, shown(value), allowed + section.second)
        else:
            hint = did_you_mean(str(name), fields) or other_place(str(name))
            if isinstance(value, Mapping):
                hint = f"[{key}.one] and [{key}.{short(name)}], where two are connected"
            remarks.error(f"{key}.{short(name)}", "unknown key", shown(value), ", ".join(fields), hint)
    for field in fields.values():
        if field.required and field.name not in raw:
            remarks.error(f"{key}.{field.name}", "missing", allowed=field.allowed)
    section.complete(raw, values, key, remarks)
    return values


def check_field(key: str, value: object, field: Field, values: dict[str, Any], remarks: Remarks) -> None:
    """Read one value into `values`, or record why it is refused."""
    if field.may_be_missing and (value is None or is_missing(value)):
        message = NOT_FITTED if key.startswith("measurements") else "not given"
        remarks.note(key, message, shown(value))
        return
    try:
        values[field.name] = read_value(value, field)
    except RefusedValueError as error:
        mistake = error.mistake
        hidden = field.kind == "text" and looks_identifiable(value)
        written = "(hidden)" if hidden else shown(value)
        remarks.error(key, mistake.message, written, mistake.allowed, mistake.suggestion)


def read_value(value: object, field: Field) -> object:
    """Read the value of a field.

    Raises:
        RefusedValueError: The value is not allowed; the error states the allowed values.
    """
    if field.read is not None:
        return field.read(value, field)
    return {"number": read_number, "text": _read_text, "name": read_name}[field.kind](value, field)


def _read_text(value: object, field: Field) -> str:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        message = "a number where text belongs; write it in quotes"
        raise RefusedValueError(message, field.allowed, f'"{shown(value)}"')
    if not isinstance(value, str):
        raise RefusedValueError("text belongs here", field.allowed)
    name = unicodedata.normalize("NFC", value).strip()
    if not name:
        raise RefusedValueError("empty", field.allowed)
    if len(name) > MAXIMUM_ID_LENGTH:
        raise RefusedValueError(f"too long: {len(name)} characters", field.allowed)
    if not name.isprintable():
        raise RefusedValueError("contains line breaks or other unprintable characters", field.allowed)
    return name


def read_name(value: object, field: Field) -> str:
    """Read one of the names of a field.

    Raises:
        RefusedValueError: It is not an allowed name; the error states the allowed names.
    """
    if isinstance(value, str):
        name = value.strip()
        name = field.aliases.get(name, name)
        if name in field.names:
            return name
        hint = did_you_mean(name, (*field.names, *field.aliases))
        raise RefusedValueError("unknown name", field.allowed, hint)
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        message = "a number; a name is needed, since the order of a list may change"
        raise RefusedValueError(message, field.allowed)
    raise RefusedValueError("a name belongs here", field.allowed)


def read_share(value: object, field: Field) -> object:
    """Read a fraction; 10 to 70 is refused as a percentage, with the fraction suggested."""
    if is_number(value) and 10.0 <= value <= 70.0:
        raise RefusedValueError("a percentage; a fraction belongs here", field.allowed, f"{value / 100.0:g}")
    return read_number(value, replace(field, read=None))


def _read_switch(value: object, field: Field) -> bool:
    if isinstance(value, bool):
        return value
    hint = str(value).lower() if str(value).lower() in field.names else ""
    raise RefusedValueError("true or false belongs here, without quotes", field.allowed, hint)


def switch(description: str) -> Field:
    """Field for a key that is true or false."""
    return Field(description, "name", required=False, names=("true", "false"), read=_read_switch)


def looks_identifiable(text: object) -> bool:
    """Whether an id looks like a name, a birth date or a hospital record number."""
    if not isinstance(text, str):
        return False
    written = _MARK.sub("", text.strip())[:_LONGEST_CHECKED_TEXT]
    if re.search(r"@|\b(mrn|born|geb|dob|name)\b", written, re.IGNORECASE):
        return True
    return bool(_BIRTH_DATE.search(written) or _RECORD_NUMBER.search(written) or _PERSON.search(written))


def short(key: object) -> str:
    """Shorten a key to 64 characters and escape unprintable ones, for messages."""
    text = str(key)
    text = text if text.isprintable() else text.encode("unicode_escape").decode("ascii")
    return text if len(text) <= 64 else text[:60] + "..."


def _refuse_section(key: str, raw: object, second: str, remarks: Remarks) -> None:
    if isinstance(raw, (list, tuple)):
        times = f"given {len(raw)} times" if len(raw) != 1 else "written as an element of a list"
        allowed = f"one [{key}] section, in single brackets{second if len(raw) > 1 else ''}"
        remarks.error(key, f"{times}; a case has one at most", allowed=allowed)
    else:
        remarks.error(key, "a section belongs here", shown(raw), f"[{key}] and its keys on the lines below")
