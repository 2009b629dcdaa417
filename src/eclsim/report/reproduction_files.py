"""Writing the comparison with the paper: one HTML page, CSV and JSON, and the figures."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.report.crrt_drawings import drawings
from eclsim.report.crrt_html import number
from eclsim.report.crrt_json import number as plain
from eclsim.report.files import whole_file
from eclsim.report.html import box, bullets, figure, heading, page, paragraph, table
from eclsim.report.reproduction_names import FIGURES

if TYPE_CHECKING:
    from eclsim.studies.reproduction import Reproduction, Row

HEAD = (
    "section", "quantity", "unit", "paper", "ours", "difference", "difference_percent", "explained",
    "as_printed", "why",
)  # fmt: skip


def write_reproduction(result: Reproduction, folder: Path) -> list[Path]:
    """Write everything to a folder, which is made if it does not exist; returns the files."""
    folder.mkdir(exist_ok=True)
    drawn = drawings(result.explained)
    texts = {
        "reproduction.html": page("The paper's numbers, recomputed", _pieces(result, drawn)),
        "reproduction.csv": _csv(result),
        "reproduction.json": json.dumps(as_object(result), indent=1, allow_nan=False) + "\n",
    }
    texts |= {f"{name}.svg": drawn[key] for name, key in FIGURES.items()}
    for name, content in texts.items():
        with whole_file(folder / name) as partial:
            partial.write_text(content, encoding="utf-8")
    return [folder / name for name in texts]


def as_object(result: Reproduction) -> dict[str, Any]:
    """The comparison as plain values."""
    unstated = result.unstated
    return {
        "unstated_patient": {
            "blood_volume_ml": unstated.blood_volume_ml,
            "heart_rate_bpm": unstated.heart_rate_bpm,
            "misfit": unstated.misfit,
            "misfit_as_assumed": unstated.assumed_misfit,
        },
        "rows": [_values(row) for row in result.rows],
    }


def _values(row: Row) -> dict[str, Any]:
    found: dict[str, Any] = {name: getattr(row, name) for name in HEAD}
    for name in ("difference", "difference_percent", "ours"):
        found[name] = plain(found[name])
    return found


def _csv(result: Reproduction) -> str:
    buffer = io.StringIO()
    writer: csv.DictWriter[str] = csv.DictWriter(buffer, HEAD, lineterminator="\n")
    writer.writeheader()
    writer.writerows(_values(row) for row in result.rows)
    return buffer.getvalue()


def counts(result: Reproduction) -> str:
    """In one sentence: how many numbers agree."""
    text = [row for row in result.rows if not row.section.startswith("Table")]
    same = sum(row.as_printed for row in text)
    explained = sum(not row.as_printed and "it agrees" in row.why for row in text)
    return (
        f"{same} of {len(text)} printed numbers come out as printed, {explained} more with the blood "
        f"volume that the "
        f"paper does not print, {len(text) - same - explained} differ"
    )


def _pieces(result: Reproduction, drawn: Mapping[str, str]) -> Iterator[str]:
    unstated = result.unstated
    yield heading("The paper's numbers, recomputed", 1)
    yield paragraph("Thiel et al. 2025, sections 3.3 and 4, Figures 2, 5 and 6, Tables S-1 to S-4.", "lead")
    yield box(
        [
            counts(result),
            f"Blood volume {unstated.blood_volume_ml:.0f} mL and heart rate "
            f"{unstated.heart_rate_bpm:.0f} beats/min "
            f"explain the printed numbers: the root mean square difference falls from "
            f"{unstated.assumed_misfit:.1f} "
            f"to {unstated.misfit:.2f} of the printing's own tolerance.",
        ]
    )
    yield heading("Numbers of the text")
    head = ["Section", "Quantity", "Paper", "Ours", "Difference", "With the values found", "Unit", "Why"]
    rows = [_cells(row) for row in result.rows if not row.section.startswith("Table")]
    yield table(head, rows, numeric=(2, 3, 4, 5))
    yield heading("What was assumed")
    patient = result.study.case.patient
    yield bullets(
        [
            f"Ours: {patient.sex}, {patient.age_years:g} years, {patient.height_cm:g} cm, "
            f"{patient.weight_kg:g} kg, "
            f"{patient.heart_rate_bpm:g} beats/min; cannulae 21 and 17 Fr. The paper prints sex, age "
            f"(69) and Table S-4.",
            "Scheme h has both lines at pre pump, as the published code ran it: the printed variation of "
            "the access "
            "pressure, 296.6 mmHg, needs it (with the return line at post drainage cannula, as drawn in "
            "Figure 2, it is "
            "297.2 mmHg).",
            "1.2 and 6 L/min are 1750 and 5000 rpm: points of a grid of 250 rpm that give the printed "
            "line pressures.",
            "Medians and variations are taken over the cycle means of the nine schemes; artery is the "
            "systemic artery.",
        ]
    )
    for name, key in FIGURES.items():
        caption = f"{name.replace('_', ' ').capitalize()}, with the values found."
        yield figure(drawn[key], caption, key)
    yield heading("Tables S-1 to S-4")
    values = [row for row in result.rows if row.section.startswith("Table")]
    wrong = [row for row in values if not row.as_printed]
    yield paragraph(f"{len(values) - len(wrong)} of {len(values)} values are used as printed.")
    rows = [[row.section, row.quantity, f"{row.paper:g}", f"{row.ours:g}", row.unit] for row in values]
    yield table(["Table", "Parameter", "Paper", "Ours", "Unit"], rows, numeric=(2, 3))


def _cells(row: Row) -> list[str]:
    digits = row.digits
    paper, ours = number(row.paper, digits), number(row.ours, digits + 1)
    percent = number(row.difference_percent, 1)
    explained = "" if row.explained is None else number(row.explained, digits + 1)
    unit = "" if row.unit == "1" else row.unit
    return [row.section, row.quantity, paper, ours, f"{percent} %", explained, unit, row.why or "as printed"]
