"""One command at a time writes to a folder; the second is told which one does."""

from __future__ import annotations

import functools
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from eclsim.cli.messages import fail

LOCK = ".eclsim-lock"


def holding(command: Callable[..., None], *names: str) -> Callable[..., None]:
    """The command, which holds the folder that its option `out` names while it runs.

    Args:
        command: a function with an option for each argument; `shard`, where it has one, is the part.
        names: other options or arguments that may name the folder in place of `out`.
    """

    @functools.wraps(command)
    def held(**options: Any) -> None:
        shard = str(options.get("shard") or "").replace("/", "-of-")
        given = (options[name] for name in ("out", *names) if options[name] is not None)
        with locked(next(given, None), f"-{shard}" if shard else ""):
            command(**options)

    return held


@contextmanager
def locked(folder: str | os.PathLike[str] | None, part: str = "") -> Iterator[None]:
    """Hold a folder while a command writes to it; leave with exit status 2 where another command does.

    The operating system gives the lock up when a process ends, however it ends. A folder that had to be made
    for the lock and stayed empty is taken away again.

    Args:
        folder: of the results; None where a command writes none.
        part: of an analysis whose parts are run side by side into one folder, such as a shard.
    """
    if folder is None or not _can_be_folder(folder := Path(folder)):
        yield  # what is wrong with it is said by the command
        return
    made = not folder.exists()
    try:
        folder.mkdir(exist_ok=True)
        file = _opened(folder / f"{LOCK}{part}")
    except OSError as error:
        fail(f"--out {folder}: cannot be written: {error.strerror or error}")
    with file:
        _say_who(file)
        try:
            yield
        finally:
            _released(file)
            if made and not any(folder.iterdir()):
                folder.rmdir()


def _can_be_folder(path: Path) -> bool:
    try:
        return bool(path.name) and (path if path.exists() else path.absolute().parent).is_dir()
    except (OSError, ValueError):
        return False


def _opened(path: Path) -> IO[str]:
    """The file with its lock; the one that stands under the path, which a process before may have removed."""
    while True:
        file = path.open("a+", encoding="utf-8")
        if not _taken(file):
            with file:
                fail(f"--out {path.parent}: in use by {_holder(file)}; wait for it, or choose another folder")
        if path.exists() and os.path.samestat(os.fstat(file.fileno()), path.stat()):
            return file
        file.close()


def _taken(file: IO[str]) -> bool:
    """Whether this process has the lock now."""
    try:
        if sys.platform == "win32":
            import msvcrt

            file.seek(0)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _say_who(file: IO[str]) -> None:
    file.seek(0)
    file.truncate()
    command = " ".join(["eclsim", *sys.argv[1:2]])
    file.write(f"process {os.getpid()} ({command}, since {time.strftime('%H:%M:%S')})")
    file.flush()


def _holder(file: IO[str]) -> str:
    try:
        file.seek(0)
        return file.read(200).strip() or "another eclsim command"
    except OSError:
        return "another eclsim command"


def _released(file: IO[str]) -> None:
    """Take the file away; on Windows that works only once it is closed, so it stays, unlocked."""
    if sys.platform != "win32":
        Path(file.name).unlink(missing_ok=True)
