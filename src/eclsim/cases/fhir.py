"""FHIR R4: the observations of a bundle, and sex and birth date of its patients."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from typing import Any

from eclsim.cases.cohort import COLUMNS, OPTIONAL
from eclsim.cases.observations import (
    BY_CODE,
    LOINC,
    SNOMED,
    About,
    Imported,
    Observation,
    are_different_units,
)
from eclsim.inputs.files import decoded, json_of, read_bytes
from eclsim.inputs.mistakes import CaseError, Mistake, shown
from eclsim.inputs.numbers import is_number

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
