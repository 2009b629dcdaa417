"""Files that any room writes: whole or not at all; finite JSON, NetCDF, guarded CSV, names made from ids."""

from __future__ import annotations

import csv
import errno
import hashlib
import io
import json
import math
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, TypeVar, overload

from eclsim._version import __version__

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

MADE_BY = "made_by"
"""Key of every JSON object and attribute of every NetCDF file that says which version wrote it."""
VERSION_NAME = f"eclsim {__version__}"

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"
_Cell = TypeVar("_Cell")

_FILE_MODE = 0o644
# HDF5 puts the number of the system's error into a page of text, and raises RuntimeError at times.
_HDF5_ERROR = re.compile(r"file write failed: .*?errno = (\d+)", re.DOTALL)
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
_LONGEST_STEM = 60


@contextmanager
def whole_file(path: Path, least_bytes: int = 0) -> Iterator[Path]:
    """A temporary file beside the target that takes its name when everything is written.

    Args:
        path: the target; an existing file is replaced.
        least_bytes: what will be written at least; looked for beforehand, as HDF5 may crash on a full disk.

    Raises:
        OSError: With the target as its file name; of itself a full disk names none.
    """
    partial: Path | None = None
    try:
        if least_bytes and least_bytes > shutil.disk_usage(path.parent).free:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        handle, name = tempfile.mkstemp(prefix=".eclsim-", suffix=path.suffix, dir=path.parent)
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
        sys.stdout.write(text)
        sys.stdout.flush()
        return
    with whole_file(Path(destination)) as partial:
        partial.write_text(text, encoding="utf-8", newline="")


# --- JSON -----------------------------------------------------------------------------------------


@overload
def finite(value: float | None, digits: int | None = None) -> float | None: ...
@overload
def finite(value: object, digits: int | None = None) -> Json: ...
def finite(value: object, digits: int | None = None) -> Json:
    """Plain data for JSON: None for a number that is not finite, lists for tuples and arrays.

    Args:
        value: numbers, texts, arrays, and lists, tuples and mappings of them.
        digits: significant digits that numbers are rounded to; left out, nothing is rounded.
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
    """Data as JSON text, an object with the version that wrote it; null for numbers that are not finite."""
    marked = {MADE_BY: VERSION_NAME, **data} if isinstance(data, dict) else data
    return json.dumps(finite(marked), indent=1, allow_nan=False) + "\n"


def write_json(data: object, destination: Path | str) -> None:
    """Write data as JSON; "-" is standard output."""
    write_text(json_text(data), destination)


# --- NetCDF ---------------------------------------------------------------------------------------


def write_netcdf(datasets: Mapping[str, xr.Dataset], path: Path) -> None:
    """Write datasets with the version that wrote them into one file; the group "" is its root.

    Lists of sentences become texts, a line each, since NetCDF holds no empty list.
    """
    with whole_file(path, sum(data.nbytes for data in datasets.values())) as partial:
        for count, (group, data) in enumerate(datasets.items()):
            texts = {name: "\n".join(value) for name, value in data.attrs.items() if isinstance(value, list)}
            stored = data.assign_attrs(texts | {MADE_BY: VERSION_NAME})
            stored = stored.map(lambda one: one.astype(str) if one.dtype == object else one, keep_attrs=True)
            stored.to_netcdf(partial, mode="a" if count else "w", group=group or None, engine="h5netcdf")


# --- CSV ------------------------------------------------------------------------------------------


def guarded(cell: _Cell) -> _Cell | str:
    """A text that a spreadsheet would run as a formula behind an apostrophe; everything else as it is."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(_FORMULA_STARTS) else cell


def unguarded(text: str) -> str:
    """The text that `guarded` was given."""
    return text[1:] if text[:1] == "'" and text[1:].startswith(_FORMULA_STARTS) else text


def csv_text(head: Sequence[str], rows: Iterable[Iterable[object]], digits: int | None = 8) -> str:
    """A table as CSV, formulas guarded; a cell without a number is empty.

    Args:
        head: names of the columns.
        rows: cells.
        digits: significant digits of numbers; None for all.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([guarded(name) for name in head])
    writer.writerows([_cell(cell, digits) for cell in row] for row in rows)
    return buffer.getvalue()


def frame_text(frame: pd.DataFrame) -> str:
    """A data frame as CSV without its index, formulas guarded."""
    return frame.map(guarded).to_csv(index=False, lineterminator="\n")


def _cell(value: object, digits: int | None) -> object:
    if isinstance(value, float):
        if math.isnan(value):
            return ""
        return value if digits is None else f"{value:.{digits}g}"
    return guarded(value)


# --- names of files -------------------------------------------------------------------------------


def file_stem(name: str, *, slashes: bool = False) -> str:
    """The beginning of a file name for an id; ids that differ get beginnings that differ.

    ASCII letters, digits, `.`, `-` and `_` stay; an id with anything else, or a long one, gets a mark of the
    whole id behind it.

    Args:
        name: the id.
        slashes: whether ids are made of parts with a slash between: it becomes `_`, and an id that has a `_`
            of its own gets a mark.
    """
    safe = re.sub(r"[^A-Za-z0-9._-]", "_", name)[:_LONGEST_STEM].strip(".")
    unchanged = safe == name.replace("/", "_") and "_" not in name if slashes else safe == name
    if safe and unchanged:
        return safe
    mark = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:8]
    return f"{safe or 'case'}_{mark}"


def file_stems(names: Sequence[str]) -> tuple[str, ...]:
    """A readable beginning of file names for each id: letters, digits, dots and dashes, all different."""
    taken: set[str] = set()
    stems = []
    for name in names:
        base = re.sub(r"[^\w.-]+", "_", name)[:_LONGEST_STEM].strip("._") or "case"
        stem, count = base, 1
        while stem.casefold() in taken:
            count += 1
            stem = f"{base}-{count}"
        taken.add(stem.casefold())
        stems.append(stem)
    return tuple(stems)
