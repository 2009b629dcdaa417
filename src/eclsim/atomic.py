"""Files that appear whole under their name or not at all; what cannot be written is named in the error."""

from __future__ import annotations

import errno
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_FILE_MODE = 0o644
# HDF5 puts the number of the system's error into a page of text, and raises RuntimeError at times.
_HDF5_ERROR = re.compile(r"file write failed: .*?errno = (\d+)", re.DOTALL)


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
