"""Files: written completely or not at all; finite JSON, NetCDF, guarded CSV; file names made from ids."""

from __future__ import annotations

import csv
import errno
import io
import json
import math
import os
import re
import shutil
import sys
import tempfile
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, TypeVar, overload

from eclsim._version import __version__

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

MADE_BY = "made_by"
"""Key in every JSON object, and attribute of every NetCDF file, that states the version that wrote it."""
VERSION_NAME = f"eclsim {__version__}"
NOTICE = "for research only, not for treatment"
"""Intended use, stated in figures and NetCDF files, which are passed on without their page."""
ORIGIN = {MADE_BY: VERSION_NAME}
"""Attributes of every labelled result, so that a file that a user writes from it states its version."""

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"
_Cell = TypeVar("_Cell")

PARTIAL, LOCK = ".eclsim-", ".eclsim-lock"
"""Beginning of the name of a file that is being written, and of the lock of a folder that is in use."""
_FILE_MODE = 0o644
# HDF5 buries the system's error number in a long text, and sometimes raises RuntimeError instead of OSError.
_HDF5_ERROR = re.compile(r"file write failed: .*?errno = (\d+)", re.DOTALL)
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")
"""A number as it is written in tables and case files."""
_LONGEST_STEM = 60


@contextmanager
def whole_file(path: Path, least_bytes: int = 0) -> Iterator[Path]:
    """Yield a temporary file beside the target, which replaces the target once everything is written.

    Args:
        path: the target; an existing file is replaced.
        least_bytes: lower bound on the bytes to be written; the free space is checked first, as HDF5 may
            crash on a full disk.

    Raises:
        OSError: If writing fails; its file name is the target, also for a full disk, where the system gives
            none.
    """
    partial: Path | None = None
    try:
        if least_bytes and least_bytes > shutil.disk_usage(path.parent).free:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        handle, name = tempfile.mkstemp(prefix=PARTIAL, suffix=path.suffix, dir=path.parent)
        os.close(handle)
        partial = Path(name)
        yield partial
        partial.chmod(_FILE_MODE)
        partial.replace(path)
    except BaseException as error:
        if partial is not None:
            partial.unlink(missing_ok=True)
        if (number := _HDF5_ERROR.search(str(error))) is not None:
            raise OSError(int(number[1]), os.strerror(int(number[1])), str(path)) from None
        if isinstance(error, OSError):
            error.filename, error.filename2 = str(path), None
        raise


def write_text(text: str, destination: Path | str) -> None:
    """Write a text as UTF-8; "-" is standard output."""
    if destination == "-":
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except OSError as error:
            error.filename = "standard output"
            raise
        return
    with whole_file(Path(destination)) as partial:
        partial.write_text(text, encoding="utf-8", newline="")


def write_texts(folder: Path, texts: Mapping[str, str]) -> list[Path]:
    """Write texts by name to a folder, which is created if necessary, and return the paths of the files."""
    folder.mkdir(exist_ok=True)
    for name, text in texts.items():
        write_text(text, folder / name)
    return [folder / name for name in texts]


# --- JSON -----------------------------------------------------------------------------------------


@overload
def finite(value: float | None, digits: int | None = None) -> float | None: ...
@overload
def finite(value: object, digits: int | None = None) -> Json: ...
def finite(value: object, digits: int | None = None) -> Json:
    """Convert data to plain data for JSON: None for numbers that are not finite, lists for tuples and arrays.

    Args:
        value: numbers, texts, arrays, and lists, tuples and mappings of them.
        digits: significant digits to which numbers are rounded; None for no rounding.
    """
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return float(value if digits is None else f"{value:.{digits}g}")
    if isinstance(value, dict):
        return {str(key): finite(item, digits) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item, digits) for item in value]
    if (as_plain := getattr(value, "tolist", None)) is not None:  # NumPy's scalars and arrays
        return finite(as_plain(), digits)
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def json_text(data: object) -> str:
    """Format data as JSON: an object states the version that wrote it; non-finite numbers become null."""
    marked = {**ORIGIN, **data} if isinstance(data, dict) else data
    return json.dumps(finite(marked), indent=1, allow_nan=False) + "\n"


def write_json(data: object, destination: Path | str) -> None:
    """Write data as JSON; "-" is standard output."""
    write_text(json_text(data), destination)


# --- NetCDF ---------------------------------------------------------------------------------------


def write_netcdf(datasets: Mapping[str, xr.Dataset], path: Path) -> None:
    """Write datasets to one file, with version and intended use; the group "" is the root of the file.

    Attributes that are lists of sentences are stored as one text, a line each: NetCDF cannot hold an empty
    list.
    """
    from xarray.backends import H5NetCDFStore

    with whole_file(path, sum(data.nbytes for data in datasets.values())) as partial:
        for count, (group, data) in enumerate(datasets.items()):
            texts = {name: "\n".join(value) for name, value in data.attrs.items() if isinstance(value, list)}
            stored = data.assign_attrs(texts | ORIGIN | {"intended_use": NOTICE})
            stored = stored.map(lambda one: one.astype(str) if one.dtype == object else one, keep_attrs=True)
            mode = "a" if count else "w"
            # `to_netcdf` loads Dask, where it is installed, to find a lock that no single process needs
            with H5NetCDFStore.open(str(partial), mode, group=group or None, lock=False) as store:
                stored.dump_to_store(store)


# --- CSV ------------------------------------------------------------------------------------------


def guarded(cell: _Cell) -> _Cell | str:
    """Put an apostrophe before a text that a spreadsheet would run as a formula; other cells stay as is.

    A number with a sign, such as "-50", is no formula, and with an apostrophe it would be no number.
    """
    is_formula = isinstance(cell, str) and cell.startswith(_FORMULA_STARTS) and not NUMBER.fullmatch(cell)
    return f"'{cell}" if is_formula else cell


def unguarded(text: str) -> str:
    """Remove the apostrophe that `guarded` put before a text."""
    return text[1:] if text[:1] == "'" and text[1:].startswith(_FORMULA_STARTS) else text


def grouped_by(column: str, rows: Iterable[dict[str, str]]) -> dict[str, list[dict[str, str]]]:
    """Rows of a table by the words in a column, wherever in the table they stand."""
    groups: dict[str, list[dict[str, str]]] = {}
    for row in rows:
        groups.setdefault(row[column], []).append(row)
    return groups


def read_table(path: Path) -> list[dict[str, str]]:
    """Rows of a table of constants that is part of the program."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def csv_text(head: Sequence[str], rows: Iterable[Iterable[object]], digits: int | None = 8) -> str:
    """Format a table as CSV with formulas guarded; NaN becomes an empty cell.

    Args:
        head: column names.
        rows: cells of each row.
        digits: significant digits of floats; None for all.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([guarded(name) for name in head])
    writer.writerows([_cell(cell, digits) for cell in row] for row in rows)
    return buffer.getvalue()


def frame_text(frame: pd.DataFrame) -> str:
    """Format a data frame as CSV without its index, with formulas guarded."""
    return frame.map(guarded).to_csv(index=False, lineterminator="\n")


def _cell(value: object, digits: int | None) -> object:
    if isinstance(value, float):
        if math.isnan(value):
            return ""
        return value if digits is None else f"{value:.{digits}g}"
    return guarded(value)


# --- names of files -------------------------------------------------------------------------------


def file_stem(name: str) -> str:
    """Return the readable beginning of a file name for a single id, see `file_stems`."""
    return file_stems([name])[0]


def file_stems(names: Sequence[str]) -> tuple[str, ...]:
    """Return a readable beginning of a file name for each id: letters, digits, dots, dashes, underscores.

    Letters of any script are kept; anything else becomes `_`. Ids that would have the same beginning, which
    a file system may not tell apart by capital letters, get different numbers.
    """
    taken: set[str] = set()
    stems = []
    for name in names:
        text = re.sub(r"[^\w.-]+", "_", unicodedata.normalize("NFC", name))
        base = text[:_LONGEST_STEM].strip("._") or "case"
        stem, count = base, 1
        while stem.casefold() in taken:
            count += 1
            stem = f"{base}-{count}"
        taken.add(stem.casefold())
        stems.append(stem)
    return tuple(stems)
