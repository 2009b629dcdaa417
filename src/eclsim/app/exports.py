"""Files to take away: case, tables, figures, the CRRT study. Each is made in a folder that goes away."""

from __future__ import annotations

import tempfile
import zipfile
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.files import file_stems
from eclsim.inputs.sections import MAXIMUM_ID_LENGTH

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.app.state import PageState
    from eclsim.cases.case import Case

CHANGED = " (changed)"
"""Behind the id of a patient whose case was changed by hand on the page."""
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
    state = replace(state, case=_as_shown(state))
    (stem,) = file_stems([state.case.patient.id])
    if kind == "case":
        from eclsim.cases.writing import case_text

        return f"{stem}.toml", case_text(state.case).encode()
    if kind in ("outputs", "waveforms"):
        return _table(state, kind, stem)
    if kind in ("svg", "png"):
        return _figures(state, kind, stem)
    if kind == "study":
        return _study(state, stem)
    raise ExportError(f"no such file: {kind[:20]}")


def _as_shown(state: PageState) -> Case:
    """The case with the policy of its beat; one that was changed by hand says so in its id."""
    case = state.case
    if case.volume_policy != state.policy:
        case = case.with_volume_policy(state.policy)
    if not state.changed or case.patient.id.endswith(CHANGED):
        return case
    name = case.patient.id[: MAXIMUM_ID_LENGTH - len(CHANGED)] + CHANGED
    return case.model_copy(update={"patient": case.patient.model_copy(update={"id": name})})


def _table(state: PageState, kind: str, stem: str) -> tuple[str, bytes]:
    from eclsim.simulation.files import write_csv

    with tempfile.TemporaryDirectory(prefix="eclsim-") as folder:
        write_csv([_simulated(state)], [], Path(folder), [stem], None)
        name = f"{stem}_waveforms.csv" if kind == "waveforms" else "outputs.csv"
        return (name if kind == "waveforms" else f"{stem}_outputs.csv"), (Path(folder) / name).read_bytes()


def _figures(state: PageState, kind: str, stem: str) -> tuple[str, bytes]:
    from eclsim.simulation.files import write_figures

    with tempfile.TemporaryDirectory(prefix="eclsim-") as folder:
        write_figures([state.case], [_simulated(state)], Path(folder), [stem])
        packed = BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in sorted(Path(folder).rglob(f"*.{kind}")):
                archive.write(path, path.name)
    return f"{stem}_figures_{kind}.zip", packed.getvalue()


def _study(state: PageState, stem: str) -> tuple[str, bytes]:
    from eclsim.crrt_study.drawings import drawings
    from eclsim.crrt_study.page import study_page
    from eclsim.crrt_study.settings import StudyError
    from eclsim.crrt_study.study import crrt_study

    try:
        study = crrt_study(state.case, volume_policy=state.policy)
    except StudyError as error:
        raise ExportError(str(error)) from None
    return f"{stem}_crrt_study.html", study_page(study, drawings(study)).encode()


def _simulated(state: PageState) -> xr.Dataset:
    from eclsim.simulation.single import simulate_case

    return simulate_case(state.case, volume_policy=state.policy)
