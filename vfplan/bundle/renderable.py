"""Whether an engine takes what a bundle holds.

The format allows any radius above 0, a stiffness of 0, any band below R; float64 serves a narrower
range (docs/engine.md). A bundle outside it is sound, and no robot renders it.
"""

from __future__ import annotations

from vfplan.engine.parameters import ProxyParameters
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Fixture


def check_renderable(fixture: Fixture) -> None:
    """Refuse a fixture whose rendering is outside the engine's ranges.

    Raises
    ------
    SceneError
        No rendering, or one that the robust rule's engine refuses; the message has the value and
        what is allowed.
    """
    if fixture.rendering is None:
        raise SceneError("no rendering parameters: `vfplan register` makes a fixture of a curve")
    try:
        ProxyParameters.make(
            fixture.points,
            contact_radius=fixture.contact_radius,
            band=fixture.band,
            point_radius=fixture.point_radius,
            stiffness=fixture.stiffness,
            ignore_axis=fixture.ignore_axis,
        )
    except SettingError as error:
        raise SceneError(f"no engine renders it: {error.message}") from error
