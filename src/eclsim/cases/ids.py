"""Ids of patients: when two of them are written alike."""

from __future__ import annotations

import unicodedata


def plain_id(written: str) -> str:
    """The form in which ids are equal that differ in case, spaces or Unicode form alone."""
    return unicodedata.normalize("NFKC", "".join(written.split())).casefold()
