"""Texts in CSV tables that a spreadsheet would run as a formula."""

from __future__ import annotations

from typing import Any

_STARTS = ("=", "+", "-", "@", "\t", "\r")


def guarded(value: Any) -> Any:
    """A text that begins like a formula behind an apostrophe; everything else as it is."""
    return f"'{value}" if isinstance(value, str) and value.startswith(_STARTS) else value


def unguarded(text: str) -> str:
    """The text that `guarded` was given."""
    return text[1:] if text[:1] == "'" and text[1:].startswith(_STARTS) else text
