"""Files of clinical data for tests of their import: FHIR bundles and long tables."""

import json
from pathlib import Path
from typing import Any

LOINC = "http://loinc.org"
NINE = "2024-03-01T09:00:00+01:00"


def observation(code: str, value: Any, unit: str, time: str = NINE, **more: Any) -> dict[str, Any]:
    return {
        "resourceType": "Observation",
        "status": "final",
        "subject": {"reference": "Patient/P01"},
        "effectiveDateTime": time,
        "code": {"coding": [{"system": LOINC, "code": code}]},
        "valueQuantity": {"value": value, "code": unit},
        **more,
    }


PATIENT = {
    "resourceType": "Patient",
    "id": "P01",
    "gender": "female",
    "birthDate": "1955-04-17",
    "name": [{"family": "Doe"}],
}
PANEL = {
    "component": [
        {
            "code": {"coding": [{"system": LOINC, "code": "8480-6"}]},
            "valueQuantity": {"value": 110, "code": "mm[Hg]"},
        },
        {
            "code": {"coding": [{"system": LOINC, "code": "8462-4"}]},
            "valueQuantity": {"value": 70, "code": "mm[Hg]"},
        },
    ]
}
TWO = [observation("8867-4", 82, "/min"), observation("8478-0", 80, "mm[Hg]")]


def bundle(folder: Path, *resources: Any) -> Path:
    path = folder / "bundle.json"
    path.write_text(json.dumps({"resourceType": "Bundle", "entry": [{"resource": r} for r in resources]}))
    return path


def panel() -> dict[str, Any]:
    whole = observation("85354-9", 0, "") | PANEL
    del whole["valueQuantity"]
    return whole


def of(reference: str, *resources: dict[str, Any]) -> list[dict[str, Any]]:
    return [r | {"subject": {"reference": reference}} for r in resources]


def named(column: str, value: Any, unit: str, system: str | None = None) -> dict[str, Any]:
    """A value under the name of a cohort column."""
    return observation("", value, unit) | {"code": {"coding": [{"system": system, "code": column}]}}


def long_table(folder: Path, *rows: str) -> Path:
    path = folder / "long.csv"
    path.write_text("\n".join(("patient,time,code,value,unit", *rows)) + "\n")
    return path
