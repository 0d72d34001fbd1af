"""`plan` is `extract`, then `register`: from a planned slice and its markers to a fixture."""
