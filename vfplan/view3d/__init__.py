"""A fixture in three dimensions by PyVista (extra `view`): on a screen, or as a PNG without one.

view3d      the picture: slice, cloud, paths, contact sphere, force; a scale and a legend
opengl      whether a window or a picture can be drawn here
"""

from __future__ import annotations

from vfplan.view3d.view3d import draw_view, handle_events, show

__all__ = ["draw_view", "handle_events", "show"]
