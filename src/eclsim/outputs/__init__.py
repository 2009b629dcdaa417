"""Outputs: pressures, flows, volumes, work, limits and alarms of a steady beat, labelled."""
