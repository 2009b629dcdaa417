"""Names of the files of the comparison with the paper; loads nothing heavy."""

from __future__ import annotations

FILES = ("reproduction.html", "reproduction.csv", "reproduction.json")
FIGURES = {"figure_2": "schemes", "figure_5": "beat", "figure_6": "speeds"}
"""Figure of the paper and drawing of the CRRT study."""


def file_names() -> tuple[str, ...]:
    """Names of all files that are written."""
    return (*FILES, *(f"{name}.svg" for name in FIGURES))
