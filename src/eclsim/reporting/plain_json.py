"""Plain data as JSON, and text, to a file that appears whole or not at all, or to standard output."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from eclsim.atomic import whole_file


def write_plain(data: Any, destination: Path | str) -> None:
    """Write numbers, texts, lists and dictionaries; "-" is standard output."""
    write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", destination)


def write_text(text: str, destination: Path | str) -> None:
    """Write a text; "-" is standard output."""
    if destination == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
        return
    with whole_file(Path(destination)) as partial:
        partial.write_text(text, encoding="utf-8")
