"""Pictures, drawn by Matplotlib without a screen; imported only when a picture is asked for."""

from __future__ import annotations

from vfplan.lazy import on_demand

# What the command line, tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "depth": "depth_along depth_plot image_places slice_depth",
        "replay": "plane_basis scene timeline",
        "registration": "draw_registration",
        "stability": "passivity_plot",
        "style": "save_png",
    },
)
