"""Writing the comparison with the paper: page, CSV, JSON, figures and tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.files import csv_text, json_text, write_text
from eclsim.paper.drawings import drawings
from eclsim.paper.names import INDEX, items_of
from eclsim.paper.page import reproduction_page, table_rows

if TYPE_CHECKING:
    from eclsim.paper.reproduction import Reproduction
    from eclsim.paper.rows import Row

HEAD = (
    "section", "quantity", "unit", "paper", "ours", "difference", "difference_percent", "explained",
    "tolerance", "verdict", "why",
)  # fmt: skip


def write_reproduction(
    result: Reproduction, folder: Path, progress: Callable[[str], None] = lambda _: None
) -> list[Path]:
    """Write everything to a folder, which is made if it does not exist; returns the files."""
    folder.mkdir(exist_ok=True)
    drawn = drawings(result, progress)
    texts = {
        INDEX: reproduction_page(result, drawn),
        "reproduction.csv": _csv(result.rows),
        "reproduction.json": json_text(as_object(result)),
    }
    for item in items_of(result.parts):
        texts |= dict(zip(item.files, drawn.get(item.key) or [_csv(table_rows(item, result))], strict=True))
    for name, content in texts.items():
        write_text(content, folder / name)
    return [folder / name for name in texts]


def as_object(result: Reproduction) -> dict[str, Any]:
    """The comparison as plain values."""
    unstated = result.crrt.unstated
    return {
        "parts": list(result.parts),
        "samples": None if result.sensitivity is None else result.sensitivity.samples,
        "synthetic_cohort": None if result.cohort is None else result.cohort.synthetic,
        "unstated_patient": {
            "blood_volume_ml": unstated.blood_volume_ml,
            "heart_rate_bpm": unstated.heart_rate_bpm,
            "misfit": unstated.misfit,
            "misfit_as_assumed": unstated.assumed_misfit,
        },
        "rows": [_values(row) for row in (*result.rows, *result.tables)],
    }


def _values(row: Row) -> dict[str, Any]:
    return {name: getattr(row, name) for name in HEAD}


def _csv(rows: Sequence[Row]) -> str:
    return csv_text(HEAD, (_values(row).values() for row in rows), digits=None)
