"""Drawn crosses and dots -> their centres, to a fraction of a pixel.

Near each given position: un-mix the marker's colour from what lies under it, take the mark, and fit
the coverage that a blurred cross or a blurred disc would have. The fit's centre is the marker's.
"""

from __future__ import annotations

from vfplan.markers.finding.find import FoundMarker, find_markers

__all__ = ["FoundMarker", "find_markers"]
