"""Simulate one case or vary one key: steady beat, course in time, sweep, with tables, figures and files."""
