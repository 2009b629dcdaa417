"""Reading of input files without blocking and with a limit on size."""

from __future__ import annotations

import json
import os
import re
import stat
from collections.abc import Iterable
from typing import Any

from eclsim.inputs.mistakes import CaseError, Mistake

MOST_DOTS = 16
"""Largest number of dots outside strings on one line of TOML; memory grows as the square of a key's depth."""
_TEXTS_AND_COMMENTS = re.compile(r'"(?:[^"\\]|\\.)*"|\'[^\']*\'|#.*')
_KINDS = {stat.S_ISFIFO: "a named pipe", stat.S_ISSOCK: "a socket", stat.S_ISCHR: "a device",
          stat.S_ISBLK: "a device"}  # fmt: skip


def read_bytes(file: str, most: int, kind: str = "a file", too_large: str = "") -> bytes:
    """Read the whole of a regular file.

    Args:
        file: path.
        most: largest size allowed, bytes.
        kind: kind of file expected, for messages.
        too_large: advice for a file that is too large.

    Raises:
        CaseError: The file is missing, not regular, too large, or a symbolic link out of its folder.
    """
    try:
        _refuse_links_to_other_folders(file)
        handle = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with os.fdopen(handle, "rb") as opened:
            _refuse_other_kinds(os.fstat(handle).st_mode, file, kind)
            data = opened.read(most + 1)
    except FileNotFoundError:
        raise file_error(file, "no such file") from None
    except IsADirectoryError:
        raise file_error(file, f"a folder, not {kind}") from None
    except PermissionError:
        if os.path.isdir(file):  # Windows raises PermissionError for a folder
            raise file_error(file, f"a folder, not {kind}") from None
        raise file_error(file, "no permission to read it") from None
    except OSError as error:
        raise file_error(file, f"cannot be read: {error.strerror or error}") from None
    except CaseError:  # CaseError is a ValueError with a message of its own
        raise
    except ValueError as error:
        raise file_error(file, f"not a path: {error}") from None
    if len(data) > most:
        allowed = f"at most {size_in_words(most)}" + (f"; {too_large}" if too_large else "")
        raise file_error(file, f"too large for {kind}", allowed)
    return data


def decoded(data: bytes, file: str, expected: str = "text in UTF-8") -> str:
    """Decode UTF-8 text, and convert line endings to line feeds.

    Raises:
        CaseError: The data is in another encoding or is not text.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise file_error(file, "encoded as UTF-16", expected)
    if b"\x00" in data:
        raise file_error(file, "contains zero bytes: UTF-16, or not a text file", expected)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        message = f"not UTF-8: byte 0x{data[error.start]:02x} (Latin-1 or Windows-1252?)"
        raise CaseError([Mistake("", message, allowed=expected, file=file, line=line)]) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def too_deep(text: str) -> int | None:
    """Return the first line of TOML whose keys are nested more deeply than any case file needs, or None."""
    for number, line in enumerate(text.split("\n"), start=1):
        if line.count(".") > MOST_DOTS and _TEXTS_AND_COMMENTS.sub("", line).count(".") > MOST_DOTS:
            return number
    return None


def json_of(text: str, file: str) -> Any:
    """Parse a JSON text to plain data.

    Raises:
        CaseError: The text is not valid JSON, is nested too deeply, or repeats a key within an object.
    """
    try:
        return json.loads(text, object_pairs_hook=_without_double_keys)
    except RecursionError:
        raise file_error(file, "nested too deeply") from None
    except _DoubleKeyError as error:
        raise file_error(file, f"the key {error} occurs twice in one object", "each key once") from None
    except ValueError as error:
        line = getattr(error, "lineno", None)
        raise CaseError([Mistake("", f"not valid JSON: {error}", file=file, line=line)]) from None


def file_error(file: str, message: str, allowed: str = "") -> CaseError:
    """Return the error for a file as a whole."""
    shown = file if file.isprintable() else file.encode("unicode_escape").decode("ascii")
    return CaseError([Mistake("", message, allowed=allowed, file=shown)])


class _DoubleKeyError(Exception):
    pass


def _without_double_keys(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise _DoubleKeyError(repr(key[:40]))
        result[key] = value
    return result


def _refuse_links_to_other_folders(file: str) -> None:
    if not os.path.islink(file):
        return
    folder, target = os.path.realpath(os.path.dirname(file) or "."), os.path.realpath(file)
    if os.path.commonpath([folder, target]) != folder:
        raise file_error(
            file, f"a symbolic link out of its folder, to {target}", "the path of the file itself"
        )


def _refuse_other_kinds(mode: int, file: str, kind: str) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError
    if not stat.S_ISREG(mode):
        what = next((words for test, words in _KINDS.items() if test(mode)), "not a regular file")
        raise file_error(file, f"{what}, not {kind}", "a regular file; save the data to one first")


def size_in_words(count: int) -> str:
    """Return a number of bytes as a rounded size, such as "200 kB"."""
    return f"{count // 1_000_000} MB" if count >= 1_000_000 else f"{count // 1000} kB"
