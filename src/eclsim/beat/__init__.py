"""One heartbeat as a map from its initial to its final state: grid, step, recording, compiled programs."""
