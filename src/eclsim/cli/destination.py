"""Destinations of a command's output: checked before computing, locked while running, named in errors."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from eclsim.cli.console import fail, is_output_closed, refuse, say
from eclsim.execution import ExecutionError
from eclsim.files import LOCK, write_json

STANDARD_OUTPUT = "-"
Target = Path | str | None
"""A path, "-" for standard output, or None for nothing."""
NETCDF = (".nc", ".nc4", ".h5", ".netcdf")


class Destinations:
    """Files and folders named by the options of a command, with the errors found in them.

    Args:
        force: Whether existing files may be overwritten.
        inputs: Files that the command reads and therefore must not overwrite.
        resume: Whether the command continues from results in a folder; None for a command that cannot.
    """

    def __init__(self, *, force: bool, inputs: Sequence[str | None] = (), resume: bool | None = None):
        self.overwrites = force or bool(resume)
        self.way_out = f"{'' if resume is None else '--resume goes on, '}--force overwrites it"
        self.inputs = [Path(file) for file in inputs if file is not None]
        self.files: dict[str, Path] = {}
        self.mistakes: list[str] = []
        if resume and force:
            self.mistakes.append("--resume keeps what is there and --force throws it away: give one of them")

    def check(self) -> None:
        """Exit with status 2 if there are errors."""
        refuse(list(dict.fromkeys(self.mistakes)))

    def target(self, option: str, written: str | None) -> Target:
        """Check the destination of an option: a file, "-" for standard output, or None."""
        if written != STANDARD_OUTPUT:
            return self.file(option, written)
        if is_output_closed():
            self.mistakes.append(f"{option} -: standard output is closed; give a file")
        return written

    def file(self, option: str, written: str | None, suffixes: Sequence[str] = ()) -> Path | None:
        """Check a file to be written, and return its path; None if none is given."""
        if written is None:
            return None
        path = Path(written)
        self._collect(option, written, lambda: self._wrong_file(path))
        if suffixes and path.suffix.lower() not in suffixes:
            self.mistakes.append(
                f"{option} {path}: the output is NetCDF; allowed: a name that ends in {suffixes[0]}"
            )
        self.mistakes += [
            f"{other} and {option} name the same file: {path}"
            for other, target in self.files.items()
            if _is_same(path, target)
        ]
        self.files[option] = path
        return path

    def folder(
        self,
        option: str,
        written: str | None,
        names: Sequence[str] = (),
        *,
        stems: Sequence[str] = (),
        parents: bool = False,
    ) -> Path | None:
        """Check a folder for output and return its path, without creating it; None if none is given.

        Args:
            option: name of the option.
            written: folder as written.
            names: files that the command writes there; existing ones are an error unless they may be
                overwritten.
            stems: beginnings of the names of further such files, before "." or "_".
            parents: whether parent folders are created as well.
        """
        if written is None:
            return None
        path = Path(written)
        self._collect(option, written, lambda: self._wrong_folder(path, names, stems, parents))
        return path

    def _collect(self, option: str, written: str, wrong: Callable[[], str]) -> None:
        try:
            message = wrong() if written.strip() else "an empty name"
        except (OSError, ValueError) as error:
            message = getattr(error, "strerror", None) or str(error)
        if message:
            self.mistakes.append(f"{option} {written[:200]}".rstrip() + f": {message}")

    def _wrong_file(self, path: Path) -> str:
        if path.is_dir():
            return "is a folder; give a file name"
        if not path.parent.is_dir():
            return f"the folder {path.parent} does not exist"
        if any(_is_same(path, file) for file in self.inputs):
            return "is an input of this command and would be overwritten"
        if path.exists() and not self.overwrites:
            return "already exists; --force overwrites it"
        return _unwritable(path.parent)

    def _wrong_folder(self, path: Path, names: Sequence[str], stems: Sequence[str], parents: bool) -> str:
        if path.exists() and not path.is_dir():
            return "is a file; give a folder"
        if not path.exists():
            above = path.absolute().parent
            if not parents and not above.is_dir():
                return f"the folder {path.parent} does not exist"
            return "" if parents else _unwritable(above)
        if not self.overwrites:
            if existing := [name for name in names if (path / name).exists()]:
                return f"holds {existing[0]} already; {self.way_out}"
            beginnings = tuple(f"{stem}{end}" for stem in stems for end in "._")
            if existing := sorted(item.name for item in path.iterdir() if item.name.startswith(beginnings)):
                return f"holds results of these cases ({existing[0]}); --force overwrites them"
        return _unwritable(path)


def _unwritable(folder: Path) -> str:
    return "" if os.access(folder, os.W_OK | os.X_OK) else f"no permission to write to the folder {folder}"


def _is_same(first: Path, second: Path) -> bool:
    try:
        return first.resolve() == second.resolve() or os.path.samefile(first, second)
    except (OSError, ValueError, RuntimeError):
        return False


def write_json_output(content: object, target: Target) -> bool:
    """Write JSON if it was requested; return whether standard output is free for text."""
    if target is not None:
        write_json(content, target)
    return target != STANDARD_OUTPUT


@contextmanager
def reporting_write_errors(place: object = "output") -> Iterator[None]:
    """Report a file that cannot be written, and exit with status 2."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        fail(f"{error.filename or place}: cannot be written: {error.strerror or error}")


@contextmanager
def explaining_resume(folder: str | os.PathLike[str] | None) -> Iterator[None]:
    """Context of a command that keeps finished tasks: after Ctrl-C or SIGTERM, explain how to continue.

    If the tasks cannot run, or the folder contains other tasks, exit with status 2.
    """
    try:
        yield
    except ExecutionError as error:
        fail(error)
    except (KeyboardInterrupt, SystemExit) as stopped:
        if folder is not None and is_signal(stopped):
            say(f"{folder}: finished results are kept; the same command with --resume goes on")
        raise


def is_signal(stopped: KeyboardInterrupt | SystemExit) -> bool:
    """Whether Ctrl-C or SIGTERM ended a command."""
    return isinstance(stopped, KeyboardInterrupt) or stopped.code in (130, 143)


@contextmanager
def locked(folder: str | os.PathLike[str] | None, shard: str = "") -> Iterator[None]:
    """Lock a folder while a command writes to it; exit with status 2 if another command has locked it.

    The operating system releases the lock when a process ends for any reason. A folder that was created for
    the lock is removed again if it stayed empty.

    Args:
        folder: folder of the results; None if the command writes none.
        shard: shard, such as "3/16", of an analysis whose shards run side by side in one folder.
    """
    if folder is None or not _can_be_folder(folder := Path(folder)):
        yield  # the command reports the error
        return
    made = not folder.exists()
    try:
        folder.mkdir(exist_ok=True)
        file = _opened(folder / f"{LOCK}{'-' if shard else ''}{shard.replace('/', '-of-')}")
    except OSError as error:
        fail(f"--out {folder}: cannot be written: {error.strerror or error}")
    with file:
        try:
            _write_holder(file, folder)
            yield
        finally:
            if sys.platform != "win32":  # Windows cannot remove an open file, so it stays, unlocked
                Path(file.name).unlink(missing_ok=True)
            if made and not any(folder.iterdir()):
                folder.rmdir()


def _can_be_folder(path: Path) -> bool:
    try:
        return bool(path.name) and (path if path.exists() else path.absolute().parent).is_dir()
    except (OSError, ValueError):
        return False


def _opened(path: Path) -> IO[str]:
    """Open and lock the file that is at the path now; a previous process may have removed the one opened."""
    while True:
        file = path.open("a+", encoding="utf-8")
        if not _acquire(file):
            with file:
                fail(
                    f"--out {path.parent}: in use by {_read_holder(file)}; wait for it, or choose another "
                    "folder"
                )
        if path.exists() and os.path.samestat(os.fstat(file.fileno()), path.stat()):
            return file
        file.close()


def _acquire(file: IO[str]) -> bool:
    """Try to lock a file; return whether this process holds the lock."""
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


def _write_holder(file: IO[str], folder: Path) -> None:
    file.seek(0)
    file.truncate()
    command = " ".join(["eclsim", *sys.argv[1:2]])
    holder = f"process {os.getpid()} ({command}, since {time.strftime('%H:%M:%S')})"
    try:
        os.write(file.fileno(), holder.encode())  # without a buffer, which could not be emptied on closing
    except OSError as error:
        fail(f"--out {folder}: cannot be written: {error.strerror or error}")


def _read_holder(file: IO[str]) -> str:
    try:
        file.seek(0)
        return file.read(200).strip() or "another eclsim command"
    except OSError:
        return "another eclsim command"
