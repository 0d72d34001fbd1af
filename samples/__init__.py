"""A runnable sample: a planned slice, its markers and a session that probes the fixture."""
