"""Record in a folder of results: the command that they belong to, and the options that its shards share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from os.path import exists, isdir
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from eclsim.cli.console import fail, say
from eclsim.cli.destination import is_signal
from eclsim.execution import ExecutionError, ShardDone
from eclsim.execution.folder import read_inputs
from eclsim.files import LOCK, write_json

if TYPE_CHECKING:
    from eclsim.cli.options import Distributed

COMMAND = "command.json"
EXECUTION_OPTIONS = ("out", "folder", "json", "workers", "dask", "shard", "resume", "force")
"""Options that do not change results; they may differ between shards."""
_FILES_OF = {
    "course": [("courses.json", "courses"), ("*_course.csv", "*_course.nc")],
    "crrt_study": [
        ("study.json", "study.nc"),
        ("cohort.json", "points.csv", "schemes.csv"),
        ("fits/groups",),
        ("studies-*/inputs.json",),
    ],
    "identify": [("identification.json", "parameters.csv")],
    "reproduce": [("reproduction.json", "reproduction.csv"), ("runs/positions",), ("runs/cohort",)],
    "sensitivity": [("design.json", "samples.parquet"), ("design.json", "blocks")],
    "track": [("track.json",), ("patients/inputs.json",)],
    "validate": [("robustness/inputs.json",), ("adaptive/inputs.json",)],
}
"""Files by which results without a record are recognised, of each command: all of one of the sets."""


@contextmanager
def recorded(options: Distributed, command: str) -> Iterator[None]:
    """Context of a command that records it in its folder of results; a shard ends here when it is done.

    The record stays as long as results do. If the folder holds results of another command, or a shard with
    other options, exit with status 2 before anything is computed.

    Args:
        options: options of the command.
        command: name of the command's function.
    """
    if options.locked_folder[0] is None:
        yield
        return
    folder = Path(options.locked_folder[0])
    refuse_results_of_others(folder, command)
    check_other_shards(options, folder)
    before, is_new, ended = results_in(folder), not exists(folder / COMMAND), False
    if is_new and isdir(folder):  # before any result, as a process may be killed
        write_json({"command": command}, folder / COMMAND)
    try:
        yield
        ended = True
    except ShardDone as done:
        ended = True
        say(f"{done}; when all shards are done: eclsim merge {folder}")
    except typer.Exit:  # finished, although not everything converged
        ended = True
        raise
    except (KeyboardInterrupt, SystemExit) as stopped:
        ended = is_signal(stopped) and not options.merges
        raise
    finally:
        if is_new and results_in(folder) == before:
            if exists(folder / COMMAND):
                (folder / COMMAND).unlink()
        elif ended:
            _record_end(options, command, folder)


def results_in(folder: Path) -> set[str]:
    """Names of the files in a folder, without the locks of running commands and the record."""
    if not isdir(folder):  # also of a name that no file can have
        return set()
    return {item.name for item in folder.iterdir() if not item.name.startswith(LOCK)} - {COMMAND}


def refuse_results_of_others(folder: Path, command: str) -> None:
    """Exit with status 2 if a folder holds results of other commands alone: they would be mixed."""
    others = _commands_of(folder)
    if others and command not in others:
        names = " and ".join(f"eclsim {name.replace('_', '-')}" for name in others)
        fail(f"--out {folder}: holds results of {names}; choose another folder for those of this command")


def _commands_of(folder: Path) -> list[str]:
    """Names of the commands whose results a folder holds: of its record, or by the files present."""
    if not isdir(folder):
        return []
    try:
        command = (read_inputs(folder / COMMAND) or {}).get("command")
    except ExecutionError:  # its shards are refused, other commands go by the files
        command = None
    if isinstance(command, str):
        return [command]
    return [
        name
        for name, sets in _FILES_OF.items()
        if any(all(any(folder.glob(file)) for file in files) for files in sets)
    ]


def check_other_shards(options: Distributed, folder: Path) -> None:
    """Exit with status 2 if a shard in the folder had other options: no merge could finish both."""
    file = folder / COMMAND
    if options.shard is None or options.merges or not exists(file):
        return
    try:
        known = (read_inputs(file) or {}).get("options")
    except ExecutionError as error:
        fail(error)
    before = known if isinstance(known, dict) else {}
    changed = [
        f"{name} was {before[name]!r} and is {value!r}"
        for name, value in _own_options(options).items()
        if name in before and _without_folders(before[name]) != _without_folders(value)
    ]
    if changed:
        fail(
            f"--shard {options.shard}: a shard in {folder} was run with other options "
            f"({'; '.join(changed)}); choose another folder, or remove {file}"
        )


def _record_end(options: Distributed, command: str, folder: Path) -> None:
    """Record a command that ended, with what `eclsim merge` needs to repeat it if it was a shard."""
    file = folder / COMMAND
    if options.shard is not None and not options.merges:
        check_other_shards(options, folder)
        shards = int(options.shard.partition("/")[2])
        write_json({"command": command, "options": _own_options(options), "shards": shards}, file)
    elif options.merges or options.force or not file.exists():
        write_json({"command": command}, file)


def _own_options(options: Distributed) -> dict[str, object]:
    return {name: value for name, value in asdict(options).items() if name not in EXECUTION_OPTIONS}


def _without_folders(value: object) -> object:
    """An option without the folders of a path, which differ between machines."""
    if isinstance(value, list):
        return list(map(_without_folders, value))
    return Path(value).name if isinstance(value, str) else value
