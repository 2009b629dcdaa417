"""Reading a FHIR R4 bundle of Patients and Observations (JSON)."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from datetime import date
from typing import Any

from eclsim.cases.observations import BY_CODE, LOINC, SNOMED, Imported, Observation
from eclsim.inputs.files import decoded, json_of, read_bytes
from eclsim.inputs.mistakes import CaseError, Mistake, shown

MAXIMUM_BYTES = 50_000_000
_NOT_VALID = ("entered-in-error", "cancelled")


def read_bundle(
    path: str | os.PathLike[str],
) -> tuple[list[Observation], dict[str, dict[str, str]], Imported]:
    """Observations of a bundle, what it says of each patient, and everything there was to say.

    Names, addresses and birth dates are not kept: of a birth date the age at the first observation is.

    Raises:
        CaseError: Where the file is no bundle.
    """
    file = os.fsdecode(path)
    bundle = _json_of(file)
    result = Imported()
    patients, kept = {}, []
    for number, resource in _resources(bundle, result):
        place = f"entry {number}"
        if resource.get("resourceType") == "Patient":
            patients[str(resource.get("id", ""))] = resource
        elif resource.get("resourceType") == "Observation":
            kept += _observations(resource, place, result)
        else:
            kind = str(resource.get("resourceType"))
            result.warnings.append(
                Mistake(place, "neither a Patient nor an Observation: not read", shown(kind))
            )
    about = {name: _about(name, patients.get(name), kept, result) for name in {o.patient for o in kept}}
    return kept, about, result


def _json_of(file: str) -> Mapping[str, Any]:
    data = read_bytes(file, MAXIMUM_BYTES, "a bundle", "split the bundle")
    content = json_of(decoded(data, file, "JSON in UTF-8"), file)
    kind = content.get("resourceType") if isinstance(content, dict) else type(content).__name__
    if kind != "Bundle" or not isinstance(content.get("entry"), list) or not content["entry"]:
        message = "no FHIR bundle with entries" if kind == "Bundle" else "no FHIR bundle"
        raise CaseError([Mistake("resourceType", message, shown(str(kind)), "Bundle with entry", file=file)])
    return content


def _resources(bundle: Mapping[str, Any], result: Imported) -> Iterator[tuple[int, Mapping[str, Any]]]:
    for number, entry in enumerate(bundle["entry"], start=1):
        resource = entry.get("resource") if isinstance(entry, dict) else None
        if isinstance(resource, dict):
            yield number, resource
        else:
            result.mistakes.append(Mistake(f"entry {number}", "holds no resource"))


def _observations(resource: Mapping[str, Any], place: str, result: Imported) -> list[Observation]:
    """The values of one Observation: its own, or those of its components (as of blood pressure panels)."""
    if resource.get("status") in _NOT_VALID:
        result.notes.append(Mistake(place, f"status {resource['status']}: not read"))
        return []
    reference = _mapping(resource.get("subject")).get("reference", "")
    patient = str(reference).rpartition("/")[2].removeprefix("urn:uuid:")
    if not patient:
        result.mistakes.append(Mistake(place, "no subject: whose value is it?"))
        return []
    when = resource.get("effectiveDateTime") or resource.get("effectiveInstant")
    when = when or _mapping(resource.get("effectivePeriod")).get("start") or ""
    parts = [resource, *(c for c in resource.get("component") or [] if isinstance(c, dict))]
    values = [(code_of(part), part) for part in parts if "valueQuantity" in part or part is not resource]
    if not values and "dataAbsentReason" not in resource:
        if code_of(resource) in BY_CODE:
            result.mistakes.append(Mistake(place, "no valueQuantity: a number with a unit is needed"))
        return []
    read = []
    for code, part in values:
        quantity = _mapping(part.get("valueQuantity"))
        if code not in BY_CODE:
            read.append(Observation(patient, str(when), code, 0.0, "", place))
        elif "dataAbsentReason" in part:
            result.notes.append(Mistake(place, f"{BY_CODE[code].column}: absent, with a reason; missing"))
        else:
            read += _value(patient, str(when), code, quantity, place, result)
    return read


def _value(
    patient: str, when: str, code: str, quantity: Mapping[str, Any], place: str, result: Imported
) -> list[Observation]:
    value, key = quantity.get("value"), f"{place} {BY_CODE[code].column}"
    if isinstance(value, bool) or not isinstance(value, int | float):
        result.mistakes.append(Mistake(key, "no number", shown(value) if value is not None else ""))
        return []
    if quantity.get("comparator"):
        result.mistakes.append(Mistake(key, "a limit, not a value", f"{quantity['comparator']}{value}"))
        return []
    unit = str(quantity.get("code") or quantity.get("unit") or "")
    return [Observation(patient, when, code, float(value), unit, place)]


def code_of(part: Mapping[str, Any]) -> str:
    """The first code of a resource or component that can be read, else its first code, else its text."""
    concept = _mapping(part.get("code"))
    codings = [_mapping(c) for c in concept.get("coding") or []]
    known = [
        str(c.get("code"))
        for c in codings
        if str(c.get("code")) in BY_CODE and c.get("system") in (LOINC, SNOMED, None)
    ]
    first = [f"{c.get('code')}" for c in codings if c.get("code")]
    text = str(concept.get("text", ""))
    return (known or ([text] if text in BY_CODE else first) or [text or "(none)"])[0]


def _about(
    name: str, resource: Mapping[str, Any] | None, kept: list[Observation], result: Imported
) -> dict[str, str]:
    """Sex, and age at the first observation, as cells of a cohort."""
    if resource is None:
        result.warnings.append(Mistake(name, "no Patient resource: sex and age are not known"))
        return {}
    cells = {}
    gender = resource.get("gender")
    if gender in ("female", "male"):
        cells["sex"] = str(gender)
    else:
        result.mistakes.append(
            Mistake(f"Patient {name} gender", "needed for the blood volume", shown(gender), "female, male")
        )
    try:
        born = date.fromisoformat(str(resource.get("birthDate", "")))
        seen = date.fromisoformat(min(o.time for o in kept if o.patient == name)[:10])
    except ValueError:
        message = "no full date, so no age"
        result.mistakes.append(Mistake(f"Patient {name} birthDate", message, allowed="1955-04-17"))
        return cells
    cells["age_years"] = str(seen.year - born.year - ((seen.month, seen.day) < (born.month, born.day)))
    return cells


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}
