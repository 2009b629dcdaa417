"""Import of clinical data, a FHIR bundle or a long table (one row per value), into the table of a cohort."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, timedelta
from pathlib import Path
from typing import Any

from eclsim.cases.case import Case
from eclsim.cases.cohort import COLUMNS, MEASUREMENT, OPTIONAL, read_table
from eclsim.cases.observations import (
    BY_CODE,
    LOINC,
    NOTHING_TO_FIT,
    PATIENT_COLUMNS,
    SNOMED,
    About,
    Imported,
    Observation,
    are_different_units,
    data_points,
)
from eclsim.cases.sections import PATIENT_SECTIONS, Gas
from eclsim.files import csv_text
from eclsim.inputs.files import decoded, json_of, read_bytes
from eclsim.inputs.mistakes import CaseError, Mistake, shown
from eclsim.inputs.numbers import NUMBER, is_missing, is_number
from eclsim.spelling import did_you_mean
from eclsim.units import known_unit

DEFAULT_WINDOW = timedelta(minutes=5)
LONG_TABLE_COLUMNS = ("patient", "time", "code", "value", "unit")
"""Column names of a long table."""
_HEAD = ("patient_id", MEASUREMENT, *(c for c in COLUMNS if c != "patient_id"), *OPTIONAL)


def import_cohort(
    path: str | os.PathLike[str], base: Case | None = None, within: timedelta = DEFAULT_WINDOW
) -> Imported:
    """Read a FHIR bundle (.json) or a long table into rows of a cohort.

    Args:
        path: Path of the file.
        base: Supplies sex, age, size, heart rate and the sections of gases and devices where the file has
            none.
        within: Values of a patient up to this time after the first value of a data point belong to that
            point.

    Raises:
        CaseError: The file has errors; all are listed.
    """
    bundle = Path(os.fsdecode(path)).suffix.lower() == ".json"
    observations, about, result = (read_bundle if bundle else read_long_table)(path)
    data_points(observations, about, within, result)
    file = os.fsdecode(path)
    if result.mistakes:
        nothing_read = [m.message for m in result.mistakes] == [NOTHING_TO_FIT]
        message = [*result.warnings, *result.notes] if nothing_read else []
        raise CaseError([m.at(file, m.line) for m in [*message, *result.mistakes]])
    if base is not None:
        _fill(result, base)
    result.warnings = [m.at(file, m.line) for m in result.warnings]
    result.notes = [m.at(file, m.line) for m in result.notes]
    return result


def as_table(rows: list[dict[str, str]]) -> str:
    """Format rows as a cohort's CSV; optional columns that are empty are left out."""
    used = [c for c in _HEAD if c not in OPTIONAL or any(row.get(c) for row in rows)]
    return csv_text(used, ([row.get(column, "") for column in used] for row in rows))


def _fill(result: Imported, base: Case) -> None:
    stated = {f"patient.{k}": v for k, v in base.patient.model_dump(exclude_none=True).items()}
    gas = {} if base.gas is None else base.gas.model_dump(exclude_none=True)
    if base.gas is not None and "shunt_fraction" not in base.gas.model_fields_set:
        del gas["shunt_fraction"]  # an assumed value would be read as known from a table
    left_out = {f"{Gas.section}.{k}" for k in gas if base.gas and k not in base.gas.model_fields_set}
    stated |= {f"{Gas.section}.{k}": v for k, v in gas.items()}
    for device in base.instances():
        stated |= {f"{device.key}.{k}": v for k, v in device.section.model_dump(exclude_none=True).items()}
    assumed = []
    for column, key in (COLUMNS | OPTIONAL).items():
        if column == "patient_id" or not isinstance(value := stated.get(key), str | float | int):
            continue
        text = value if isinstance(value, str) else f"{value:g}"
        empty = [row for row in result.rows if not row.get(column)]
        for row in empty:
            row[column] = text
        if empty and key.startswith("patient."):
            result.note(column, f"{text} of the base case, in {len(empty)} of {len(result.rows)} data points")
        if empty and key in left_out:
            assumed.append(f"{column} = {text}")
    if assumed:
        result.note(Gas.section, f"left out of the base case, so assumed in the table: {', '.join(assumed)}")
    for device in base.instances():
        if device.device.columns.needed and not device.name:
            result.note(device.key, "circuit of the base case, where the file says nothing")
    if lost := _without_column(base):
        message = "a cohort has no columns for these of the base case, so its data points are without them"
        result.warning(", ".join(lost), message)


def _without_column(base: Case) -> list[str]:
    """Sections and keys of a base case that the table of a cohort cannot hold."""
    readable = {*COLUMNS.values(), *OPTIONAL.values()}
    lost = [
        f"[{one.section}]"
        for one in PATIENT_SECTIONS
        if one is not Gas and getattr(base, one.section) is not None
    ]
    for device in base.instances():
        given = device.section.model_dump(exclude_none=True, exclude_defaults=True)
        without = [
            f"{device.key}.{key}"
            for key, value in given.items()
            if f"{device.key}.{key}" not in readable or not isinstance(value, str | float | int)
        ]
        lost += without if len(without) < len(given) else [f"[{device.key}]"]
    lost += ["[parameters]"] * bool(base.parameters)
    return lost + ["blood_volume_policy"] * (base.volume_policy != "as_published")


# --- a long table ------------------------------------------------------------------------------------


def read_long_table(
    path: str | os.PathLike[str],
) -> tuple[list[Observation], dict[str, About], Imported]:
    """Return the observations of a table, data of each patient, and errors, warnings and notes.

    Codes are LOINC or SNOMED CT codes, or names of cohort columns (SP, heart_rate_bpm ...), `sex` or
    `age_years`.

    Raises:
        CaseError: The file as a whole cannot be used.
    """
    table = read_table(path)
    wrong = []
    for name in LONG_TABLE_COLUMNS:
        if table.header.count(name) != 1:
            suggestion = did_you_mean(name, [h for h in table.header if h and h not in LONG_TABLE_COLUMNS])
            message = (
                "more than one column of this name" if name in table.header else "this column is missing"
            )
            wrong.append(Mistake(name, message, allowed=", ".join(LONG_TABLE_COLUMNS), suggestion=suggestion))
    if wrong:
        raise CaseError([m.at(table.file, None) for m in wrong])
    result, values = Imported(notes=list(table.notes), mistakes=list(table.mistakes)), []
    about: dict[str, About] = {}
    place = {name: table.header.index(name) for name in LONG_TABLE_COLUMNS}
    for line, cells in table.rows:
        if len(cells) != len(table.header):
            message = f"{len(cells)} cells where the header has {len(table.header)}"
            result.error("", message, line=line)
            continue
        row = {name: cells[k].strip() for name, k in place.items()}
        if not row["patient"]:
            result.error("patient", "empty", line=line)
        elif row["code"] in PATIENT_COLUMNS:
            _collect_patient_data(row, about.setdefault(row["patient"], About()).cells, line, result)
        else:
            values += _observation(row, line, result)
    return values, about, result


def _collect_patient_data(row: dict[str, str], cells: dict[str, str], line: int, result: Imported) -> None:
    unit = known_unit(row["unit"]) or row["unit"]
    if unit not in ("", "1", *(["years"] if row["code"] == "age_years" else [])):
        allowed = "years" if row["code"] == "age_years" else "no unit"
        result.error(row["code"], "another unit", shown(row["unit"]), allowed, line=line)
    if cells.setdefault(row["code"], row["value"]) != row["value"]:
        both = f"{cells[row['code']]} and {row['value']}"
        result.error(row["code"], "two values for one patient", both, line=line)


def _observation(row: dict[str, str], line: int, result: Imported) -> list[Observation]:
    if row["code"] in BY_CODE and is_missing(row["value"]):
        result.note(BY_CODE[row["code"]].column, "missing", line=line)
        return []
    is_number = NUMBER.fullmatch(row["value"])
    if not is_number and row["code"] in BY_CODE:
        allowed, key = "a number with a decimal point", BY_CODE[row["code"]].column
        result.error(key, "not a number", shown(row["value"]), allowed, line=line)
        return []
    value = float(row["value"]) if is_number else 0.0
    return [Observation(row["patient"], row["time"], row["code"], value, row["unit"], line=line)]


# --- FHIR R4 ----------------------------------------------------------------------------------------


MAXIMUM_BYTES = 50_000_000
_NOT_VALID = ("entered-in-error", "cancelled")


def read_bundle(
    path: str | os.PathLike[str],
) -> tuple[list[Observation], dict[str, About], Imported]:
    """Return the observations of a bundle, data of each patient, and errors, warnings and notes.

    Names and addresses are not read; of a birth date, only the age at each data point is used.

    Raises:
        CaseError: The file is not a bundle.
    """
    file = os.fsdecode(path)
    bundle = _json_of(file)
    result = Imported()
    result.warnings += _other_pages(bundle)
    entries = list(_resources(bundle, result))
    result.notes += _codes_without_system(entries)
    people = _people(entries, result)
    values = []
    for place, _, resource in entries:
        if resource.get("resourceType") == "Observation":
            values += _observations(resource, place, people, result)
        elif resource.get("resourceType") != "Patient":
            kind = str(resource.get("resourceType"))
            result.warning(place, "neither a Patient nor an Observation: not read", shown(kind))
    named = sorted({value.patient for value in values})
    about = {name: _about(name, people.patients.get(name), result) for name in named}
    return values, about, result


def _other_pages(bundle: Mapping[str, Any]) -> Iterator[Mistake]:
    """Yield warnings if a bundle is one page of several, or contains fewer entries than its total."""
    if any(_mapping(link).get("relation") == "next" for link in _list(bundle.get("link"))):
        message = "one page of several: the patients and values of the following pages are missing"
        yield Mistake("link", message, "next", "all pages in one bundle")
    matches = [e for e in bundle["entry"] if _mapping(_mapping(e).get("search")).get("mode") != "include"]
    total = bundle.get("total")
    if isinstance(total, int) and total > len(matches):
        yield Mistake("total", f"{len(matches)} entries are here; the others are missing", str(total))


@dataclass(frozen=True, slots=True)
class _People:
    """Patients of a bundle.

    Attributes:
        patients: Patient resources by name.
        names: Each patient's name by every reference that may denote it.
        addresses: The address on a server (`https://...`) of each name.
    """

    patients: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    addresses: dict[str, str] = field(default_factory=dict)

    def are_two(self, name: str, address: str) -> str:
        """Return a message if a name belongs to another address; ids are unique on one server only."""
        known = self.addresses.setdefault(name, address) if "://" in address else address
        if known == address:
            return ""
        return f"{address} and {known} have one id and may be two patients; allowed: different ids"


def _people(entries: Sequence[tuple[str, str, Mapping[str, Any]]], result: Imported) -> _People:
    people = _People()
    for place, url, resource in entries:
        if resource.get("resourceType") != "Patient":
            continue
        name = str(resource.get("id") or _last(url))
        known = people.patients.setdefault(name, resource)
        if any(known.get(key) != resource.get(key) for key in ("gender", "birthDate")):
            message = "two Patient resources of this id that differ in gender or birth date"
            result.error(place, message, shown(name))
        elif two := people.are_two(name, url):
            result.error(place, two)
        people.names.update({key: name for key in (url, f"Patient/{name}") if key})
    return people


def _last(url: str) -> str:
    """Return the last part of a URL: "P01" of "https://hospital/fhir/Patient/P01", the id of a urn:uuid."""
    return url.rpartition("/")[2].removeprefix("urn:uuid:")


def _subject(resource: Mapping[str, Any], people: _People) -> tuple[str, str]:
    """Return the name of a resource's patient and an empty text, or an empty name and the reason.

    A reference may be relative, absolute or a urn:uuid, and may end with a version (`/_history/2`).
    """
    subject = _mapping(resource.get("subject"))
    reference = str(subject.get("reference") or "").partition("/_history/")[0]
    if not reference:
        return "", "no subject: whose value is it?"
    kind = reference.split("/")[-2] if "/" in reference else str(subject.get("type") or "Patient")
    if kind != "Patient":
        return "", f"the subject is a {kind}; allowed: a Patient (remove what does not belong to a patient)"
    contained = {f"#{_mapping(c).get('id')}" for c in _list(resource.get("contained"))}
    if reference in contained:
        return "", f"the subject {reference} is inside the Observation; allowed: one Patient entry for all"
    name = people.names.get(reference) or _last(reference)
    two = people.are_two(name, reference)
    return ("", two) if two else (name, "")


def _json_of(file: str) -> Mapping[str, Any]:
    data = read_bytes(file, MAXIMUM_BYTES, "a bundle", "split the bundle")
    content = json_of(decoded(data, file, "JSON in UTF-8"), file)
    kind = content.get("resourceType") if isinstance(content, dict) else type(content).__name__
    if kind != "Bundle" or not isinstance(content.get("entry"), list) or not content["entry"]:
        message = "not a FHIR bundle with entries" if kind == "Bundle" else "not a FHIR bundle"
        raise CaseError([Mistake("resourceType", message, shown(str(kind)), "Bundle with entry", file=file)])
    return content


def _resources(bundle: Mapping[str, Any], result: Imported) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Yield position, URL and content of each entry that contains a resource."""
    for number, entry in enumerate(bundle["entry"], start=1):
        resource = _mapping(entry).get("resource")
        if isinstance(resource, dict):
            yield f"entry {number}", str(entry.get("fullUrl") or ""), resource
        else:
            result.error(f"entry {number}", "holds no resource")


def _observations(
    resource: Mapping[str, Any], place: str, people: _People, result: Imported
) -> list[Observation]:
    """Return the values of an Observation: its own, or those of its components (blood pressure panels)."""
    if resource.get("status") in _NOT_VALID:
        result.note(place, f"status {resource['status']}: not read")
        return []
    patient, wrong = _subject(resource, people)
    if not patient:
        result.error(place, wrong)
        return []
    when = resource.get("effectiveDateTime") or resource.get("effectiveInstant")
    when = when or _mapping(resource.get("effectivePeriod")).get("start") or ""
    if wrong := _misshapen(resource):
        result.error(place, wrong)
        return []
    own, components = code_of(resource), resource.get("component") or []
    absent = "dataAbsentReason" in resource and own in BY_CODE
    parts = [resource] * ("valueQuantity" in resource or absent) + components
    values = [(code_of(part), part) for part in parts]
    if not values:
        if own in BY_CODE:
            result.error(place, "no valueQuantity: a number with a unit is needed")
        return [Observation(patient, str(when), own, 0.0, "", place)] * (own in COLUMNS | OPTIONAL)
    read = []
    for code, part in values:
        quantity = _mapping(part.get("valueQuantity"))
        if code not in BY_CODE:
            read.append(Observation(patient, str(when), code, 0.0, "", place))
        elif "dataAbsentReason" in part:
            result.note(place, f"{BY_CODE[code].column}: absent, with a reason: treated as missing")
        else:
            read += _value(patient, str(when), code, quantity, place, result)
    return read


def _value(
    patient: str, when: str, code: str, quantity: Mapping[str, Any], place: str, result: Imported
) -> list[Observation]:
    value, key = quantity.get("value"), f"{place} {BY_CODE[code].column}"
    if not is_number(value):
        result.error(key, "not a number", shown(value) if value is not None else "")
        return []
    if quantity.get("comparator"):
        result.error(key, "a limit, not a value", f"{quantity['comparator']}{value}")
        return []
    coded, written = str(quantity.get("code") or ""), str(quantity.get("unit") or "")
    if are_different_units(coded, written):
        message = "its code and its text give different units: which one is right?"
        result.error(key, message, f"{value:g} {coded}, {value:g} {written}")
        return []
    return [Observation(patient, when, code, float(value), coded or written, place)]


def _misshapen(resource: Mapping[str, Any]) -> str:
    """Describe what is not a list of objects although FHIR requires one; empty if there is nothing."""
    components = resource.get("component") or []
    if not _are_objects(components):
        return "component: not a list of objects, as FHIR requires"
    codings = (_mapping(part.get("code")).get("coding") or [] for part in (resource, *components))
    return "" if all(map(_are_objects, codings)) else "code.coding: not a list of objects, as FHIR requires"


def _are_objects(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(one, dict) for one in value)


def code_of(part: Mapping[str, Any]) -> str:
    """Return the first code of a resource or component that is known, else its first code, else its text."""
    concept = _mapping(part.get("code"))
    codings = concept.get("coding") or []
    known = [str(c.get("code")) for c in codings if _is_read(c)]
    first = [_in_words(c) for c in codings if c.get("code")]
    text = str(concept.get("text", ""))
    return (known or ([text] if text in BY_CODE else first) or [text or "(none)"])[0]


def _is_read(coding: Mapping[str, Any]) -> bool:
    """Whether a coding has a code that is read, of the system that the code belongs to or of none."""
    code, system = str(coding.get("code")), coding.get("system")
    if (kind := BY_CODE.get(code)) is None:
        return False
    systems = (LOINC, SNOMED) if code == kind.column else ({kind.loinc: LOINC}.get(code, SNOMED),)
    return system in (*systems, None)


def _in_words(coding: Mapping[str, Any]) -> str:
    """Return a code that is not read; with its system where another system's code would be read."""
    code = str(coding["code"])
    return f"{code} of {coding.get('system')}" if code in BY_CODE else code


def _codes_without_system(entries: Iterable[tuple[str, str, Mapping[str, Any]]]) -> Iterator[Mistake]:
    """Yield a note for each code that is read although no coding of it names its system."""
    without: dict[str, str] = {}
    for _, _, resource in entries:
        if resource.get("resourceType") != "Observation" or _misshapen(resource):
            continue
        for part in (resource, *(resource.get("component") or [])):
            code = code_of(part)
            kind = BY_CODE.get(code)
            system = {kind.loinc: "LOINC", kind.snomed: "SNOMED CT"}.get(code) if kind else None
            codings = _mapping(part.get("code")).get("coding") or []
            if system and not any(str(c.get("code")) == code and c.get("system") for c in codings):
                without[code] = system
    for code, system in without.items():
        yield Mistake("", f"code {code} has no system: read as {system}")


def _about(name: str, resource: Mapping[str, Any] | None, result: Imported) -> About:
    """Return sex and birth date; no message shows the birth date."""
    if resource is None:
        result.warning(name, "no Patient resource: sex and age are not known")
        return About()
    cells = {}
    for key, word in (("gender", "sex"), ("birthDate", "age")):
        if resource.get(key) is None:
            result.warning(f"Patient {name} {key}", f"left out: the {word} is not known")
    gender = resource.get("gender")
    if gender in ("female", "male"):
        cells["sex"] = str(gender)
    elif gender is not None:
        result.error(f"Patient {name} gender", "needed for the blood volume", shown(gender), "female, male")
    if resource.get("birthDate") is None:
        return About(cells)
    try:
        return About(cells, date.fromisoformat(str(resource["birthDate"])))
    except ValueError:
        message = "no full date, so no age"
        result.error(f"Patient {name} birthDate", message, allowed="1955-04-17")
        return About(cells)


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []
