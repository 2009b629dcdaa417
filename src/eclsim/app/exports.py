"""Files to take away: case, tables, figures, the CRRT study. Each is made in a folder that goes away."""

from __future__ import annotations

import re
import tempfile
import zipfile
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.app.state import PageState

KINDS = ("case", "outputs", "waveforms", "svg", "png", "study")


class ExportError(ValueError):
    """Why a file cannot be made for this patient."""


def export(state: PageState, kind: str) -> tuple[str, bytes]:
    """Name and content of a file.

    Args:
        state: what is shown.
        kind: one of `KINDS`.

    Raises:
        ExportError: If there is nothing of this kind for the state.
    """
    stem = file_stem(state.case.patient.id)
    if kind == "case":
        from eclsim.patients.writing import case_text

        return f"{stem}.toml", case_text(state.case).encode()
    if kind in ("outputs", "waveforms"):
        return _table(state, kind, stem)
    if kind in ("svg", "png"):
        return _figures(state, kind, stem)
    if kind == "study":
        return _study(state, stem)
    raise ExportError(f"no such file: {kind[:20]}")


def file_stem(name: str) -> str:
    """An id as the stem of a file name: letters, digits, - and _."""
    return re.sub(r"[^\w-]+", "_", name).strip("_")[:60] or "eclsim"


def _table(state: PageState, kind: str, stem: str) -> tuple[str, bytes]:
    from eclsim.report.files import write_csv

    with tempfile.TemporaryDirectory(prefix="eclsim-") as folder:
        write_csv([_simulated(state)], [], Path(folder), [stem], None)
        name = f"{stem}_waveforms.csv" if kind == "waveforms" else "outputs.csv"
        return (name if kind == "waveforms" else f"{stem}_outputs.csv"), (Path(folder) / name).read_bytes()


def _figures(state: PageState, kind: str, stem: str) -> tuple[str, bytes]:
    from eclsim.report.files import write_figures

    with tempfile.TemporaryDirectory(prefix="eclsim-") as folder:
        write_figures([state.case], [_simulated(state)], Path(folder), [stem])
        packed = BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in sorted(Path(folder).rglob(f"*.{kind}")):
                archive.write(path, path.name)
    return f"{stem}_figures_{kind}.zip", packed.getvalue()


def _study(state: PageState, stem: str) -> tuple[str, bytes]:
    from eclsim.report.crrt_drawings import drawings
    from eclsim.report.crrt_html import study_page
    from eclsim.studies.crrt_settings import StudyError
    from eclsim.studies.crrt_study import crrt_study

    try:
        study = crrt_study(state.case)
    except StudyError as error:
        raise ExportError(str(error)) from None
    return f"{stem}_crrt_study.html", study_page(study, drawings(study)).encode()


def _simulated(state: PageState) -> xr.Dataset:
    from eclsim.studies.simulation import simulate_case

    return simulate_case(state.case, volume_policy=state.policy)
