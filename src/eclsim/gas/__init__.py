"""Oxygen and carbon dioxide in the steady state of given mean flows: exchangers, transport, solution.

No case file reaches this yet: flows, exchangers and parameters are handed over in Python.
"""
