"""What a user may choose about a plan, with its defaults: the only place they are written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from vfplan.bundle.content import max_number
from vfplan.errors import SettingError

# How far lines and arcs may lie from the measured curve [m]: no measurement is as fine.
MIN_ARCS_M = 1e-7

# No pen is as coarse.
MAX_ARCS_M = 1e-3

# A tenth of the tolerance that points are sampled with [m].
DEFAULT_ARCS_M = 1e-6

# Speed [m/s] at which a guide's pull has fallen to 0, unless it is given.
LEAD_SPEED_M_S = 0.02

AXES = (None, "normal", "x", "y", "z", "none")


@dataclass(frozen=True)
class ExtractSettings:
    """How the curve is taken from the image.

    Parameters
    ----------
    colour
        The pen: a name or "#rrggbb".
    method
        "ridge", "skeleton" or "mask" (the paper's: every mask pixel a point).
    stroke
        "all", "longest", an index, or `None`: the only one there is.
    roi
        (u, v, width, height) [px] to look in; `None`: the whole image.
    max_gap_px
        Pen lifts shorter than this are bridged.
    exclude
        Rectangles as `roi` that are not looked at.
    start, end
        (u, v) [px] on the curve where it begins and ends; `None`: its own ends.
    accept_width
        Take a run that is wider than the rest as one pen's; `None`: do not.
    curve_origin
        "centre" or "corner": where on a pixel the whole numbers of an ImageJ vector curve lie, if
        its file leaves it open; `None`: as the file says.
    pixel_spacing_mm
        (along u, along v); `None`: what the file says.
    density_per_mm
        Points a millimetre; `None`: one a pixel.
    frame
        Which frame or page of the file, from 1; `None`: the only one there is.
    imager_spacing
        Accept DICOM's ImagerPixelSpacing, measured at the detector; `None`: do not.
    max_megapixels
        A larger picture is refused, in millions of pixels; `None`: 64.

    Raises
    ------
    SettingError
        A density that is not positive and finite.
    """

    colour: str = "red"
    method: str = "ridge"
    stroke: str | int | None = None
    roi: tuple[int, int, int, int] | None = None
    max_gap_px: float = 20.0
    exclude: tuple[tuple[int, int, int, int], ...] | None = None
    start: tuple[float, float] | None = None
    end: tuple[float, float] | None = None
    accept_width: bool | None = None
    curve_origin: Literal["centre", "corner"] | None = None
    pixel_spacing_mm: tuple[float, float] | None = None
    density_per_mm: float | None = None
    frame: int | None = None
    imager_spacing: bool | None = None
    max_megapixels: float | None = None

    def __post_init__(self) -> None:
        """Refuse a density of no points, before any work is done; raises `SettingError`."""
        if self.density_per_mm is not None and not 0 < self.density_per_mm < float("inf"):
            raise SettingError(
                f"density is {self.density_per_mm:g} points a millimetre. Give a finite "
                "number above 0",
                code="density-range",
            )


@dataclass(frozen=True)
class FixtureSettings:
    """How a registered curve becomes a fixture.

    Parameters
    ----------
    model, robust
        The registration; see `vfplan.fit_registration`.
    tolerance_m
        How far a surface rendered from points may lie from the drawn one [m];
        `vfplan.planning.tolerance` takes spacing, band and iteration limit from it.
    density_per_m
        Points a metre; takes the place of the tolerance.
    arcs_m
        The strokes are also held as lines and arcs this near to the measured curve [m], which
        rule "exact" renders; `None`: 1 µm, where they forbid across an ignored axis.
    points_only
        No lines and arcs: the fixture is rendered from its points.
    stiffness
        K [N/m], one number or one an axis.
    contact_radius, point_radius
        r_c and r_v [m].
    ignore_axis
        "normal" (of the slice), "x", "y", "z" or "none"; `None`: the normal where there is one.
    seen_from
        "above", "below", or the (3,) direction in the robot's frame from which the slice is looked
        at; refuses mirrored markers. `None`: not checked, but a slice seen from below is a finding.
    max_residual_m
        Gate: largest RMS residual of the markers used [m]; `None`: any.
    max_tre_m
        Gate: largest registration error anywhere on the curve, as a 95 % bound [m]; `None`: any.
        "contact radius" is that radius.
    markers_as_given
        Take the markers even if they meet no drawn marks, or if another order of their labels fits
        clearly better.
    common
        Use the markers that both sides have; without it both sides must have the same.
    margin
        "tre95" adds that bound to the point radius as a safety margin, a number so many metres;
        `None`: no margin.
    find_markers
        Take the markers' pixels from the crosses or dots drawn near the given ones.
    guide_m
        Radius of the tube around the curve that the tip is kept in [m]; `None`: the curve is a
        forbidden region.
    guide_ends
        "stop" or "open": what an open curve's ends do; `None`: stop.
    guide_stroke
        The one stroke that guides, while the others are forbidden; `None`: every stroke guides.
    guide_pull
        Pull along the curve [N] and the speed [m/s] at which it has fallen to 0; (): none.
    guide_cut_bends
        Take bends that are tighter than the tube is wide.

    Raises
    ------
    SettingError
        A radius or a stiffness that no bundle can hold, or more said of a guide that is none.
    """

    model: str = "affine"
    robust: bool = False
    tolerance_m: float = 1e-5
    density_per_m: float | None = None
    arcs_m: float | None = None
    points_only: bool = False
    # One number is held as a tuple of one.
    stiffness: float | tuple[float, ...] = (1000.0,)
    contact_radius: float = 5e-3
    point_radius: float = 0.0
    ignore_axis: str | None = None
    seen_from: tuple[float, float, float] | str | None = None
    max_residual_m: float | None = 1e-3
    max_tre_m: float | Literal["contact radius"] | None = "contact radius"
    markers_as_given: bool = False
    common: bool = False
    margin: str | float | None = None
    find_markers: bool = False
    guide_m: float | None = None
    guide_ends: Literal["stop", "open"] | None = None
    guide_stroke: int | None = None
    guide_pull: tuple[float, ...] = ()
    guide_cut_bends: bool = False

    def __post_init__(self) -> None:
        """Refuse what no bundle can hold, before any work is done; raises `SettingError`."""
        from vfplan.engine.parameters import PAPER_BAND

        if isinstance(self.stiffness, (int, float)):
            object.__setattr__(self, "stiffness", (self.stiffness,))
        # A contact radius, or a tube, below the band cannot be rendered.
        largest_mm = 1e3 * max_number("/rendering@contact_radius_m")
        contact_mm = 1e3 * self.contact_radius
        _check_range("contact radius", contact_mm, 1e3 * PAPER_BAND, largest_mm, "mm")
        largest_mm = 1e3 * max_number("/rendering@point_radius_m")
        _check_range("point radius", 1e3 * self.point_radius, 0.0, largest_mm, "mm")
        for stiffness in self.stiffness:
            largest = max_number("/rendering/stiffness")
            _check_range("stiffness", stiffness, 0.0, largest, "N/m")
        if len(self.stiffness) not in (1, 3):
            raise SettingError(
                f"stiffness is {len(self.stiffness)} numbers. Give 1 or 3", code="stiffness-count"
            )
        if self.arcs_m is not None:
            _check_range("arcs", 1e3 * self.arcs_m, 1e3 * MIN_ARCS_M, 1e3 * MAX_ARCS_M, "mm")
        if self.ignore_axis not in AXES:
            raise SettingError(
                f"ignored axis is {self.ignore_axis!r}. Give normal, x, y, z or none",
                code="axis-unknown",
            )

        # The gates.
        for name, limit in (("max_residual_m", self.max_residual_m), ("max_tre_m", self.max_tre_m)):
            if isinstance(limit, (int, float)) and not 0 < limit < float("inf"):
                raise SettingError(
                    f"{name} is {limit:g} m. Give a finite length above 0, or None",
                    code="gate-range",
                )
        if isinstance(self.max_tre_m, str) and self.max_tre_m != "contact radius":
            raise SettingError(
                f"max_tre_m is {self.max_tre_m!r}. Give a length [m], None or 'contact radius'",
                code="gate-range",
            )

        # The guide.
        if self.guide_m is None:
            more = self.guide_ends, self.guide_pull, self.guide_cut_bends
            if any(more) or self.guide_stroke is not None:
                raise SettingError(
                    "--ends, --guide-stroke, --guide-pull and --guide-cut-bends have no "
                    "effect without a guide. Give --guide MM too",
                    code="no-guide",
                )
            return
        largest_m = max_number("/guidance@radius_m")
        _check_range("guide", 1e3 * self.guide_m, 1e3 * PAPER_BAND, 1e3 * largest_m, "mm")
        if min(self.stiffness) <= 0:
            raise SettingError(
                "a guide of stiffness 0 does not hold the tip. Give a stiffness above 0",
                code="guide-stiffness",
            )
        if self.margin is not None and self.guide_stroke is None:
            raise SettingError(
                "a margin has no effect on a guide, only on what is forbidden beside one. "
                "Leave --margin out, or name the --guide-stroke",
                code="guide-margin",
            )
        if len(self.guide_pull) > 2:
            raise SettingError(
                f"guide pull is {len(self.guide_pull)} numbers. Give a force, and a speed if "
                "you like",
                code="guide-pull",
            )
        if self.guide_pull:
            force, speed = (*self.guide_pull, LEAD_SPEED_M_S)[:2]
            max_force = max_number("/guidance@lead_force_n")
            max_speed = max_number("/guidance@lead_speed_m_s")
            if not (abs(force) <= max_force and 0 < speed <= max_speed):
                raise SettingError(
                    f"guide pull is {force:g} N at {1e3 * speed:g} mm/s. Give "
                    f"{-max_force:g} to {max_force:g} N, and above 0 to "
                    f"{1e3 * max_speed:g} mm/s",
                    code="guide-pull",
                )

    @property
    def max_tre_length_m(self) -> float | None:
        """The gate `max_tre_m` as a length [m]; `None`: any error is taken."""
        return self.contact_radius if self.max_tre_m == "contact radius" else self.max_tre_m


def _check_range(name: str, value: float, smallest: float, largest: float, unit: str) -> None:
    if not smallest <= value <= largest:
        raise SettingError(
            f"{name} is {value:g} {unit}. Give {smallest:g} to {largest:g} {unit}",
            code="setting-range",
            numbers={"value": value, "smallest": smallest, "largest": largest},
        )
