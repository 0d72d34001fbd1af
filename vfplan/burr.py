"""`vfplan burr`: a ball at the tip removes what it reaches, and deeper points appear.

This demonstrates editing; the removal is a ball's, not a bone's. A figure shows what was removed,
seen from the tool's side, and how the force went.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vfplan.cli import options
from vfplan.cli.next_commands import file_beside, typed_options
from vfplan.cli.options import CSV, PNG, DecimalNumber, option, options_in_order, output_option
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, command, progress
from vfplan.display import MM, Advance, Report, command_of, micrometres, millimetres, wrote
from vfplan.engine.parameters import Vector
from vfplan.engine.proxy import ProxyEngine, Status, sampled
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Fixture
from vfplan.geometry.lines import flattened, row_lengths
from vfplan.replaying.findings import finding
from vfplan.replaying.metrics import row_norms
from vfplan.replaying.replay import Replay, replay
from vfplan.session.events import Event, write_events
from vfplan.session.session import BLOCK, Session
from vfplan.stability.contacts import cloud_normal

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@command("burr")
@options_in_order(
    options.FIXTURE,
    options.SESSION,
    option("--radius", "radius_mm", type=DecimalNumber(0, min_open=True), metavar="MM",
           required=True,
           help="Radius of the ball at the tip [mm]. It is smaller than the contact radius."),
    output_option("Write the result of each tick to this HDF5 file.", required=False),
    option("--events-out", type=CSV, metavar="EVENTS.csv",
           help="Write the edits, for `vfplan replay --rule robust --events`."),
    option("--picture-out", type=PNG, metavar="PNG",
           help="Write a picture of how far each point was lowered, and of the force over time."),
    options.UNITS,
    options.signature_options(),
)  # fmt: skip
def vfplan_burr(
    fixture, session, radius_mm, output, events_out, picture_out, **arguments
) -> CommandResult:
    """Let the hand of SESSION burr FIXTURE.h5 away with a ball at the tip.

    The ball removes the points within it, and new points appear on its surface. The ball is smaller
    than the contact radius, so the hand has to press in by the difference first. The command then
    replays the session with these edits. It demonstrates editing under the hand, and does not
    simulate bone.
    """
    from vfplan.bundle.read import read_sealed
    from vfplan.session.read import read_session
    from vfplan.session.result import write_result

    planned, seal = read_sealed(fixture, trust=options.trust(arguments))
    hand = read_session(session, units=arguments["units"], frame=planned.frame)
    with progress("burr", len(hand.hip)) as done:
        burred = burr(planned, hand, 1e-3 * radius_mm, done=done)
    with outputs(output, events_out, picture_out) as (result, events, picture):
        if result is not None:
            write_result(burred.replayed, result)
        if events is not None:
            write_events(events, burred.events)
        if picture is not None:
            from vfplan.figures.style import save_png

            save_png(burr_figure(burred), picture)

    metrics = burred.replayed.metrics
    warnings = list(options.not_compared(seal, arguments).values())
    warnings += [found["message"] for found in metrics["findings"] if found["code"] == "burr-held"]
    written = [wrote(path) for path in (output, events_out, picture_out) if path is not None]
    text = "\n".join([burr_text(metrics), *written])
    figures = metrics["burr"]
    failed = ""
    verdict = (
        f"burred {figures['places_lowered']} places, up to {millimetres(figures['deepest_m'], 2)} "
        "deep"
    )
    if events_out is None:
        picture, edits = file_beside(fixture, "burr", ".png"), file_beside(fixture, "edits", ".csv")
        words = ["burr", fixture, session, "--picture-out", picture, "--events-out", edits]
        next_step = "draw it, and keep the edits for vfplan replay: "
    else:
        words = ["replay", fixture, session, "--rule", "robust", "--events", events_out]
        next_step = "replay the edits: "
    next_step += command_of(*words, *typed_options(words[0], overwrites=False))
    if not figures["replayed_to_the_bit"]:
        failed = "the replay of the edits gives other forces"
        verdict = f"fail: {failed}"
        next_step = "report it with both files; edits must replay to the bit"
    elif not figures["burring_ticks"]:
        verdict = "not-tested: the ball removed nothing"
        next_step = (
            "press deeper than the contact radius less the ball's, or take a larger --radius"
        )
    return CommandResult(
        metrics, text, warnings=warnings, failed=failed, verdict=verdict, next_step=next_step
    )


def burr_text(metrics: Report) -> str:
    """What was removed, and how the force went."""
    burr = metrics["burr"]
    same = "the replay has the same bits" if burr["replayed_to_the_bit"] else "REPLAYED OTHERWISE"
    return (
        f"burred in {burr['burring_ticks']} of {metrics['ticks']} ticks: {burr['points_taken']} "
        f"points went and came back deeper, {burr['places_lowered']} places, up to "
        f"{millimetres(burr['deepest_m'], 2)}\n"
        f"force        max {metrics['force_max_n']:.3f} N (K times the margin: "
        f"{burr['margin_force_n']:.3f} N); under edits its step was at most "
        f"{burr['force_step_of_bound']:.2f} of K (R/256 + step of the HIP)\n"
        f"clearance    min {micrometres(metrics['clearance_min_m'])}; {same}"
    )


# Largest number of points that the ball removes in a tick. Each goes and another appears, and the
# engine takes 64 changes a tick.
MAX_POINTS = 32

# Number of neighbours from which the normal of a point is taken: two rings around it.
NEIGHBOURS = 12


@dataclass(frozen=True, eq=False)
class Burred:
    """What was burred away, and its replay."""

    # The session again with the edits; its metrics hold `burr` besides
    replayed: Replay
    # The edits, each with its tick
    events: list[Event]
    # The points (N, 3) [m] at the end: one of the fixture that went is now its deeper one
    after: Vector


class Burr:
    """The ball, and the points as it leaves them.

    A point that the ball reaches by more than `tolerance` moves down onto the ball's surface. Down
    is against the normal that the cloud has there at first, on the side on which its neighbours
    were removed, and for the first point on the proxy's side.

    Parameters
    ----------
    points
        (N, 3) [m].
    radius
        Radius of the ball [m].
    tolerance
        How far a point may be inside the ball [m].
    axis
        (3,) the axis along which the fixture is endless; `None`: there is none.
    """

    def __init__(
        self, points: Vector, radius: float, tolerance: float, axis: Vector | None
    ) -> None:
        from scipy.spatial import cKDTree

        self.points = points.copy()
        self._radius = radius
        self._reach = radius - tolerance
        self._axis = axis
        self._first_points = flattened(points, axis)
        self._tree = cKDTree(self._first_points)
        self._normals = np.zeros_like(points)
        # The engine's number of each point, and that of the next one
        self._numbers = np.arange(len(points))
        self._next_number = len(points)

    def bite(self, tick: int, hip: Vector, proxy: Vector) -> Event | None:
        """The edit for the points that the ball reaches; at most 32, the closest first."""
        offset = flattened(self.points - hip, self._axis)
        square = np.einsum("ij,ij->i", offset, offset)
        reached = np.flatnonzero(square < self._reach**2)
        if not len(reached):
            return None
        reached = reached[np.argsort(square[reached], kind="stable")][:MAX_POINTS]

        # The normal of a new point is across its first neighbours, towards the proxy.
        for k in reached:
            if self._normals[k].any():
                continue
            place = self._first_points[k]
            neighbours = self._tree.query(place, min(NEIGHBOURS, len(self._normals)))[1]
            normal = cloud_normal(self._first_points[neighbours], self._axis)
            outwards = self._normals[neighbours].sum(axis=0)
            if not outwards.any():
                outwards = proxy - place
            self._normals[k] = -normal if normal @ outwards < 0 else normal

        # Each point moves down its normal until it lies on the ball.
        normals = self._normals[reached]
        depth = -np.einsum("ij,ij->i", offset[reached], normals)
        distance = np.sqrt(depth**2 + self._radius**2 - square[reached]) - depth
        removed = self._numbers[reached].copy()
        self.points[reached] -= distance[:, None] * normals
        self._numbers[reached] = np.arange(self._next_number, self._next_number + len(reached))
        self._next_number += len(reached)
        return Event(tick, remove=removed, add=self.points[reached].copy())


def burr(
    fixture: Fixture, session: Session, radius_m: float, *,
    done: Advance = lambda ticks: None,
) -> Burred:  # fmt: skip
    """Let the session's hand burr a fixture with a ball of `radius_m` at the tip, and replay it.

    Raises
    ------
    SettingError
        A radius not below the fixture's contact radius: it would remove before it is felt.
    SceneError
        A fixture whose points are not rendered.
    """
    if fixture.rendering is None or fixture.guidance is not None:
        raise SceneError(
            "the fixture renders no forbidden region, so nothing is burred. Give one "
            "without a guide",
            code="nothing-to-burr",
        )
    contact_m = fixture.contact_radius + fixture.point_radius
    if not 0 < radius_m < contact_m:
        raise SettingError(
            f"a ball of radius {1e3 * radius_m:g} mm would remove bone before it is felt. "
            f"Give more than 0 and less than the contact radius, {1e3 * contact_m:g} mm",
            code="burr-radius", numbers={"radius_m": radius_m, "contact_radius_m": contact_m},
        )  # fmt: skip
    fixture = sampled(fixture)
    engine = ProxyEngine.of(fixture, "robust", offline=True)
    engine.make_editable()
    engine.reset(session.hip[0])
    tolerance_m = min(2 * engine.parameters.band, 0.1 * radius_m)
    ball = Burr(fixture.points, radius_m, tolerance_m, fixture.ignore_axis)

    # The hand burrs; an edit takes effect in the next tick.
    events = []
    forces = np.empty_like(session.hip)
    changing = np.zeros(len(forces) + 1, bool)
    for k, hip in enumerate(session.hip):
        step = engine.step(hip)
        forces[k] = step.force
        changing[k + 1] = step.status & Status.CHANGING
        is_inside = step.status & Status.INSIDE
        if not is_inside and engine.distance(hip[None])[0] < radius_m - tolerance_m:
            event = ball.bite(k + 1, hip, step.proxy)
            if event is not None and k + 1 < len(session.hip):
                engine.edit(event.remove, event.add)
                events.append(event)
        if k % BLOCK == BLOCK - 1:
            done(BLOCK)

    # The session again with these edits, as a controller would have it.
    replayed = replay(fixture, session, rule="robust", events=events)
    depth = row_lengths(ball.points - fixture.points)
    stiffness = float(np.max(fixture.stiffness))
    margin_force_n = stiffness * (contact_m - radius_m)
    # The step of the force under edits, as a part of K (R/256 + |step of the HIP|).
    moved_m = row_norms(np.diff(session.hip, axis=0))
    parts = row_norms(np.diff(forces, axis=0)) / (stiffness * (contact_m / 256 + moved_m))
    replayed.metrics["burr"] = {
        "radius_m": radius_m,
        "burring_ticks": len(events),
        "points_taken": sum(len(event.remove) for event in events),
        "places_lowered": int(np.count_nonzero(depth)),
        "deepest_m": float(depth.max()),
        "replayed_to_the_bit": bool(np.array_equal(replayed.trace.force, forces)),
        "margin_force_n": margin_force_n,
        "force_step_of_bound": float(parts[changing[1:-1] | changing[2:]].max(initial=0.0)),
    }

    # A tool that removes what it presses on feels no more than about K times the margin.
    force_n = replayed.metrics["force_max_n"]
    if events and force_n > 2 * margin_force_n:
        text = (
            f"The force reached {force_n:.3g} N, and K times the margin is "
            f"{margin_force_n:.3g} N: the proxy did not follow the tool into what it "
            "removed. Feed more slowly, and burr no pit narrower than the proxy and no thin "
            "wall from both sides."
        )
        replayed.metrics["findings"].append(finding("burr-held", "warning", text))
    return Burred(replayed, events, ball.points)


def burr_figure(burred: Burred) -> Figure:
    """The points as they were seen from the tool, by how far each was lowered, and the force."""
    from vfplan.figures.replay import plane_basis
    from vfplan.figures.style import subplots

    points = burred.replayed.fixture.points
    lowered = points - burred.after
    axis = burred.replayed.fixture.ignore_axis
    if axis is None:
        axis = lowered.sum(axis=0) if lowered.any() else np.array([0.0, 0.0, 1.0])
    flat = MM * (points - points.mean(axis=0)) @ plane_basis(axis / np.linalg.norm(axis))
    figure, (above, below) = subplots(7.5, 6.0, 2, 1, height_ratios=(3, 2))
    dots = above.scatter(*flat.T, c=MM * row_norms(lowered), s=6, cmap="viridis", lw=0, zorder=3)
    figure.colorbar(dots, ax=above, label="lowered [mm]")
    above.set(xlabel="[mm]", ylabel="[mm]", aspect="equal", adjustable="datalim")
    ticks = burred.replayed.ticks
    below.plot(ticks.time, row_norms(ticks.force), lw=0.8)
    below.set(xlabel="time [s]", ylabel="force [N]")
    return figure
