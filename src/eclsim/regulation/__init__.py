"""Regulation of the circulation: reflexes and responses to gases that act on a circuit's parameters."""
