"""A fixture: its points, how they were drawn and where they came from; what it lacks is `None`.

Nothing here reads or writes; the modules that do all speak in these types. What a bundle records
beside the points comes first: slice, rendering, guidance, registration, review and verdict.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from operator import attrgetter
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SceneError
from vfplan.findings import Findings
from vfplan.geometry import PixelSpacing
from vfplan.geometry.lines import Array, Flags, length_of, ring_of, values_at
from vfplan.io.files import now_utc
from vfplan.settings import recorded

Frame = Literal["image", "robot_base", "patient_lps"]

# Numbers of strokes, or of points, as a bundle stores them.
StoredIndices = NDArray[np.int32]


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
    pixel_spacing_mm: PixelSpacing = None


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

    stiffness: Array
    contact_radius: float
    band: float
    point_radius: float = 0.0
    ignore_axis: Array | None = None
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
    tool, tip
        The tool that touched the markers, and (3,) its tip in its own frame [m]; `None` when
        nobody said it.
    """

    model: str
    source_frame: Frame
    T_robot_image: Array
    labels: tuple[str, ...]
    source: Array
    target: Array
    residuals_m: Array
    fre_rms_m: float
    loo_rms_m: float | None = None
    tre_rms_m: float | None = None
    covariance: Array | None = None
    tre_m: Array | None = None
    tool: str | None = None
    tip: Array | None = None


@dataclass(frozen=True)
class Review:
    """That a person looked at the plan and approved it.

    It dies with any change: whoever makes another fixture of this one leaves it out.

    Parameters
    ----------
    by
        Who.
    utc
        When, as "2026-01-31T12:00:00Z".
    digest
        `vfplan.bundle.review_digest` of what was approved, lower-case hex.
    """

    by: str
    utc: str
    digest: str


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
    def k_pass_n_per_m(self) -> float:
        """The largest K that passes [N/m]."""
        return self.k_max_n_per_m / self.margin

    @property
    def stable(self) -> bool:
        """Whether K passes."""
        return self.k_n_per_m <= self.k_pass_n_per_m

    def as_dict(self) -> dict[str, str | float | bool]:
        """As a report holds it."""
        return asdict(self) | {"k_pass_n_per_m": self.k_pass_n_per_m, "stable": self.stable}


FRAMES = get_args(Frame)
# Usual smallest extent of a fixture [m]: a mark on a bone.
MIN_EXTENT_M = 1e-3

# Usual largest extent of a fixture [m]: a patient.
MAX_EXTENT_M = 3.0

# Usual largest coordinate [m]: a robot in the same room.
MAX_COORDINATE_M = 10.0


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

    vertices: Array
    bulges: Array
    stroke: StoredIndices
    closed: Flags
    error: float = 0.0

    @property
    def count(self) -> int:
        """How many lines and arcs."""
        return len(self.bulges) - int((~self.closed).sum())

    @classmethod
    def joined(cls, strokes: Sequence[tuple[NDArray, NDArray, bool]]) -> Pieces:
        """Those of strokes, each (vertices (K, 3), bulges (K,), closed)."""
        vertices, bulges, closed = zip(*strokes, strict=True)
        numbers = np.repeat(np.arange(len(bulges), dtype=np.int32), [len(b) for b in bulges])
        return cls(np.concatenate(vertices), np.concatenate(bulges), numbers, np.array(closed))

    def of(self, kept: Flags) -> Pieces:
        """Those of the strokes kept, (S,), numbered anew."""
        mine, number = kept[self.stroke], np.cumsum(kept, dtype=np.int32) - 1
        vertices, bulges, stroke = self.vertices[mine], self.bulges[mine], self.stroke[mine]
        return Pieces(vertices, bulges, number[stroke], self.closed[kept], self.error)


# What may be said of each point of a stroke.
FLAGS = ("bridged", "edited", "hidden")


@dataclass(frozen=True, eq=False)
class Stroke:
    """One line of a drawing, in the unit of its frame: pixels of the slice, or metres.

    Parameters
    ----------
    points
        (M, 2) or (M, 3), in drawing order.
    closed
        Whether the last point joins the first.
    sigma
        (M,) standard deviation of each point across the line; `None` where nobody measured it, as
        of a curve that was drawn as vectors.
    bridged
        (M,) bool, points that were carried across a pen lift, or under something drawn over the
        line.
    edited
        (M,) bool, points that a hand placed and no ink confirms.
    hidden
        (M,) bool, points over which another colour lies. No bundle holds them.
    width
        Mean width of the pen; `None` where nobody measured it.
    is_ordered
        False of bare pixels, as method "mask" gives them: all of the line's ink, in no order.
    known_length
        The length of the line where its points do not tell it: pixels go in stairs, or have no
        order.
    """

    points: Array
    closed: bool
    sigma: Array | None = None
    bridged: Flags | None = None
    edited: Flags | None = None
    hidden: Flags | None = None
    width: float | None = None
    is_ordered: bool = True
    known_length: float | None = None

    def __post_init__(self) -> None:
        """A stroke of which nobody says so is neither bridged, edited nor hidden."""
        for name in FLAGS:
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.zeros(len(self.points), bool))

    # A stroke of an extraction is in pixels.
    points_px = property(attrgetter("points"), doc="(M, 2) the points (u, v).")
    sigma_px = property(attrgetter("sigma"), doc="(M,) standard deviation across the line.")

    @property
    def length(self) -> float:
        """Length of the line, of a closed one back to the first point."""
        if self.known_length is None:
            return length_of(self.points, self.closed)
        return self.known_length

    @property
    def end_points(self) -> Array:
        """(2, K) first and last point; (0, K) of a closed line, or of one in no order."""
        return self.points[:0] if self.closed or not self.is_ordered else self.points[[0, -1]]

    def at(self, parameter: Array) -> Stroke:
        """The stroke through its places at float indices (N,) of its points.

        A place is bridged, edited or hidden as soon as one of its two neighbours is.
        """
        flags = {name: values_at(getattr(self, name).astype(float), parameter) for name in FLAGS}
        return replace(
            self,
            points=values_at(self.points, parameter),
            sigma=None if self.sigma is None else values_at(self.sigma, parameter),
            known_length=self.length,
            **{name: values > 0 for name, values in flags.items()},
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
    edited
        (N,) bool, points that were drawn or moved by hand; `None` when all were measured.
    """

    stroke: StoredIndices
    closed: Flags
    bridged: Flags | None = None
    pieces: Pieces | None = None
    edited: Flags | None = None

    @classmethod
    def of(cls, strokes: Sequence[Stroke]) -> Curve:
        """How these strokes were drawn; the points of one follow those of the other."""
        counts = [len(stroke.points) for stroke in strokes]
        bridged = np.concatenate([stroke.bridged for stroke in strokes])
        edited = np.concatenate([stroke.edited for stroke in strokes])
        return cls(
            np.repeat(np.arange(len(strokes), dtype=np.int32), counts),
            np.array([bool(stroke.closed) for stroke in strokes]),
            bridged=bridged if bridged.any() else None,
            edited=edited if edited.any() else None,
        )


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

    @classmethod
    def now(cls, inputs: dict[str, str], settings: Any) -> Provenance:
        """Of what is made now, or at the time that SOURCE_DATE_EPOCH says, by this program.

        settings: a dataclass, all of which is recorded, or a dict
        Raises `InputError` where SOURCE_DATE_EPOCH is no time.
        """
        from vfplan import __version__

        if not isinstance(settings, dict):
            settings = recorded(settings)
        return cls(now_utc(), f"vfplan {__version__}", inputs, settings)


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
    sample_radius
        How far a place of the mesh may be from the nearest sample [m] where a rule renders points.
        The engine then takes samples of the triangles. `None`: the points are these samples.
    findings
        What a person should look at before the fixture is used, answered or not.
    reviewed
        Who approved it; `None` while nobody has, and again after any change.
    case
        The case that it is for; `None` where nobody said so. It must not name a patient.
    """

    frame: Frame
    points: Array
    provenance: Provenance
    sigma: Array | None = None
    curve: Curve | None = None
    image: SourceImage | None = None
    rendering: Rendering | None = None
    registration: RegistrationRecord | None = None
    stability: StabilityVerdict | None = None
    mesh: StoredIndices | None = None
    guidance: Guidance | None = None
    findings: Findings = ()
    reviewed: Review | None = None
    sample_radius: float | None = None
    case: str | None = None

    @property
    def labels_left_out(self) -> list[str]:
        """The labels of the markers that the registration does not rest on."""
        text = str(self.provenance.settings.get("markers_left_out", ""))
        return [label.replace("%2C", ",").replace("%25", "%") for label in text.split(",") if label]

    @staticmethod
    def labels_as_text(labels: Iterable[str]) -> str:
        """Labels behind commas, as `labels_left_out` reads them; "," and "%" in one are escaped."""
        return ",".join(label.replace("%", "%25").replace(",", "%2C") for label in labels)

    @property
    def open_findings(self) -> Findings:
        """The doubts that nobody has answered."""
        return tuple(finding for finding in self.findings if finding.is_open)

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        """The curve stroke by stroke; none of a bare cloud or a mesh."""
        if self.curve is None:
            return ()
        strokes = []
        for number, closed in enumerate(self.curve.closed):
            rows = self.curve.stroke == number
            strokes.append(Stroke(self.points[rows], bool(closed), *self._known_of(rows)))
        return tuple(strokes)

    def _known_of(self, rows: Flags) -> list[NDArray | None]:
        """The deviations of some points of the curve, and which are bridged and edited."""
        known = (self.sigma, self.curve.bridged, self.curve.edited)
        return [None if values is None else values[rows] for values in known]

    @property
    def guiding_lines(self) -> list[Array]:
        """The strokes that guide, (n, 3) [m]; a closed one ends with its first point again.

        The fixture has `guidance`.
        """
        chosen = self.guidance.stroke
        strokes = self.strokes if chosen is None else [self.strokes[chosen]]
        return [ring_of(stroke.points, stroke.closed) for stroke in strokes]

    @property
    def pieces(self) -> Pieces | None:
        """The curve as lines and arcs, where it is known so."""
        return getattr(self.curve, "pieces", None)

    @property
    def forbidden(self) -> Array:
        """(M, 3) the points that a forbidden region is made of, none where all strokes guide.

        Of a mesh with `sample_radius` these are its samples, the corners first, as in C++.

        Raises `SceneError` for more samples than a bundle may hold.
        """
        if self.region is None:
            return self.points[:0]
        if self.sample_radius is not None:
            from vfplan import _core

            try:
                return _core.sampled(self.points, self.mesh, self.sample_radius)[0]
            except ValueError as error:
                raise SceneError(str(error).removeprefix("vfplan: ")) from None
        return self.region.points

    @property
    def region(self) -> Fixture | None:
        """What is forbidden, as a fixture of its own; `None` where all strokes guide."""
        if self.guidance is None or self.curve is None:
            return self
        if self.guidance.stroke is None:
            return None
        # The points and the strokes that do not guide; these strokes are numbered anew.
        rows = self.curve.stroke != self.guidance.stroke
        strokes = np.arange(len(self.curve.closed)) != self.guidance.stroke
        new_number = np.cumsum(strokes, dtype=np.int32) - 1
        pieces = self.pieces.of(strokes) if self.pieces is not None else None
        number, closed = new_number[self.curve.stroke[rows]], self.curve.closed[strokes]
        sigma, bridged, edited = self._known_of(rows)
        curve = Curve(number, closed, bridged, pieces, edited)
        return replace(self, points=self.points[rows], sigma=sigma, curve=curve, guidance=None)

    def with_settings(self, settings: dict[str, Any]) -> Fixture:
        """The fixture with further settings in its recipe."""
        settings = self.provenance.settings | settings
        return replace(self, provenance=replace(self.provenance, settings=settings))

    # How it is rendered. A fixture that is not rendered raises `AttributeError`.
    stiffness = property(attrgetter("_rendering.stiffness"), doc="(3,) K [N/m].")
    contact_radius = property(attrgetter("_rendering.contact_radius"), doc="r_c [m].")
    band = property(attrgetter("_rendering.band"), doc="r2 - r_c [m].")
    point_radius = property(attrgetter("_rendering.point_radius"), doc="r_v [m].")
    ignore_axis = property(attrgetter("_rendering.ignore_axis"), doc="(3,) unit vector, or `None`.")
    max_iterations = property(
        attrgetter("_rendering.max_iterations"), doc="The most iterations of a tick, or `None`."
    )

    @property
    def _rendering(self) -> Rendering:
        if self.rendering is None:
            raise AttributeError(f"a fixture in frame {self.frame!r} without rendering parameters")
        return self.rendering


def size_doubt(points: Array) -> str | None:
    """What is doubtful about the size of a fixture's points (N, 3) [m]; `None` if nothing is.

    A slip of units, millimetres for metres or the other way round: the format's own range catches
    the grossest only, and an affine registration fits any scale.
    """
    extent = float(np.max(np.ptp(points, axis=0)))
    coordinate = float(np.max(np.abs(points)))
    is_usual_size = len(points) == 1 or MIN_EXTENT_M <= extent <= MAX_EXTENT_M
    if is_usual_size and coordinate <= MAX_COORDINATE_M:
        return None
    return (
        f"The points are {extent:.3g} m across and up to {coordinate:.3g} m from the origin "
        f"along an axis, where {MIN_EXTENT_M:g} to {MAX_EXTENT_M:g} m across and within "
        f"{MAX_COORDINATE_M:g} m is usual. Is a unit wrong?"
    )
