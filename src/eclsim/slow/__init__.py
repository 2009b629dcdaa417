"""What changes over minutes and hours above the steady beat: the form of a slow law."""
