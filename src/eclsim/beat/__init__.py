"""One heartbeat as a map from its beginning to its end: grid, step, recording, compiled programs."""
