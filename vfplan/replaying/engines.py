"""The engine a replay runs: the controller's own core, or the paper's rule in NumPy."""

from __future__ import annotations

from typing import Any

from vfplan.engine.choosing import check_renderable, sampled
from vfplan.errors import SettingError
from vfplan.fixture import Fixture

RULES = ("robust", "paper", "exact", "both")
ENGINES = ("native", "reference")


def make_engine(fixture: Fixture, rule: str, engine: str = "native") -> Any:
    """An engine that renders `fixture` by `rule` ("robust", "paper" or "exact").

    Raises SceneError: a fixture that is not registered, or has a rendering that no engine takes
    Raises SettingError: an unknown rule or engine, or the reference engine with a rule it does not
        have
    """
    if engine not in ENGINES:
        raise SettingError(
            f"engine is {engine!r}. Give {' or '.join(ENGINES)}", code="unknown-engine"
        )
    if fixture.guidance is None:
        return _region_engine(fixture, rule, engine)

    # A guide, with the region of the forbidden strokes where there are any.
    from vfplan.replaying.guiding import Guided

    if fixture.region is not None:
        region = _region_engine(fixture.region, rule, engine)
        return Guided(fixture, region.parameters, region)
    if (rule, engine) != ("robust", "native"):
        raise SettingError(
            f"every stroke guides, so there is no region for rule {rule!r} ({engine}). Leave "
            "the rule out",
            code="rule-without-region",
        )
    return Guided(fixture, check_renderable(fixture), None)


def _region_engine(fixture: Fixture, rule: str, engine: str) -> Any:
    if engine == "native":
        from vfplan.engine.proxy import ProxyEngine

        return ProxyEngine.of(fixture, rule, offline=True)
    check_renderable(fixture)
    if rule != "paper":
        raise SettingError(
            f"the reference engine has rule 'paper' only, not {rule!r}. Choose that, or "
            "engine 'native'",
            code="rule-not-paper",
        )
    from vfplan.reference import PaperProxy

    return PaperProxy(
        sampled(fixture).points,
        contact_radius=fixture.contact_radius,
        point_radius=fixture.point_radius,
        stiffness=fixture.stiffness,
        ignore_axis=fixture.ignore_axis,
    )
