"""How a fixture is rendered: what the tolerance chose, what it left out and at what price."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.parameters import FINEST_BAND, MAX_ITERATIONS, ProxyParameters, check_axis
from vfplan.errors import SettingError
from vfplan.findings import Finding, note
from vfplan.fixture import Fixture, Rendering
from vfplan.planning.carrying import Carried, carry, pieces_of, require_small
from vfplan.planning.settings import FixtureSettings
from vfplan.planning.tolerance import BAND_SHARE, Choice, choose

if TYPE_CHECKING:
    from vfplan.registration import Registration

# Operations for one point's squared distance: differences, products, sums.
OPERATIONS = {3: 8, 2: 5}
SETTINGS = 3  # that only points need
# An ignored axis further than this from the slice's normal would collapse the curve.
MAX_IGNORED_TILT_DEG = 45.0


@dataclass(frozen=True, eq=False)
class Rendered:
    """The fixture's points, how they are rendered, and what is left out for that."""

    carried: Carried
    rendering: Rendering
    choice: Choice | None  # from the tolerance; `None` where it left none
    left_out: dict[str, int]  # counted: points, coordinates, groups of contacts, iterations
    costs: list[dict[str, Any]]  # of each: the error [m], and the operations a tick that it saves

    @property
    def report(self) -> dict[str, Any]:
        """What `register --json` reports of the fixture's points."""
        carried = self.carried
        report: dict[str, Any] = {
            "points": len(carried.points),
            "spacing_m": carried.spacing_m,
            "left_out": self.left_out,
        }
        pieces = carried.curve and carried.curve.pieces
        if pieces:
            report["pieces"] = {"lines_and_arcs": pieces.count, "error_m": pieces.error}
        else:
            report["left_out_costs"] = self.costs
        if self.choice is not None:
            report["chosen"] = _describe_choice(self.choice, carried)
        if carried.sampling_error_m is not None:
            report["sampling_error_m"] = carried.sampling_error_m
        if carried.tight_bends:
            report["tight_bends"] = [asdict(bend) for bend in carried.tight_bends]
        return report

    @property
    def settings(self) -> dict[str, float | int]:
        """The same for a bundle's provenance, flat."""
        flat: dict[str, float | int] = {f"left_out_{name}": n for name, n in self.left_out.items()}
        if self.choice is not None:
            flat["chosen_tolerance_m"] = self.choice.kept_m
            names = "spacing_m", "band_m", "max_iterations", "lag_m"
            flat |= {f"chosen_{name}": getattr(self.choice, name) for name in names}
        return flat

    @property
    def findings(self) -> tuple[Finding, ...]:
        """That less than the tolerance asked for was used."""
        choice = self.choice
        if choice is None or choice.kept_m == choice.tolerance_m:
            return ()
        text = (
            f"The tolerance of {choice.tolerance_m * 1e3:g} mm is more than r_c + r_v allow. "
            f"{choice.kept_m * 1e3:.4g} mm was used, because wider spacing would be felt as bumps."
        )
        return (note("tolerance-reduced", "plan", text),)


def render(
    curve: Fixture,
    registration: Registration,
    settings: FixtureSettings,
    slice_axes: NDArray[np.float64] | None,
    margin_m: float,
) -> Rendered:
    """Choose from the tolerance, carry the curve over, and lay lines and arcs along it.

    slice_axes: (3, 2) of a slice's pixels in the patient; `None` for any other curve
    margin_m: what was added to the curve for safety
    """
    choice = _choice_of(curve, settings)
    carried = carry(curve, registration, settings, choice and choice.sampling_tolerance_m)
    rendering = _rendering_of(
        carried.points, settings, registration, choice, curve.mesh, slice_axes
    )
    pieces = pieces_of(curve, registration, rendering.ignore_axis, settings, carried)
    if pieces:
        require_small(pieces, margin_m, settings)
        # The choice is that of the points alone.
        carried, choice = replace(carried, curve=replace(carried.curve, pieces=pieces)), None
    return Rendered(
        carried, rendering, choice, *_left_out(rendering, carried, len(curve.points), choice)
    )


def _choice_of(curve: Fixture, settings: FixtureSettings) -> Choice | None:
    """What the tolerance asks for; `None` where a density or a bare cloud leaves no choice.

    Raises `SettingError` for a tolerance whose band would be finer than the engine takes.
    """
    if curve.curve is None or settings.density_per_m is not None:
        return None
    radius = settings.contact_radius + settings.point_radius
    least = FINEST_BAND / BAND_SHARE * radius
    if settings.tolerance_m < least:
        raise SettingError(
            f"tolerance {settings.tolerance_m * 1e3:g} mm: at least {least * 1e3:g} mm is wanted, "
            f"{FINEST_BAND / BAND_SHARE:g} of r_c + r_v = {radius * 1e3:g} mm"
        )
    drawn = "none" if curve.image is None and curve.frame != "image" else "normal"
    planar = (settings.ignore_axis or drawn) != "none"
    return choose(settings.tolerance_m, radius, planar=planar)


def _describe_choice(choice: Choice, carried: Carried) -> dict[str, Any]:
    """The settings taken, and the share of the error that each may cause [m]."""
    lag = choice.lag_m
    return {
        "tolerance_m": choice.tolerance_m,
        "tolerance_used_m": choice.kept_m,
        "spacing_m": choice.spacing_m,
        "band_m": choice.band_m,
        "max_iterations": choice.max_iterations,
        "error_m": {
            "spacing": carried.sampling_error_m,
            "band": choice.band_m,
            "iterations": lag,
            "total": (carried.sampling_error_m or 0.0) + choice.band_m + lag,
        },
    }


def _left_out(
    rendering: Rendering, carried: Carried, drawn: int, choice: Choice | None
) -> tuple[dict[str, int], list[dict[str, Any]]]:
    """What this scene does without, counted, and what each costs [m] and saves [operations a tick].

    `drawn` is how many points the curve was measured at. `operations_per_tick` is the arithmetic
    that is saved in one pass over the neighbours of a proxy on a straight stretch. A curve of
    lines and arcs does without its points, their spacing, the band and the iteration limit.
    """
    held = len(carried.points)
    if carried.curve and carried.curve.pieces:
        return {"points": held, "coordinates": 1, "settings": SETTINGS}, []
    planar, near = rendering.ignore_axis is not None, _neighbours(rendering, carried)
    whole, per_point = OPERATIONS[3], OPERATIONS[2 if planar else 3]
    points = max(0, drawn - held)
    saved = round(points / held * near * whole)
    error = carried.sampling_error_m or 0.0
    rows: list[dict[str, Any]] = [
        {"left_out": "points", "count": points, "error_m": error, "operations_per_tick": saved}
    ]
    if planar:  # two contacts can hold a proxy apart, not three
        saved = round(near * (whole - per_point))
        rows += [
            {"left_out": "coordinates", "count": 1, "error_m": 0.0, "operations_per_tick": saved},
            {"left_out": "groups", "count": 1, "error_m": 0.0},
        ]
    counts: dict[str, int] = {row["left_out"]: row["count"] for row in rows}
    if choice is not None:
        counts["iterations"] = count = max(0, MAX_ITERATIONS - choice.max_iterations)
        worst = {"operations_per_worst_tick": round(count * near * per_point)}
        row = {"left_out": "iterations", "count": count, "error_m": choice.lag_m, **worst}
        rows += [row] if count else []
    saved = near * max(1.0, drawn / held) * whole - near * per_point
    return counts | {"operations_per_tick": round(saved)}, rows


def _neighbours(rendering: Rendering, carried: Carried) -> float:
    """How many points of a straight stretch lie within r3 + r_v of a proxy that rests on it."""
    reach = 2 * rendering.contact_radius + rendering.point_radius
    rest = rendering.contact_radius + rendering.point_radius
    half = math.sqrt(max(0.0, reach * reach - rest * rest))
    count = float(len(carried.points))
    return min(count, 2 * half / carried.spacing_m + 1) if carried.spacing_m else count


def _rendering_of(
    points: NDArray,
    settings: FixtureSettings,
    registration: Registration,
    choice: Choice | None,
    mesh: NDArray[np.int32] | None,
    slice_axes: NDArray[np.float64] | None,
) -> Rendering:
    """Radii, band, stiffness and ignored axis that the points (N, 3) are rendered with."""
    from vfplan.bundle import mesh_band

    axis = ignored_axis(settings.ignore_axis, registration, slice_axes)
    band = choice and choice.band_m
    if mesh is not None:
        band = mesh_band(points, mesh, settings.contact_radius + settings.point_radius)
    chosen = ProxyParameters.make(
        points,
        contact_radius=settings.contact_radius,
        band=band,
        point_radius=settings.point_radius,
        stiffness=np.broadcast_to(settings.stiffness, 3),
        ignore_axis=axis,
    )
    iterations = choice and choice.max_iterations
    return Rendering(chosen.stiffness, chosen.rc, chosen.band, chosen.rv, axis, iterations)


def ignored_axis(
    choice: str | None,
    registration: Registration,
    slice_axes: NDArray[np.float64] | None = None,
) -> NDArray[np.float64] | None:
    """(3,) unit vector along which the fixture is infinite; `None` for a fixture in space.

    A drawn slice is extruded along its plane's normal unless told otherwise, as the paper ignores
    z in Experiment 2; a curve in space is not extruded.

    Raises `SettingError` for an axis that would collapse the slice, or a normal of no slice.
    """
    T = registration.T_target_source
    columns = T[:3, :2] if slice_axes is None else T[:3, :3] @ slice_axes
    planar = slice_axes is not None or registration.source.shape[1] == 2
    choice = choice or ("normal" if planar else "none")
    if choice == "none":
        return None
    if not planar:
        if choice == "normal":
            raise SettingError("a curve in space has no slice normal; ignore x, y, z or none")
        return check_axis(choice)
    normal = np.cross(columns[:, 0], columns[:, 1])
    normal /= np.linalg.norm(normal)
    if choice == "normal":
        return normal
    axis = check_axis(choice)
    tilt = np.degrees(np.arccos(min(1.0, abs(axis @ normal))))
    if tilt > MAX_IGNORED_TILT_DEG:
        raise SettingError(
            f"ignoring {choice} would collapse the curve: it is {tilt:.1f} degrees from the "
            f"slice's normal; at most {MAX_IGNORED_TILT_DEG:g} are allowed"
        )
    return axis
