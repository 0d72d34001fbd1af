"""What a bundle holds, as frozen dataclasses: a part that a scene does not need is `None`.

Nothing here reads or writes; the modules that do all speak in these types.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.records import FRAMES, Frame, Provenance, RegistrationRecord, StabilityVerdict

__all__ = [
    "FRAMES", "Curve", "Fixture", "Frame", "Guidance", "Pieces", "Provenance", "RegistrationRecord",
    "Rendering", "SourceImage", "StabilityVerdict",
]  # fmt: skip

LEAST_M, MOST_M = 1e-3, 3.0  # across: a mark on a bone, a patient
FARTHEST_M = 10.0  # from the origin: a robot in the same room


@dataclass(frozen=True, eq=False)
class Pieces:
    """A curve as lines and arcs from vertex to vertex; neighbours share theirs: there is no gap.

    Parameters
    ----------
    vertices
        (V, 3) float64, in the unit of the fixture's points.
    bulges
        (V,) tan(sweep / 4) of the piece from each vertex to the next of its stroke: 0 for a line,
        positive where the arc turns left seen with the fixture's ignored axis pointing to the
        viewer (in the frame "image": from u to v); from -1 to 1, a half circle. 0 at the last
        vertex of an open stroke.
    stroke
        (V,) int32, the stroke of each vertex, 0..S-1, never decreasing.
    closed
        (S,) bool, whether a stroke's last piece leads back to its first vertex.
    error
        How far the measured curve lies from the pieces at most, in the unit of the vertices.
    """

    vertices: NDArray[np.float64]
    bulges: NDArray[np.float64]
    stroke: NDArray[np.int32]
    closed: NDArray[np.bool_]
    error: float = 0.0

    @property
    def count(self) -> int:
        """How many lines and arcs."""
        return len(self.bulges) - int((~self.closed).sum())

    def of(self, kept: NDArray[np.bool_]) -> Pieces:
        """Those of the strokes kept, (S,), numbered anew."""
        mine, number = kept[self.stroke], np.cumsum(kept, dtype=np.int32) - 1
        return Pieces(
            self.vertices[mine],
            self.bulges[mine],
            number[self.stroke[mine]],
            self.closed[kept],
            self.error,
        )


@dataclass(frozen=True, eq=False)
class Curve:
    """How a fixture's points were drawn: in strokes, in order.

    Parameters
    ----------
    stroke
        (N,) int32, the stroke each point belongs to, 0..S-1, never decreasing; within a stroke the
        points stand in drawing order.
    closed
        (S,) bool, whether a stroke's last point joins its first.
    bridged
        (N,) bool, points that lie on a bridged pen lift; `None` when nothing was bridged.
    pieces
        The same strokes as lines and arcs; `None` where they are known by their points alone.
    """

    stroke: NDArray[np.int32]
    closed: NDArray[np.bool_]
    bridged: NDArray[np.bool_] | None = None
    pieces: Pieces | None = None


@dataclass(frozen=True)
class SourceImage:
    """The slice a curve was drawn on.

    Parameters
    ----------
    width_px, height_px
        Size of the image [px].
    pixel_spacing_mm
        (along u, along v) [mm/px]; `None` when nobody knows.
    """

    width_px: int
    height_px: int
    pixel_spacing_mm: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Rendering:
    """How the robot shall render the fixture (the paper's Table I).

    Parameters
    ----------
    stiffness
        (3,) K along the axes of the frame [N/m].
    contact_radius
        r_c [m].
    band
        r2 - r_c = r_c - r1 [m].
    point_radius
        r_v [m]; 0 for bare points.
    ignore_axis
        (3,) unit vector along which the fixture is infinite and renders no force; `None` in 3-D.
    max_iterations
        The most iterations of a tick; `None`: the engine's own limit.
    """

    stiffness: NDArray[np.float64]
    contact_radius: float
    band: float
    point_radius: float = 0.0
    ignore_axis: NDArray[np.float64] | None = None
    max_iterations: int | None = None


@dataclass(frozen=True)
class Guidance:
    """Strokes that guide: the tip is kept within a tube around them.

    Parameters
    ----------
    radius
        ρ of the tube [m].
    stiffness
        K beyond it [N/m].
    ends
        What the ends of an open stroke do: "stop" (a cap) or "open" (the tip goes free).
    stroke
        The one stroke that guides, the others are a forbidden region; `None`: every stroke guides,
        and nothing is forbidden.
    lead_force, lead_speed
        Pull along the curve [N], towards its beginning when negative, and the speed [m/s] at which
        it has fallen to 0; `None`: no pull, 0.02 m/s.
    """

    radius: float
    stiffness: float
    ends: Literal["stop", "open"] = "stop"
    stroke: int | None = None
    lead_force: float | None = None
    lead_speed: float | None = None


@dataclass(frozen=True, eq=False)
class Fixture:
    """A virtual fixture, or a curve on its way to becoming one.

    Parameters
    ----------
    frame
        The frame of `points`: "image" (pixels u, v and 0), "robot_base" or "patient_lps" [m].
    points
        (N, 3) float64.
    provenance
        Where it came from.
    sigma
        (N,) standard deviation of each point across the curve, in the unit of `points`.
    curve, image, rendering, guidance, registration, stability
        Present when the scene has them.
    mesh
        (K, 3) int32, rows of `points` that form the triangles of an imported surface.
    """

    frame: Frame
    points: NDArray[np.float64]
    provenance: Provenance
    sigma: NDArray[np.float64] | None = None
    curve: Curve | None = None
    image: SourceImage | None = None
    rendering: Rendering | None = None
    registration: RegistrationRecord | None = None
    stability: StabilityVerdict | None = None
    mesh: NDArray[np.int32] | None = None
    guidance: Guidance | None = None

    @property
    def pieces(self) -> Pieces | None:
        """The curve as lines and arcs, where it is known so."""
        return self.curve and self.curve.pieces

    @property
    def forbidden(self) -> NDArray[np.float64]:
        """(M, 3) the points that a forbidden region is made of, none where all strokes guide."""
        return self.points[:0] if self.region is None else self.region.points

    @property
    def region(self) -> Fixture | None:
        """What is forbidden, as a fixture of its own; `None` where all strokes guide."""
        if self.guidance is None or self.curve is None:
            return self
        if self.guidance.stroke is None:
            return None
        mine = self.curve.stroke != self.guidance.stroke
        kept = np.arange(len(self.curve.closed)) != self.guidance.stroke
        number = np.cumsum(kept, dtype=np.int32) - 1
        bridged = None if self.curve.bridged is None else self.curve.bridged[mine]
        curve = Curve(
            number[self.curve.stroke[mine]],
            self.curve.closed[kept],
            bridged,
            self.pieces and self.pieces.of(kept),
        )
        sigma = None if self.sigma is None else self.sigma[mine]
        return replace(self, points=self.points[mine], sigma=sigma, curve=curve, guidance=None)

    @property
    def stiffness(self) -> NDArray[np.float64]:
        """(3,) K [N/m]."""
        return self._rendering.stiffness

    @property
    def contact_radius(self) -> float:
        """r_c [m]."""
        return self._rendering.contact_radius

    @property
    def band(self) -> float:
        """r2 - r_c [m]."""
        return self._rendering.band

    @property
    def point_radius(self) -> float:
        """r_v [m]."""
        return self._rendering.point_radius

    @property
    def ignore_axis(self) -> NDArray[np.float64] | None:
        """(3,) unit vector, or `None`."""
        return self._rendering.ignore_axis

    @property
    def max_iterations(self) -> int | None:
        """The most iterations of a tick, or `None`."""
        return self._rendering.max_iterations

    @property
    def _rendering(self) -> Rendering:
        if self.rendering is None:
            raise AttributeError(f"a fixture in frame {self.frame!r} without rendering parameters")
        return self.rendering


def size_doubt(points: NDArray[np.float64]) -> str | None:
    """What is doubtful about the size of a fixture's points (N, 3) [m]; `None` if nothing is.

    A slip of units, millimetres for metres or the other way round: the format's own range catches
    the grossest only, and an affine registration fits any scale.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    across = float(np.max(high - low))
    far = float(np.max(np.maximum(np.abs(low), np.abs(high))))
    if far <= FARTHEST_M and (len(points) == 1 or LEAST_M <= across <= MOST_M):
        return None
    return (
        f"the points are {across:.3g} m across and up to {far:.3g} m from the origin along an axis;"
        f" {LEAST_M:g} to {MOST_M:g} m across, within {FARTHEST_M:g} m, is usual: is a unit wrong?"
    )
