"""Markers as a user gives them: in files, and drawn on the slice (`marks`, `drawn`)."""
