"""How long a tick of the engine may take, told before the first one."""

from __future__ import annotations

from vfplan import _core
from vfplan.engine.checks import check_points
from vfplan.engine.native import iterations_of, native_parameters
from vfplan.engine.parameters import Rule
from vfplan.engine.renderable import (
    best_rule,
    check_pieces,
    check_renderable,
    check_triangles,
    exact_of,
)
from vfplan.errors import SceneError
from vfplan.fixture import Fixture

MOST_TICK_WORK = _core.most_tick_work  # [s] that a loop of 1 kHz gives a tick


def work_of(fixture: Fixture, rule: Rule | None = None) -> float:
    """Time [s] that a tick takes at most, by how many points, pieces or triangles lie together.

    Of the best rule unless one is given.

    A bound, computed in the C++ header work.hpp with the times of the machine of docs/engine.md.

    Raises `SceneError` for a rendering that no engine takes.
    """
    parameters = check_renderable(fixture)
    native = native_parameters(parameters, iterations_of(fixture.max_iterations), "auto")
    if (rule or best_rule(fixture)) == "exact":
        if exact_of(fixture) == "mesh":
            return _core.tick_work(*check_triangles(fixture.points, fixture.mesh), native)
        return _core.tick_work(*check_pieces(fixture.region.pieces), native)
    return _core.tick_work(check_points(fixture.points), native)


def work_doubt(fixture: Fixture, rule: Rule | None = None) -> str | None:
    """Why a loop of 1 kHz cannot wait for a fixture's ticks; `None` where it can."""
    work = work_of(fixture, rule)
    if work <= MOST_TICK_WORK:
        return None
    return (
        f"a tick may take {1e6 * work:.0f} us, at most {1e6 * MOST_TICK_WORK:.0f} us are given"
        " at 1 kHz: too many points or pieces around one place, or max_iterations too high"
    )


def check_work(fixture: Fixture, rule: Rule | None = None) -> None:
    """Refuse a fixture whose ticks may take longer than a loop of 1 kHz can wait.

    Raises `SceneError` with the time, the time given, and what makes it so.
    """
    if (doubt := work_doubt(fixture, rule)) is not None:
        raise SceneError(doubt)
