"""Names of the files of the CRRT study of a cohort; loads nothing heavy."""

from __future__ import annotations

FILES = ("report.html", "cohort.json", "points.csv", "schemes.csv", "ranks.svg")
FITS = "fits"
"""Folder of the fits, so that they can be gone on with."""
