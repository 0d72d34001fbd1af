"""One self-contained HTML page about a replay: no network, no other file needed."""
