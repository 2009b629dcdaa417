"""Oxygen and carbon dioxide in the steady state of given mean flows: exchangers, transport, solution."""
