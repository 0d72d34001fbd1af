"""What a bundle holds, as frozen dataclasses: a part that a scene does not need is `None`.

Nothing here reads, writes or computes; the modules that do all speak in these types.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Frame = Literal["image", "robot_base", "patient_lps"]
FRAMES: tuple[Frame, ...] = ("image", "robot_base", "patient_lps")


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
    """

    radius: float
    stiffness: float
    ends: Literal["stop", "open"] = "stop"
    stroke: int | None = None


@dataclass(frozen=True, eq=False)
class RegistrationRecord:
    """The registration that carried the points into the robot's frame, and its error.

    Parameters
    ----------
    model
        "affine", "similarity" or "rigid".
    source_frame
        The frame of `source`: "image" [px] or "patient_lps" [m].
    T_robot_image
        (3, 3) acting on [u v 1], or (4, 4) acting on [x y z 1]; maps into `robot_base` [m].
    labels
        (M,) marker labels.
    source, target
        (M, 2|3) marker positions in the source frame and (M, 3) in `robot_base` [m].
    residuals_m
        (M,) distance of each marker from where the transform puts it [m].
    fre_rms_m, loo_rms_m, tre_rms_m
        Root mean squares [m]: fiducial registration error, leave-one-out, and the target
        registration error predicted over the curve.
    covariance
        (P, P) covariance of the transform's parameters, row-major T; `None` when unknown.
    tre_m
        (N,) predicted RMS TRE at each of the fixture's points [m]; `None` when unknown.
    """

    model: str
    source_frame: Frame
    T_robot_image: NDArray[np.float64]
    labels: tuple[str, ...]
    source: NDArray[np.float64]
    target: NDArray[np.float64]
    residuals_m: NDArray[np.float64]
    fre_rms_m: float
    loo_rms_m: float | None = None
    tre_rms_m: float | None = None
    covariance: NDArray[np.float64] | None = None
    tre_m: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class StabilityVerdict:
    """The stability gate's verdict on a fixture's K with one robot.

    Parameters
    ----------
    robot
        Its name.
    mass_kg, damping_n_s_per_m, rate_hz, delay_ticks
        What was simulated.
    k_n_per_m
        The K judged: the largest in any direction that the fixture renders [N/m].
    k_max_n_per_m
        The largest stable K found in closed loop [N/m].
    margin
        What K is multiplied by before it is held against `k_max_n_per_m`.
    """

    robot: str
    mass_kg: float
    damping_n_s_per_m: float
    rate_hz: float
    delay_ticks: int
    k_n_per_m: float
    k_max_n_per_m: float
    margin: float

    @property
    def k_linear_bound_n_per_m(self) -> float:
        """b / (T/2 + t_d) [N/m]."""
        return self.damping_n_s_per_m * self.rate_hz / (0.5 + self.delay_ticks)

    @property
    def k_pass_n_per_m(self) -> float:
        """The largest K that passes [N/m]."""
        return self.k_max_n_per_m / self.margin

    @property
    def stable(self) -> bool:
        """Whether K passes."""
        return self.k_n_per_m <= self.k_pass_n_per_m

    def as_dict(self) -> dict[str, str | float | bool]:
        """As a report holds it."""
        derived = ("k_linear_bound_n_per_m", "k_pass_n_per_m", "stable")
        return asdict(self) | {name: getattr(self, name) for name in derived}


@dataclass(frozen=True)
class Provenance:
    """Where a bundle came from; holds no file names, paths or patient identifiers.

    Parameters
    ----------
    created_utc
        ISO 8601, whole seconds, ending in "Z".
    software
        "vfplan VERSION".
    inputs
        Role ("image", "markers_image", ...) -> SHA-256 of the bytes, lower-case hex.
    settings
        The settings in force, by name.
    history
        One line for each earlier form of the file (migrations), oldest first.
    """

    created_utc: str
    software: str
    inputs: dict[str, str] = field(default_factory=dict)
    settings: dict[str, str | float | int | bool] = field(default_factory=dict)
    history: tuple[str, ...] = ()


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
    def forbidden(self) -> NDArray[np.float64]:
        """(M, 3) the points that a forbidden region is made of, none where all strokes guide."""
        if self.guidance is None or self.curve is None:
            return self.points
        if self.guidance.stroke is None:
            return self.points[:0]
        return self.points[self.curve.stroke != self.guidance.stroke]

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
