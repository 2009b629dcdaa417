"""Options such as `--json FILE|-` of commands that write nothing else."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from eclsim.cli.messages import fail


def over_input(option: str, written: str | None, inputs: Sequence[str | None]) -> list[str]:
    """What is wrong with writing to a file that the command reads, in whichever way it is spelt."""
    if written is None or written == "-":
        return []
    same = (file for file in inputs if file is not None and _same(written, file))
    return [f"{option} {written}: an input of this command; it would be overwritten" for _ in list(same)[:1]]


def _same(one: str, other: str) -> bool:
    try:
        return os.path.samefile(one, other)
    except (OSError, ValueError):
        return False


def destination(
    option: str, written: str | None, force: bool, inputs: Sequence[str | None] = ()
) -> Path | str | None:
    """Checked before anything is computed: a file to write, "-" for standard output, or None."""
    if wrong := over_input(option, written, inputs):
        fail(*wrong)
    if written is None or written == "-":
        return written
    path = Path(written)
    if not written.strip():
        fail(f"{option}: an empty name")
    if path.is_dir():
        fail(f"{option} {path}: a folder; a file name belongs here")
    if not path.parent.is_dir():
        fail(f"{option} {path}: the folder {path.parent} does not exist")
    if path.exists() and not force:
        fail(f"{option} {path}: exists already; --force overwrites it")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        fail(f"{option} {path}: no permission to write to the folder {path.parent}")
    return path


def output_folder(written: str, holds: str | None = None) -> Path:
    """The folder of `--out`, checked: none there, or one that does not yet hold a file of that name."""
    folder = Path(written)
    if not written.strip():
        fail("--out: an empty name")
    if folder.exists() and not folder.is_dir():
        fail(f"--out {folder}: a file; a folder belongs here")
    if not folder.exists() and not folder.absolute().parent.is_dir():
        fail(f"--out {folder}: the folder {folder.parent} does not exist")
    if holds is not None and (folder / holds).exists():
        fail(f"--out {folder}: holds {holds}; --force overwrites it")
    return folder
