"""What a user may choose about a plan, with its defaults: the only place they are written."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

from vfplan.engine import PAPER_BAND
from vfplan.errors import SettingError
from vfplan.findings import Finding, note
from vfplan.io.files import parse_decimal
from vfplan.settings import is_length, scale_of, setting

# How far lines and arcs may lie from the measured curve [m]: no measurement is as fine.
MIN_ARCS_M = 1e-7

# A tenth of the tolerance that points are sampled with [m].
DEFAULT_ARCS_M = 1e-6

# Speed [m/s] at which a guide's pull has fallen to 0, unless it is given.
LEAD_SPEED_M_S = 0.02

# Setting of a recipe: the 95 % bound of the error over the whole curve that `register` found [m].
CURVE95 = "curve95_max_m"


def margin_length(margin: str | float | None, bound_m: float | None) -> str | float | None:
    """A margin [m], of which "tre95" stands for the bound; a text that is no margin stays as it is.

    margin: as in `FixtureSettings`; bound_m: the 95 % bound, `None` where there is none
    """
    kind, plus, tip_mm = str(margin).partition("+")
    if kind != "tre95":
        return margin
    try:
        tip_m = 1e-3 * parse_decimal(tip_mm) if plus else 0.0
    except ValueError:
        return margin
    if tip_m < 0:
        return margin
    return None if bound_m is None else bound_m + tip_m


# A length, or none of them.
GATE = {
    "form": "MM|none",
    "unit": "mm",
    "from_option": lambda millimetres: 1e-3 * millimetres[0] if millimetres else None,
}


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
    curve_type
        "spline" or "linear": what Slicer draws through the points of its curve, which only its
        scene says; `None`: its default, a spline, with a doubt where a line differs.
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
    pixels
        "as-shown" or "as-stored": whether the files of markers and curves count the pixels of the
        picture as EXIF turns it, or as they are stored; `None`: as shown, with a doubt.

    Raises
    ------
    SettingError
        A density that is not positive and finite.
    """

    colour: str = setting("red", "Colour of the planning pen.", form="NAME|#RRGGBB")
    method: Literal["ridge", "skeleton", "mask"] = setting(
        "ridge", "Measure the middle of the line (ridge), thin it (skeleton), or take every pixel "
        "of the pen (mask).", choices=("ridge", "skeleton", "mask"),
    )  # fmt: skip
    stroke: str | int | None = setting(
        None, "Take this candidate if there are several.", form="all|longest|N"
    )
    roi: tuple[int, int, int, int] | None = setting(
        None, "Look for the line in this rectangle only [px].", form="U,V,W,H"
    )
    max_gap_px: float = setting(
        20.0, "Bridge gaps in the pen's line up to this length [px].", form="PX",
        least=0,
    )  # fmt: skip
    exclude: tuple[tuple[int, int, int, int], ...] | None = setting(
        None, "Ignore the ink in this rectangle [px]; repeatable.", form="U,V,W,H",
        repeatable=True, from_option=lambda rectangles: rectangles or None,
    )  # fmt: skip
    start: tuple[float, float] | None = setting(
        None, "Begin the curve at this place on the line [px].", form="U,V"
    )
    end: tuple[float, float] | None = setting(
        None, "End the curve at this place on the line [px].", form="U,V"
    )
    accept_width: bool | None = setting(
        None, "Take a wider stretch as the same pen, pressed harder.", flag=True
    )
    curve_origin: Literal["centre", "corner"] | None = setting(
        None, "Count ImageJ's X,Y from the centre or from the corner of a pixel. Needed if the "
        "file does not say it.", choices=("centre", "corner"),
    )  # fmt: skip
    curve_type: Literal["spline", "linear"] | None = setting(
        None, "What Slicer draws through the points of a curve; only its scene says it.  [default: "
        "spline, with a doubt if a line differs]", choices=("spline", "linear"),
    )  # fmt: skip
    pixel_spacing_mm: tuple[float, float] | None = setting(
        None, "Size of a pixel along u and v [mm], in place of the size in the file.",
        form="MM[,MM]", from_option=lambda spacing: spacing * (2 // len(spacing)),
    )  # fmt: skip
    density_per_mm: float | None = setting(
        None, "Put this many points on a millimetre. This needs a pixel spacing.  [default: one a "
        "pixel]", option="density", form="PTS_PER_MM",
    )  # fmt: skip
    frame: int | None = setting(
        None, "Read this frame of a multi-frame DICOM, or this page of a TIFF.",
        option="page frame", form="N", least=1, whole=True,
    )  # fmt: skip
    imager_spacing: bool | None = setting(
        None, "Take the pixel spacing from DICOM's ImagerPixelSpacing, which is that of the "
        "detector and not of the patient.", flag=True,
    )  # fmt: skip
    max_megapixels: float | None = setting(
        None, "Read pictures of up to this many million pixels.  [default: 64]", form="N", above=0
    )
    pixels: Literal["as-shown", "as-stored"] | None = setting(
        None, "Say how the other files count pixels if EXIF turns the picture: as shown, or as "
        "stored.  [default: as-shown, with a doubt]", choices=("as-shown", "as-stored"),
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Refuse a density of no points, before any work is done; raises `SettingError`."""
        if self.density_per_mm is not None and not is_length(self.density_per_mm):
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
        "tre95" adds that bound to the point radius as a safety margin, "tre95+0.2" that and 0.2 mm
        for the error of the tip that touched the markers, a number so many metres;
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

    model: Literal["affine", "similarity", "rigid"] = setting(
        "affine", "Kind of transform from image to robot.",
        choices=("affine", "similarity", "rigid"),
    )  # fmt: skip
    robust: bool = setting(False, "Leave out markers that do not fit, and name them.")
    tolerance_m: float = setting(
        1e-5, "Allow a surface that is rendered from points to lie this far from the drawn one "
        "[mm].  [default: 0.01]", form="MM", unit="mm",
    )  # fmt: skip
    density_per_m: float | None = setting(
        None, "Put this many points on a millimetre, in place of --tolerance.", option="density",
        form="PTS_PER_MM", unit="1/mm",
    )  # fmt: skip
    arcs_m: float | None = setting(
        None, "Fit lines and arcs to the curve within this distance [mm]; none makes points only.  "
        "[default: 0.001, if it can be reached]", least=MIN_ARCS_M, most="/pieces@error_m", **GATE,
    )  # fmt: skip
    points_only: bool = setting(False, "", option="arcs", from_option=lambda arcs: arcs == ())
    # One number is held as a tuple of one.
    stiffness: float | tuple[float, ...] = setting(
        (1000.0,), "Stiffness K [N/m]: one number, or one for each axis.", form="N_PER_M[,Y,Z]",
        unit="N/m", least=0.0, most="/rendering/stiffness",
    )  # fmt: skip
    # A contact radius, or a tube, below the band cannot be rendered.
    contact_radius: float = setting(
        5e-3, "Distance of the wall from what is drawn [mm].", form="MM", unit="mm",
        least=PAPER_BAND, most="/rendering@contact_radius_m",
    )  # fmt: skip
    point_radius: float = setting(
        0.0, "Radius of each point, added to the contact radius [mm].", form="MM", unit="mm",
        least=0.0, most="/rendering@point_radius_m",
    )  # fmt: skip
    ignore_axis: str | None = setting(
        None, "Extend the fixture without end along this axis.  [default: normal, of the drawn "
        "slice]", choices=("normal", "x", "y", "z", "none"),
    )  # fmt: skip
    seen_from: tuple[float, float, float] | str | None = setting(
        None, "Say from which side you look at the slice: above (robot +z), below, or a direction "
        "in the robot's frame. Refuse markers that say otherwise.", form="above|below|X,Y,Z",
    )  # fmt: skip
    max_residual_m: float | None = setting(
        1e-3, "Refuse markers whose residual (rms) is larger [mm].  [default: 1]", **GATE
    )
    max_tre_m: float | Literal["contact radius"] | None = setting(
        "contact radius", "Refuse a plan whose 95 % bound of the error is larger [mm].  [default: "
        "the contact radius]", **GATE,
    )  # fmt: skip
    markers_as_given: bool = setting(
        False, "Skip the checks of the labels and of the marks on the slice."
    )
    common: bool = setting(False, "Use the markers that both files have, and drop the others.")
    margin: str | float | None = setting(
        None, "Add this to the point radius: the 95 % bound (tre95) and the tip's error (+MM), or "
        "the margin that --campaign gives for P.  [default: no margin]", form="tre95[+MM]|p=P",
    )  # fmt: skip
    find_markers: bool = setting(
        False, "Move each marker to the centre of the cross or dot that is drawn near it."
    )
    guide_m: float | None = setting(
        None, "Make a guide: keep the tip in a tube of this radius around the curve [mm].",
        form="MM", unit="mm", least=PAPER_BAND, most="/guidance@radius_m",
    )  # fmt: skip
    guide_ends: Literal["stop", "open"] | None = setting(
        None, "Close the ends of a guide's tube, or let the tip leave there.  [default: stop]",
        option="ends", choices=("stop", "open"),
    )  # fmt: skip
    guide_stroke: int | None = setting(
        None, "Guide along this stroke only; the others are a forbidden region.  [default: all "
        "strokes guide]", form="N", least=0, whole=True,
    )  # fmt: skip
    guide_pull: tuple[float, ...] = setting(
        (), "Pull the tip along the curve with this force [N], which falls to 0 at this speed "
        "[mm/s].  [default: no pull; 20 mm/s]", form="N[,MM_PER_S]",
        from_option=lambda pull: (*pull[:1], *(1e-3 * speed for speed in pull[1:])),
    )  # fmt: skip
    guide_cut_bends: bool = setting(
        False, "Accept a bend that is tighter than the tube. The tip may cut it."
    )

    def __post_init__(self) -> None:
        """Refuse what no bundle can hold, before any work is done; raises `SettingError`."""
        if isinstance(self.stiffness, (int, float)):
            object.__setattr__(self, "stiffness", (self.stiffness,))
        check_ranges(self)
        if len(self.stiffness) not in (1, 3):
            raise SettingError(
                f"stiffness is {len(self.stiffness)} numbers. Give 1 or 3", code="stiffness-count"
            )
        if self.guide_m is not None:
            self._check_guide()
        elif any((self.guide_ends, self.guide_pull, self.guide_cut_bends)) or (
            self.guide_stroke is not None
        ):
            raise SettingError(
                "--ends, --guide-stroke, --guide-pull and --guide-cut-bends have no effect without "
                "a guide. Give --guide MM too",
                code="no-guide",
            )

    def _check_guide(self) -> None:
        if self.margin is not None and self.guide_stroke is None:
            raise SettingError(
                "a margin has no effect on a guide, only on what is forbidden beside one. "
                "Leave --margin out, or name the --guide-stroke",
                code="guide-margin",
            )
        if not self.guide_pull:
            return
        from vfplan.bundle.content import max_number  # As in `check_ranges`.

        force, speed = (*self.guide_pull, LEAD_SPEED_M_S)[:2]
        max_force = max_number("/guidance@lead_force_n")
        max_speed = max_number("/guidance@lead_speed_m_s")
        is_in_range = abs(force) <= max_force and 0 < speed <= max_speed
        if len(self.guide_pull) > 2 or not is_in_range:
            raise SettingError(
                f"guide pull is {force:g} N at {1e3 * speed:g} mm/s, of {len(self.guide_pull)} "
                f"numbers. Give {-max_force:g} to {max_force:g} N "
                f"and, if you like, above 0 to {1e3 * max_speed:g} mm/s",
                code="guide-pull",
            )

    @property
    def max_tre_length_m(self) -> float | None:
        """The gate `max_tre_m` as a length [m]; `None`: any error is taken."""
        return self.contact_radius if self.max_tre_m == "contact radius" else self.max_tre_m


def check_ranges(settings: FixtureSettings) -> None:
    """Refuse a number out of the range of its field; raises `SettingError`."""
    # Here and not above, because `vfplan COMMAND --help` needs none of it.
    from vfplan.bundle.content import max_number

    for one in fields(settings):
        rule = one.metadata
        value = getattr(settings, one.name)
        if value is None or "most" not in rule:
            continue
        unit, scale = rule["unit"], 1 / scale_of(one)
        smallest, largest = rule["least"] * scale, max_number(rule["most"]) * scale
        for number in value if isinstance(value, tuple) else (value,):
            number = number * scale
            if not smallest <= number <= largest:
                name = one.name.removesuffix("_m").replace("_", " ")
                raise SettingError(
                    f"{name} is {number:g} {unit}. Give {smallest:g} to {largest:g} {unit}",
                    code="setting-range",
                    numbers={"value": number, "smallest": smallest, "largest": largest},
                )


def overridden(recipe: FixtureSettings, settings: FixtureSettings) -> list[Finding]:
    """A note for each setting in which a plan departs from the recipe of its bundle."""
    text = "Planned with {} {!r}, as given; the bundle was planned with {!r}."
    return [
        note("recipe-overridden", "plan", text.format(name, getattr(settings, name), before))
        for name, before in vars(recipe).items()
        if getattr(settings, name) != before
    ]
