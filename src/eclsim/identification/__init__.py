"""Fitting a model's parameters to measurements: objective, least squares, multi-start, precision."""
