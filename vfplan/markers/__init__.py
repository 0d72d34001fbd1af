"""Markers as a user gives them: in files, and drawn on the slice (`finding`)."""

from __future__ import annotations

from vfplan.markers.files import Correspondences, read_markers

__all__ = ["Correspondences", "read_markers"]
