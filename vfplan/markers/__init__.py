"""Markers as a user gives them: in files, and drawn on the slice (`marks`, `drawn`)."""

from __future__ import annotations

from vfplan.markers.correspondences import Correspondences, read_markers

__all__ = ["Correspondences", "read_markers"]
