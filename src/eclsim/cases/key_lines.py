"""Line numbers of the keys of a TOML file, for messages."""

from __future__ import annotations

import re

_HEADER = re.compile(r"\s*\[\[?\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"""\s*((?:"[^"]*"|'[^']*'|[\w-]+)(?:\s*\.\s*(?:"[^"]*"|'[^']*'|[\w-]+))*)\s*=""")
_LONG_TEXT = re.compile(r'"""|' + "'''")


def lines_of_keys(text: str) -> dict[str, int]:
    """Line, from 1, of every section ("patient") and key ("patient.age_years") of a valid TOML text."""
    found: dict[str, int] = {}
    section = ""
    in_long_text = False
    for number, line in enumerate(text.split("\n"), start=1):
        if not in_long_text:
            if header := _HEADER.match(line):
                section = _dotted(header[1])
                found.setdefault(section, number)
            elif key := _KEY.match(line):
                path = f"{section}.{_dotted(key[1])}" if section else _dotted(key[1])
                found.setdefault(path, number)
        if len(_LONG_TEXT.findall(line)) % 2:
            in_long_text = not in_long_text
    return found


def _dotted(name: str) -> str:
    """A dotted key without quotes and spaces around its parts."""
    return ".".join(part.strip().strip("\"'") for part in name.split("."))
