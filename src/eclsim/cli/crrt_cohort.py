"""What `eclsim crrt-study` does with a cohort: fits, the study of every patient, one report."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.cli.messages import SOME_DID_NOT_CONVERGE, fail, say, warn

if TYPE_CHECKING:
    from eclsim.patients.cohort import CohortReading
    from eclsim.studies.cohort_cases import FittedCases
    from eclsim.studies.crrt_cohort import CohortStudy

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
    policy: str
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
    with _progress() as progress, _fits(request) as fits:
        fitted = _from_folder(request) if reading is None else _fitted(request, reading, fits, progress)
        study = _study(request, fitted, progress)
    _write(request, study)
    unsettled = [point for point in study.points if point.unsettled]
    if study.lost or unsettled:
        warn([f"{name}: {why}" for name, why in study.lost.items()])
        warn([f"{point.name}: steady beats that were not found: {point.unsettled}" for point in unsettled])
        raise SystemExit(SOME_DID_NOT_CONVERGE)


def _check(request: Request) -> None:
    from eclsim.cli.output_option import destination
    from eclsim.report.crrt_cohort_names import FILES, FITS
    from eclsim.studies.crrt_schemes import select_schemes
    from eclsim.studies.speed_range import parse_speeds

    wrong = []
    if request.settings:
        wrong.append("--set: for a case file; change the table or the case files instead")
    if request.posterior is not None:
        wrong.append("--posterior: for a case file; it has the samples of one patient")
    if request.resume and request.force:
        wrong.append("--resume keeps the fits that are there and --force throws them away: one of them")
    if request.resume and request.out is None:
        wrong.append("--resume needs --out DIR")
    if request.crrt_flow is not None and not 0.0 < request.crrt_flow <= 1000.0:
        wrong.append(f"--crrt-flow {request.crrt_flow:g} mL/min; allowed: above 0, up to 1000")
    for option, check in (
        ("--schemes", lambda: select_schemes(request.schemes, request.scheme_h)),
        ("--speeds", lambda: parse_speeds(request.speeds)),
    ):
        try:
            check()
        except ValueError as error:
            wrong.append(f"{option} {error}")
    if wrong:
        fail(*wrong)
    destination("--json", request.json, request.force)
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
    from eclsim.patients.cohort import read_cohort
    from eclsim.patients.mistakes import CaseError

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
    from eclsim.cli.cases import read_all
    from eclsim.studies.cohort_cases import as_they_are

    files = sorted(str(path) for path in Path(request.file).glob("*.toml"))
    if not files:
        fail(f"{request.file}: holds no case file (*.toml)")
    return as_they_are([reading.case for reading in read_all(files, [])], "case files")


def _fitted(
    request: Request, reading: CohortReading, folder: Path, progress: Callable[[str], None]
) -> FittedCases:
    from eclsim.studies.cohort_cases import fit_points
    from eclsim.studies.cohort_fit import StoreError

    try:
        return fit_points(
            reading, folder, request.explore, request.resume, lambda text: progress(f"fits: {text}")
        )
    except StoreError as error:
        fail(error)
    except OSError as error:
        fail(f"{error.filename or folder}: {error.strerror or error}")


@contextmanager
def _fits(request: Request) -> Iterator[Path]:
    """Folder that keeps the fits: in --out, else one that goes."""
    from eclsim.report.crrt_cohort_names import FITS

    if request.out is not None:
        folder = Path(request.out)
        folder.mkdir(exist_ok=True)
        yield folder / FITS
        return
    with tempfile.TemporaryDirectory(prefix="eclsim-") as name:
        yield Path(name) / FITS


@contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status("computing ...") as status:
        yield status.update


def _study(request: Request, fitted: FittedCases, progress: Callable[[str], None]) -> CohortStudy:
    from eclsim.studies.crrt_cohort import crrt_cohort
    from eclsim.studies.crrt_settings import StudyError

    try:
        return crrt_cohort(
            fitted, schemes=request.schemes, speeds=request.speeds, crrt_flow_ml_min=request.crrt_flow,
            volume_policy=request.policy, scheme_h=request.scheme_h, progress=progress,
        )  # fmt: skip
    except StudyError as error:
        fail(error)


def _write(request: Request, study: CohortStudy) -> None:
    from eclsim.report import crrt_cohort

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
