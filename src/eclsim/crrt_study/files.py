"""Writing the CRRT study to a folder: page, JSON, NetCDF, CSV and figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.crrt_study.netcdf import write_netcdf
from eclsim.files import frame_text, json_text, write_text

if TYPE_CHECKING:
    from eclsim.crrt_study.study import CrrtStudy

FILES = ("report.html", "study.json", "study.nc")
TABLES = ("means", "summary", "limits", "ranking", "uptake")
DRAWINGS = ("schemes", "beat", "speeds", "limits", "uptake")


def file_names() -> tuple[str, ...]:
    """Names of all files that a study may write."""
    return (*FILES, *(f"{name}.csv" for name in TABLES), *(f"{name}.svg" for name in DRAWINGS))


def write_study(study: CrrtStudy, folder: Path, policy: str | None = None) -> list[Path]:
    """Write everything to a folder, which is made if it does not exist; returns the files.

    Args:
        study: results.
        folder: to write to.
        policy: blood volume policy that report and figures are for; left out, the first studied.
    """
    from eclsim.crrt_study.drawings import drawings
    from eclsim.crrt_study.page import study_page
    from eclsim.crrt_study.tables import tables

    folder.mkdir(exist_ok=True)
    drawn = drawings(study, policy)
    texts = {"report.html": study_page(study, drawn, policy), "study.json": study_json(study)}
    texts |= {f"{name}.svg": svg for name, svg in drawn.items()}
    for name, table in tables(study).items():
        texts[f"{name}.csv"] = frame_text(table)
    for name, content in texts.items():
        write_text(content, folder / name)
    write_netcdf(study, folder / "study.nc")
    return [folder / name for name in (*texts, "study.nc")]


def study_json(study: CrrtStudy) -> str:
    """The study as JSON text."""
    from eclsim.crrt_study.json_object import study_object

    return json_text(study_object(study))


def write_json(study: CrrtStudy, destination: Path | str) -> None:
    """Write the JSON object to a file, or to standard output for "-"."""
    write_text(study_json(study), destination)
