"""What `eclsim crrt-study` does with a cohort: fits, the study of every patient, one report."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.cli.messages import SOME_DID_NOT_CONVERGE, Progress, fail, resumable, say, warn

if TYPE_CHECKING:
    from eclsim.cases.cohort import CohortReading
    from eclsim.crrt_study.cohort import CohortStudy
    from eclsim.identification.fitted_cohort import FittedCases

_TABLES = (".csv", ".tsv")


@dataclass(frozen=True, slots=True)
class Request:
    """The options of the command, as they were written."""

    file: str
    settings: tuple[str, ...]
    schemes: str
    scheme_h: str
    speeds: str
    crrt_flow: float | None
    policy: str | None
    posterior: str | None
    out: str | None
    json: str | None
    explore: int
    resume: bool
    force: bool


def is_cohort(file: str) -> bool:
    """Whether the argument names a table or a folder and not a case file."""
    return Path(file).suffix.lower() in _TABLES or Path(file).is_dir()


def run(request: Request) -> None:
    """Fit or read the cases, study them, write, show."""
    _check(request)
    reading = _reading(request)
    with resumable(request.out), _progress() as progress, _fits(request) as fits:
        fitted = _from_folder(request) if reading is None else _fitted(request, reading, fits, progress)
        study = _study(request, fitted, progress)
    _write(request, study)
    if study.lost or study.unsettled:
        warn([f"{name}: {why}" for name, why in study.lost.items()])
        warn([f"{point.name}: {line}" for point in study.unsettled for line in point.unsettled])
        raise SystemExit(SOME_DID_NOT_CONVERGE)


def _check(request: Request) -> None:
    from eclsim.cli.output_option import destination
    from eclsim.crrt_study.cohort_names import FILES, FITS
    from eclsim.crrt_study.schemes import select_schemes
    from eclsim.crrt_study.settings import check_flow
    from eclsim.simulation.value_ranges import parse_speeds

    wrong = []
    if request.settings:
        wrong.append("--set: for a case file; change the table or the case files instead")
    if request.posterior is not None:
        wrong.append("--posterior: for a case file; it has the samples of one patient")
    if request.resume and request.force:
        wrong.append("--resume keeps the fits that are there and --force throws them away: one of them")
    if request.resume and request.out is None:
        wrong.append("--resume needs --out DIR")
    for option, check in (
        ("--schemes", lambda: select_schemes(request.schemes, request.scheme_h)),
        ("--speeds", lambda: parse_speeds(request.speeds)),
        ("--crrt-flow:", lambda: None if request.crrt_flow is None else check_flow(request.crrt_flow)),
    ):
        try:
            check()
        except ValueError as error:
            wrong.append(f"{option} {error}")
    if wrong:
        fail(*wrong)
    destination("--json", request.json, request.force, (request.file,))
    if request.out is None:
        return
    folder = Path(request.out)
    if folder.exists() and not folder.is_dir():
        fail(f"--out {folder}: a file; a folder belongs here")
    if not folder.absolute().parent.is_dir():
        fail(f"--out {folder}: the folder {folder.parent} does not exist")
    standing = [name for name in (*FILES, FITS) if (folder / name).exists()]
    if standing and not (request.force or request.resume):
        fail(f"--out {folder}: holds {standing[0]} already; --resume goes on, --force overwrites it")


def _reading(request: Request) -> CohortReading | None:
    """The table, checked; None for a folder of case files."""
    if Path(request.file).is_dir():
        return None
    from eclsim.cases.cohort import read_cohort
    from eclsim.inputs.mistakes import CaseError

    try:
        reading = read_cohort(request.file)
    except CaseError as error:
        fail(*error.mistakes)
    warn(reading.refused, "refused")
    warn(reading.warnings)
    if not reading.points:
        fail(f"{request.file}: no row can be used")
    return reading


def _from_folder(request: Request) -> FittedCases:
    from eclsim.cli.cases import read_all, with_speeds
    from eclsim.crrt_study.settings import policies_of
    from eclsim.identification.fitted_cohort import as_they_are

    files = sorted(str(path) for path in Path(request.file).glob("*.toml"))
    if not files:
        fail(f"{request.file}: holds no case file (*.toml)")
    readings = with_speeds(read_all(files, []), request.policy and policies_of(request.policy)[0])
    return as_they_are([reading.case for reading in readings], "case files")


def _fitted(
    request: Request, reading: CohortReading, folder: Path, progress: Callable[[str], None]
) -> FittedCases:
    from eclsim.identification.cohort_fit import StoreError
    from eclsim.identification.fitted_cohort import fit_points

    try:
        return fit_points(
            reading,
            folder,
            request.explore,
            request.resume,
            lambda text: progress(f"fits: {text}"),
            policy="patient_held" if request.policy == "patient_held" else "as_published",
        )
    except StoreError as error:
        fail(error)
    except OSError as error:
        fail(f"{error.filename or folder}: {error.strerror or error}")


@contextmanager
def _fits(request: Request) -> Iterator[Path]:
    """Folder that keeps the fits: in --out, else one that goes."""
    from eclsim.crrt_study.cohort_names import FITS

    if request.out is not None:
        folder = Path(request.out)
        folder.mkdir(exist_ok=True)
        yield folder / FITS
        return
    with tempfile.TemporaryDirectory(prefix="eclsim-") as name:
        yield Path(name) / FITS


@contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    progress = Progress()
    try:
        yield progress
    finally:
        progress.end()


def _study(request: Request, fitted: FittedCases, progress: Callable[[str], None]) -> CohortStudy:
    from eclsim.crrt_study.cohort import crrt_cohort
    from eclsim.crrt_study.settings import StudyError

    try:
        return crrt_cohort(
            fitted, schemes=request.schemes, speeds=request.speeds, crrt_flow_ml_min=request.crrt_flow,
            volume_policy=request.policy, scheme_h=request.scheme_h, progress=progress,
        )  # fmt: skip
    except StudyError as error:
        fail(error)


def _write(request: Request, study: CohortStudy) -> None:
    from eclsim.crrt_study import cohort_files as crrt_cohort

    try:
        if request.out is not None:
            crrt_cohort.write_cohort(study, Path(request.out))
        if request.json is not None:
            crrt_cohort.write_json(study, request.json)
    except BrokenPipeError:
        raise
    except OSError as error:
        fail(f"{error.filename or 'output'}: cannot be written: {error.strerror or error}")
    if request.json != "-":
        crrt_cohort.show(study)
    if request.out is not None:
        say(f"report: {Path(request.out) / 'report.html'}")
