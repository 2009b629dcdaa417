"""The steady heartbeat: solver of the periodic beat, its derivatives, and an independent solver."""
