"""The steady heartbeat: the search for the beat that repeats itself, its derivatives, an independent path."""
