"""Writing the CRRT study to a folder: page, JSON, NetCDF, CSV and figures."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.report.crrt_netcdf import write_netcdf
from eclsim.report.files import whole_file

if TYPE_CHECKING:
    from eclsim.studies.crrt_study import CrrtStudy

FILES = ("report.html", "study.json", "study.nc")
TABLES = ("means", "summary", "limits", "ranking", "uptake")
DRAWINGS = ("schemes", "beat", "speeds", "limits", "uptake")


def file_names() -> tuple[str, ...]:
    """Names of all files that a study may write."""
    return (*FILES, *(f"{name}.csv" for name in TABLES), *(f"{name}.svg" for name in DRAWINGS))


def write_study(study: CrrtStudy, folder: Path) -> list[Path]:
    """Write everything to a folder, which is made if it does not exist; returns the files."""
    from eclsim.report.crrt_drawings import drawings
    from eclsim.report.crrt_html import study_page
    from eclsim.report.crrt_tables import tables

    folder.mkdir(exist_ok=True)
    drawn = drawings(study)
    texts = {"report.html": study_page(study, drawn), "study.json": study_json(study)}
    texts |= {f"{name}.svg": svg for name, svg in drawn.items()}
    for name, table in tables(study).items():
        texts[f"{name}.csv"] = table.to_csv(index=False, lineterminator="\n")
    for name, content in texts.items():
        with whole_file(folder / name) as partial:
            partial.write_text(content, encoding="utf-8")
    write_netcdf(study, folder / "study.nc")
    return [folder / name for name in (*texts, "study.nc")]


def study_json(study: CrrtStudy) -> str:
    """The study as JSON text."""
    from eclsim.report.crrt_json import study_object

    return json.dumps(study_object(study), indent=1, allow_nan=False) + "\n"


def write_json(study: CrrtStudy, destination: Path | str) -> None:
    """Write the JSON object to a file, or to standard output for "-"."""
    content = study_json(study)
    if destination == "-":
        sys.stdout.write(content)
        sys.stdout.flush()
        return
    with whole_file(Path(destination)) as partial:
        partial.write_text(content, encoding="utf-8")
