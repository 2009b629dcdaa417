"""Where results go, checked before anything is computed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from eclsim.cli.messages import fail
from eclsim.files import file_stems


@dataclass(frozen=True, slots=True)
class Request:
    """The options of a command line that name files and folders, as they were written."""

    json: str | None
    out: str | None
    figures: str | None
    csv: str | None
    force: bool
    transient_s: float


@dataclass(frozen=True, slots=True)
class Destinations:
    """Checked paths; `stems` are the beginnings of file names, one per case."""

    json: Path | str | None
    out: Path | None
    figures: Path | None
    csv: Path | None
    stems: tuple[str, ...]


def plan(
    request: Request, inputs: Sequence[str], ids: Sequence[str], tables: Sequence[str] = ("outputs",)
) -> Destinations:
    """Check that everything can be written; otherwise say all that is wrong and leave with exit status 2.

    Args:
        request: what the command line names.
        inputs: files that are read, and so must not be overwritten.
        ids: of the cases; file names begin with them.
        tables: names of CSV tables beside those of the cases.
    """
    wrong: list[str] = []
    stems = file_stems(ids)
    json_path = request.json if request.json in (None, "-") else _file("--json", request.json, request, wrong)
    out = _file("--out", request.out, request, wrong)
    if out is not None and out.suffix.lower() not in (".nc", ".nc4", ".h5", ".netcdf"):
        wrong.append(f"--out {out}: NetCDF is written; allowed: a name that ends in .nc")
    figures = _folder("--figures", request.figures, stems, request, wrong)
    csv = _folder("--csv", request.csv, [*stems, *tables], request, wrong)
    _refuse_inputs((json_path, out), inputs, wrong)
    if isinstance(json_path, Path) and out is not None and _same(json_path, out):
        wrong.append(f"--json and --out name the same file: {out}")
    if request.transient_s and not (request.out or request.csv):
        wrong.append("--transient needs --out FILE.nc or --csv DIR to write the course to")
    if wrong:
        fail(*wrong)
    return Destinations(json_path, out, figures, csv, stems)


def _file(option: str, written: str | None, request: Request, wrong: list[str]) -> Path | None:
    if written is None:
        return None
    path = Path(written)
    try:
        if not written.strip():
            wrong.append(f"{option}: an empty name")
        elif path.is_dir():
            wrong.append(f"{option} {path}: a folder; a file name belongs here")
        elif not path.parent.is_dir():
            wrong.append(f"{option} {path}: the folder {path.parent} does not exist")
        elif path.exists() and not request.force:
            wrong.append(f"{option} {path}: exists already; --force overwrites it")
        elif not os.access(path.parent, os.W_OK | os.X_OK):
            wrong.append(f"{option} {path}: no permission to write to the folder {path.parent}")
    except (OSError, ValueError) as error:
        wrong.append(f"{option} {written[:80]}: {getattr(error, 'strerror', None) or error}")
    return path


def _folder(
    option: str, written: str | None, stems: Sequence[str], request: Request, wrong: list[str]
) -> Path | None:
    if written is None:
        return None
    path = Path(written)
    try:
        _check_folder(option, path, stems, request.force, wrong)
    except (OSError, ValueError) as error:
        wrong.append(f"{option} {written[:80]}: {getattr(error, 'strerror', None) or error}")
    return path


def _check_folder(option: str, path: Path, stems: Sequence[str], force: bool, wrong: list[str]) -> None:
    if path.exists() and not path.is_dir():
        wrong.append(f"{option} {path}: a file; a folder belongs here")
        return
    nearest = path if path.exists() else path.parent
    if not nearest.is_dir():
        wrong.append(f"{option} {path}: the folder {nearest} does not exist")
    elif not os.access(nearest, os.W_OK | os.X_OK):
        wrong.append(f"{option} {path}: no permission to write to {nearest}")
    elif path.exists() and not force:
        starts = tuple(f"{stem}{end}" for stem in stems for end in (".", "_"))
        standing = sorted(item.name for item in path.iterdir() if item.name.startswith(starts))
        if standing:
            wrong.append(
                f"{option} {path}: holds results of these cases ({standing[0]}); --force overwrites them"
            )


def _refuse_inputs(paths: Sequence[Path | str | None], inputs: Sequence[str], wrong: list[str]) -> None:
    for path in paths:
        if isinstance(path, Path) and any(_same(path, Path(file)) for file in inputs):
            wrong.append(f"{path}: a case file of this command; it would be overwritten")


def _same(one: Path, other: Path) -> bool:
    try:
        return one.resolve() == other.resolve()
    except (OSError, RuntimeError):
        return False
