"""Settings that reach goals: from what the outputs should be to how devices have to be set."""
