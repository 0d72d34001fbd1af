"""From a stack of outlined slices to a surface that a proxy can touch."""

from vfplan.surface.build import Surface, SurfaceSettings, surface

__all__ = ["Surface", "SurfaceSettings", "surface"]
