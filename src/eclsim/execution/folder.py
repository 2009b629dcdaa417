"""Folder of task results: each file is complete or absent, and all results belong to the same inputs.

inputs.json     everything that determines the results, with version and fingerprint
00003.json      result of task 3, in the form given by its `Format`
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from eclsim._version import __version__
from eclsim.arguments import Kind
from eclsim.files import whole_file

Result = TypeVar("Result")
_NOT_COMPARED = ("hash", "samples", "warnings")
_MOST_NAMED = 5
_DIGEST = re.compile(r"[0-9a-f]{16}")


class ExecutionError(RuntimeError):
    """Work that cannot be started, continued or merged; the message gives the reason and the remedy."""


@dataclass(frozen=True)
class Format(Generic[Result]):
    """File format of a result.

    Args:
        suffix: suffix of the file name.
        write: writes a result to a path, with a mark that identifies its inputs and its task.
        read: reads a result and its mark; raises `ValueError` if the file is damaged.
    """

    suffix: str
    write: Callable[[Path, Result, str], None]
    read: Callable[[Path], tuple[Result, str]]


def json_format(kind: type[Result]) -> Format[Result]:
    """JSON format with a checksum, for plain data, dataclasses and named tuples; floats stay exact."""

    def write(path: Path, result: Result, fingerprint: str) -> None:
        from pydantic import TypeAdapter

        content = TypeAdapter(kind).dump_python(result)
        record = {"hash": fingerprint, "sha256": _checksum(content), "result": content}
        path.write_text(json.dumps(record) + "\n", encoding="utf-8")

    def read(path: Path) -> tuple[Result, str]:
        from pydantic import TypeAdapter

        record = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(record, dict) or record.get("sha256") != _checksum(record.get("result")):
            raise ValueError("its checksum differs")
        return TypeAdapter(kind).validate_python(record["result"]), record["hash"]

    return Format(".json", write, read)


def as_folder(given: str | os.PathLike[str] | None) -> Path | None:
    """Return the folder of results as a path, or None.

    Raises:
        TypeError: It is not a path.
    """
    if given is None:
        return None
    Kind((str, os.PathLike), "the path of a folder")("folder", given)
    return Path(given)


class TaskFolder(Generic[Result]):
    """Stored results of one set of tasks.

    Args:
        folder: folder of the results; it is created by `open`.
        inputs: everything that determines the results, as plain data.
        format: file format of the results.
        file: file that states the inputs; None for `inputs.json` in the folder.
        beside: further entries of that file, which may change.
        name: prefix of the names of result files, before the number.
    """

    def __init__(
        self,
        folder: Path,
        inputs: Mapping[str, object],
        format: Format[Result],
        *,
        file: Path | None = None,
        beside: Mapping[str, object] | None = None,
        name: str = "",
    ):
        self.folder, self.format, self.name = folder, format, name
        self.file = file or folder / "inputs.json"
        self.inputs: dict[str, object] = json.loads(json.dumps({"version": __version__, **inputs}))
        text = json.dumps(self.inputs, sort_keys=True, ensure_ascii=False)
        self.fingerprint = digest_of_text(text)
        self.beside = dict(beside or {})

    @property
    def about(self) -> dict[str, object]:
        """Content of the inputs file."""
        return self.inputs | {"hash": self.fingerprint} | self.beside

    def open(self, *, resume: bool = False, force: bool = False) -> None:
        """Create the folder, or check that its results can be continued.

        Args:
            resume: continue from existing results.
            force: delete existing results first.

        Raises:
            ExecutionError: results exist and `resume` is False, or they belong to other inputs or are
                damaged.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            reason = error.strerror or error
            raise ExecutionError(f"{self.folder}: the folder cannot be created: {reason}") from None
        if force:
            self.clear()
        present = read_inputs(self.file)
        if present is not None:
            self._check(present, resume)
        if present is None or any(present.get(key) != value for key, value in self.beside.items()):
            text = json.dumps(self.about, indent=1, ensure_ascii=False)
            with whole_file(self.file) as partial:
                partial.write_text(text + "\n", encoding="utf-8")

    def _check(self, present: Mapping[str, object], resume: bool) -> None:
        place = self.file.parent
        before = {key: value for key, value in present.items() if key not in _NOT_COMPARED}
        if before != self.inputs:
            changed = _differences(before, self.inputs)
            shown = "; ".join(changed[:_MOST_NAMED]) + (
                f" and {len(changed) - _MOST_NAMED} more" * (len(changed) > _MOST_NAMED)
            )
            text = "cannot be continued, its results were computed from other inputs"
            raise ExecutionError(f"{place}: {text} ({shown}); choose another folder, or --force starts anew")
        if not resume:
            raise ExecutionError(f"{place}: holds results already; --resume goes on, --force starts anew")

    def clear(self) -> None:
        """Delete the inputs file and the results."""
        for path in [self.file, *(self.path(number) for number in self.finished())]:
            path.unlink(missing_ok=True)

    def path(self, number: int) -> Path:
        """Return the path of a task's result."""
        return self.folder / f"{self.name}{number:05d}{self.format.suffix}"

    def finished(self) -> set[int]:
        """Return the numbers of the tasks whose results exist; files with other names are ignored."""
        files = self.folder.glob(f"{self.name}[0-9]*{self.format.suffix}")
        texts = (path.name.removesuffix(self.format.suffix).removeprefix(self.name) for path in files)
        return {int(text) for text in texts if re.fullmatch(r"[0-9]{5,}", text)}

    def save(self, number: int, result: Result) -> None:
        """Store the result of a task."""
        with whole_file(self.path(number)) as partial:
            self.format.write(partial, result, self._mark(number))

    def load(self, number: int) -> Result:
        """Read the stored result of a task."""
        return self.read(self.path(number), self.format.read, self._mark(number))

    def _mark(self, number: int) -> str:
        """Return the mark of a task's file, digest of inputs and task number: a renamed file is refused."""
        return f"{self.fingerprint}-{number}"

    def read(self, path: Path, read: Callable[[Path], tuple[Result, str]], mark: str = "") -> Result:
        """Read a result file and check its mark: that of a task if given, else the digest of these inputs."""
        try:
            result, found_mark = read(path)
        except (OSError, ValueError, KeyError, TypeError) as error:
            text = f"truncated or edited ({str(error).splitlines()[0]})"
            raise ExecutionError(f"{path}: {text}; remove it, and it is computed again") from error
        if found_mark != (mark or self.fingerprint):
            other = "task, under a wrong name" if found_mark.startswith(self.fingerprint) else "analysis"
            raise ExecutionError(f"{path}: belongs to another {other}; remove it or choose another folder")
        return result


def read_inputs(file: Path) -> dict[str, object] | None:
    """Read an inputs file; return None if it does not exist."""
    if not file.exists():
        return None
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise ValueError("it holds no table")
    except (OSError, ValueError) as error:
        raise ExecutionError(f"{file}: cannot be read ({error}); --force starts anew") from error
    return content


def digest_of_text(text: str) -> str:
    """Return a short digest, which stands for a long text among the inputs of a run."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _checksum(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _differences(before: object, now: object, path: str = "") -> list[str]:
    """Return the entries that differ, with both values where they are short and no digests."""
    if isinstance(before, dict) and isinstance(now, dict):
        keys = sorted({*before, *now})
        nested = (_differences(before.get(k), now.get(k), f"{path}.{k}" if path else k) for k in keys)
        return [line for lines in nested for line in lines]
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        pairs = enumerate(zip(before, now, strict=True), start=1)
        return [line for n, (one, other) in pairs for line in _differences(one, other, f"{path}[{n}]")]
    if before == now:
        return []
    short = all(
        isinstance(value, str | int | float | None)
        and len(str(value)) < 40
        and not _DIGEST.fullmatch(str(value))
        for value in (before, now)
    )
    return [f"{path} was {before!r} and is {now!r}" if short else path]
