"""Regulation of the circulation: reflexes, drugs and fluid, and how they act on a circuit's parameters."""
