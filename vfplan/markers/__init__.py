"""Marker files -> labelled correspondences; units and frames are read, never guessed."""

from __future__ import annotations

from vfplan.markers.correspondences import Correspondences, read_markers

__all__ = ["Correspondences", "read_markers"]
