"""Fitting a model's parameters to measurements: objective, least squares, multi-start, precision."""

SUMMARY, TRACK_SUMMARY = "identification.json", "track.json"
"""Files with all results of fits, and of followed patients."""
