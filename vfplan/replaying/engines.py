"""The engine a replay runs: the controller's own core, or the paper's rule in NumPy."""

from __future__ import annotations

from typing import Any

from vfplan.engine.renderable import check_renderable
from vfplan.errors import InputError, SettingError
from vfplan.fixture import Fixture

RULES = ("robust", "paper", "exact", "both")
ENGINES = ("native", "reference")


def make_engine(fixture: Fixture, rule: str, engine: str = "native") -> Any:
    """An engine that renders `fixture` by `rule` ("robust", "paper" or "exact").

    Raises
    ------
    InputError
        A fixture that is not registered, says nothing of its rendering, or has a rendering that no
        engine takes.
    SettingError
        An unknown rule or engine, or the reference engine with a rule it does not have.
    """
    if engine not in ENGINES:
        raise SettingError(f"engine {engine!r}; {' or '.join(ENGINES)} wanted")
    if rule not in RULES[:3]:
        raise SettingError(f"rule {rule!r}; {', '.join(RULES[:3])} wanted")
    if fixture.frame == "image" or fixture.rendering is None:
        raise InputError(
            f"a curve in frame {fixture.frame!r} without rendering cannot be replayed; "
            "`vfplan register` makes a fixture of it"
        )
    check_renderable(fixture)
    if rule == "exact" and engine == "native":
        from vfplan.engine.proxy import ProxyEngine

        return ProxyEngine.of(fixture, rule)
    settings: dict[str, Any] = {
        "contact_radius": fixture.contact_radius,
        "point_radius": fixture.point_radius,
        "stiffness": fixture.stiffness,
        "ignore_axis": fixture.ignore_axis,
    }
    if fixture.guidance is not None:
        return _guided(fixture, rule, engine, settings)
    return _region(fixture, fixture.points, rule, engine, settings)


def _guided(fixture: Fixture, rule: str, engine: str, settings: dict[str, Any]) -> Any:
    """The guide, with the region of the forbidden strokes where there are any."""
    from vfplan.engine.parameters import ProxyParameters
    from vfplan.replaying.guiding import Guided

    region = None
    if len(fixture.forbidden):
        region = _region(fixture, fixture.forbidden, rule, engine, settings)
    elif (rule, engine) != ("robust", "native"):
        raise SettingError(f"every stroke guides: there is no region for rule {rule!r} ({engine})")
    own = {name: settings[name] for name in settings if name != "max_iterations"}
    parameters = ProxyParameters.make(fixture.points, band=fixture.band, rule=rule, **own)
    return Guided(fixture, parameters, region)


def _region(fixture: Fixture, points: Any, rule: str, engine: str, settings: dict[str, Any]) -> Any:
    if engine == "reference":
        if rule != "paper":
            raise SettingError(f"the reference engine has rule 'paper' only, not {rule!r}")
        from vfplan.reference import PaperProxy

        return PaperProxy(points, **settings)
    from vfplan.engine.proxy import ProxyEngine

    # The paper's rule keeps its own band.
    band = None if rule == "paper" else fixture.band
    if fixture.max_iterations is not None:
        settings = settings | {"max_iterations": fixture.max_iterations}
    return ProxyEngine(points, rule=rule, band=band, **settings)
