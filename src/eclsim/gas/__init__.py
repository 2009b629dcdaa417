"""Oxygen and carbon dioxide at given mean flows: gas exchange of a circuit, transport and gas state."""
