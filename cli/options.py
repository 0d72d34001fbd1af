"""Options that several commands share, each defined once."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click
from vfplan.cli.values import FILE, HDF5, MARGIN, PNG, Duration, Numbers, OrNone, Real, Whole

F = TypeVar("F", bound=Callable[..., Any])


def hold_campaign(given: dict[str, Any], fixture: Any) -> None:
    """Refuse the margin of a campaign on another plan."""
    if given["campaign"] is not None:
        from vfplan.campaign import require_same_plan

        require_same_plan(given["campaign"], fixture)


def _margin_m(folder: Path, p: float) -> float:
    """The margin [m] that a campaign's trials say, to its interval's upper end."""
    from vfplan.campaign import margin_for

    return margin_for(folder, p)


def output(text: str, required: bool = True, kind: click.ParamType = HDF5) -> Callable[[F], F]:
    """`-o/--output FILE` and `--overwrite`, given to the command as `output` and `overwrite`."""

    def wrap(function: F) -> F:
        function = click.option(
            "--overwrite", is_flag=True, help="Replace output files that exist."
        )(function)
        return click.option("-o", "--output", type=kind, required=required, help=text)(function)

    return wrap


def _apply(options: list[Callable[[F], F]]) -> Callable[[F], F]:
    def wrap(function: F) -> F:
        for option in reversed(options):
            function = option(function)
        return function

    return wrap


PIXEL_SPACING = click.option(
    "--pixel-spacing",
    "pixel_spacing_mm",
    type=Numbers(1, 2, metavar="MM[,MM]"),
    callback=lambda ctx, param, value: value if value is None or len(value) == 2 else value * 2,
    help="Size of a pixel along u (between columns) and v (between rows); wins over the file's.",
)


def robot(purpose: str = "") -> Callable[[F], F]:
    """`--robot`: a shipped robot or a file, read by `vfplan.robot.read_robot`; none by default."""
    known = "A shipped robot (franka, fr3), a robot file (schemas/robot-1.1.json), or none."
    return click.option("--robot", metavar="NAME|FILE", help=f"{purpose} {known}".strip())


ROBOT = robot()

# How the curve is read from the image: `extract` and `plan`.
CURVE_OPTIONS = [
    click.option("--colour", default="red", show_default=True, metavar="NAME|#RRGGBB",
                 help="The planning pen's colour."),
    PIXEL_SPACING,
    click.option("--method", type=click.Choice(["ridge", "skeleton", "mask"]), default="ridge",
                 show_default=True, help="Sub-pixel ridge, bare skeleton, or every mask pixel."),
    click.option("--roi", type=Numbers(4, metavar="U,V,W,H", positive=False),
                 callback=lambda c, p, v: _whole_pixels(v),
                 help="Look only in this rectangle of pixels."),
    click.option("--stroke", metavar="all|longest|N", callback=lambda c, p, v: _stroke(c, p, v),
                 help="Which of several candidates is the curve."),
    click.option("--max-gap", "max_gap_px", type=Real(min=0), default=20.0,
                 show_default=True, metavar="PX", help="Bridge pen lifts shorter than this."),
    click.option("--exclude", type=Numbers(4, metavar="U,V,W,H", positive=False), multiple=True,
                 callback=lambda c, p, v: tuple(map(_whole_pixels, v)) or None,
                 help="Do not look in this rectangle of pixels; may be given several times."),
    click.option("--start", type=Numbers(2, metavar="U,V", positive=False),
                 help="Where on the line the curve begins; gives its direction."),
    click.option("--end", type=Numbers(2, metavar="U,V", positive=False),
                 help="Where on the line the curve ends."),
    click.option("--accept-width", is_flag=True, default=None,
                 help="Take a run wider than the rest as one pen's, pressed harder."),
    click.option("--outline", is_flag=True, default=None,
                 help="Take the outline of the one filled region."),
    click.option("--curve", type=FILE, metavar="FILE",
                 help="A curve drawn on the image as vectors: Slicer .mrk.json or .fcsv, ImageJ "
                 ".roi, CSV u_px,v_px or X,Y, or a DICOM presentation state or overlay."),
    click.option("--curve-origin", type=click.Choice(["centre", "corner"]),
                 help="Where on a pixel ImageJ counts from: a line's X,Y from the centre, an "
                 "area's from the corner; asked for where the file leaves it open."),
    click.option("--frame", type=Whole(min=1), metavar="N",
                 help="Which frame of a multi-frame DICOM or page of a TIFF."),
    click.option("--imager-spacing", is_flag=True, default=None,
                 help="Accept DICOM's ImagerPixelSpacing, which is not the patient's."),
    click.option("--mask-out", type=PNG, metavar="PNG", help="Write the pen's mask."),
    click.option("--overlay-out", type=PNG, metavar="PNG",
                 help="Write the slice with the curve found on it, or the candidates' numbers."),
]  # fmt: skip

# How a curve becomes a fixture: `register` and `plan`.
FIXTURE_OPTIONS = [
    click.option("--model", type=click.Choice(["affine", "similarity", "rigid"]), default="affine",
                 show_default=True, help="The transform from image to robot."),
    click.option("--robust", is_flag=True, help="Find and leave out outlying markers; names them."),
    click.option("--tolerance", "tolerance_mm", type=Numbers(1, metavar="MM"),
                 help="How far a surface rendered from points may lie from the drawn one's; "
                 "spacing, band and iteration limit follow from it.  [default: 0.01]"),
    click.option("--density", "density_per_mm", type=Numbers(1, metavar="PTS_PER_MM"),
                 help="Points a millimetre, instead of a tolerance."),
    click.option("--arcs", "arcs_mm", type=OrNone(1, metavar="MM|none"),
                 help="The curve is held as lines and arcs this near to it, which rule `exact` "
                 "renders as they are; `none`: as points alone.  [default: 0.001, where it can]"),
    click.option("--stiffness", type=Numbers(1, 3, metavar="N_PER_M[,Y,Z]"), default="1000",
                 show_default=True, help="K, one for all axes of the robot's base or one each."),
    click.option("--contact-radius", "contact_radius_mm", type=Numbers(1, metavar="MM"),
                 default="5", show_default=True, help="The proxy's radius r_c."),
    click.option("--point-radius", "point_radius_mm", type=Real(min=0), default=0.0,
                 metavar="MM", help="Radius r_v of each point of the cloud.  [default: 0]"),
    click.option("--ignore-axis", type=click.Choice(["normal", "x", "y", "z", "none"]),
                 help="The fixture is infinite along it.  [default: normal, the drawn slice's]"),
    click.option("--seen-from", type=Numbers(3, metavar="X,Y,Z", positive=False),
                 help="Direction in the robot's frame from which the slice is looked at; refuses "
                 "mirrored markers."),
    click.option("--max-tre", "max_tre_mm", type=Numbers(1, metavar="MM"),
                 help="Write nothing (exit 1) unless the registration error stays below this over "
                 "the whole curve (95 % bound)."),
    click.option("--margin", type=MARGIN,
                 help="Add a safety margin: that bound, or what makes entering less probable "
                      "than P by --campaign.  [default: none]"),
    click.option("--campaign", type=FILE, metavar="DIR",
                 help="Folder of `vfplan campaign`, for --margin p=P."),
    click.option("--margin-side", type=click.Choice(["both", "left", "right", "inside", "outside"]),
                 default="both", show_default=True,
                 help="Add it to the point radius, or move the curve to one side (left and right "
                 "of the drawing's direction)."),
    click.option("--find-markers", is_flag=True,
                 help="Take the markers' pixels from the crosses or dots drawn near the given "
                 "ones; says how far each moved."),
    click.option("--guide", "guide_mm", type=Numbers(1, metavar="MM"),
                 help="Keep the tip within a tube of this radius around the curve, instead of "
                 "forbidding what lies near it."),
    click.option("--ends", "guide_ends", type=click.Choice(["stop", "open"]),
                 help="What the ends of an open curve that guides do: a cap, or let the tip go "
                 "free.  [default: stop]"),
    click.option("--guide-stroke", type=click.IntRange(0), metavar="N",
                 help="Only this stroke guides, the others are forbidden.  [default: all guide]"),
    click.option("--guide-pull", type=Numbers(1, 2, metavar="N[,MM_PER_S]", positive=False),
                 help="Lead the tip along the curve with this force, which has fallen to 0 at this "
                 "speed, 20 mm/s unless given.  [default: no pull]"),
    click.option("--guide-cut-bends", is_flag=True,
                 help="Take bends tighter than the tube is wide: the tip may cut them."),
    click.option("--picture-out", type=PNG, metavar="PNG",
                 help="Write the slice with the residuals and the error along the curve."),
]  # fmt: skip


def _stroke(ctx: click.Context, param: click.Parameter, value: str | None) -> str | int | None:
    if value is None or value in ("all", "longest"):
        return value
    if value.isdecimal():
        return int(value)
    raise click.BadParameter(f"{value!r} is neither 'all', 'longest' nor a stroke's number")


def _whole_pixels(value: tuple[float, ...] | None) -> tuple[int, ...] | None:
    if value is not None and not all(x.is_integer() and abs(x) < 2**31 for x in value):
        shown = ",".join(f"{x:g}" for x in value)
        if all(x.is_integer() for x in value):
            raise click.BadParameter(f"'{shown}' holds a number that no image's pixels reach")
        raise click.BadParameter(f"'{shown}' holds a part of a pixel; whole ones are wanted")
    return value and tuple(map(int, value))


def curve_options(function: F) -> F:
    """The options of `CURVE_OPTIONS`; collect them with `extract_settings`."""
    return _apply(CURVE_OPTIONS)(function)


def fixture_options(function: F) -> F:
    """The options of `FIXTURE_OPTIONS`; collect them with `fixture_settings`."""
    return _apply(FIXTURE_OPTIONS)(function)


def extract_settings(given: dict[str, Any], **more: Any) -> Any:
    """`vfplan.planning.ExtractSettings` from a command's arguments."""
    from vfplan.planning import ExtractSettings

    names = ("colour", "pixel_spacing_mm", "method", "roi", "stroke", "max_gap_px", "frame")
    names += ("exclude", "start", "end", "accept_width", "outline", "curve_origin")
    more["imager_spacing"] = given["imager_spacing"] or None
    return ExtractSettings(**{n: given[n] for n in names}, **more)


def fixture_settings(given: dict[str, Any]) -> Any:
    """`vfplan.planning.FixtureSettings` from a command's arguments."""
    from vfplan.planning import FixtureSettings

    if given["tolerance_mm"] and given["density_per_mm"]:
        raise click.UsageError("--tolerance and --density exclude each other; give one")
    if given["margin"] is None and given["margin_side"] != "both":
        raise click.UsageError(
            "--margin-side adds nothing by itself; give --margin tre95 or p=P too"
        )
    probability = isinstance(given["margin"], float)
    if probability != (given["campaign"] is not None):
        raise click.UsageError("--margin p=P and --campaign DIR: both or neither")
    more = given["guide_ends"], given["guide_pull"], given["guide_cut_bends"]
    if given["guide_mm"] is None and (any(more) or given["guide_stroke"] is not None):
        raise click.UsageError(
            "--ends, --guide-stroke, --guide-pull and --guide-cut-bends have no effect without "
            "--guide MM"
        )
    pull = given["guide_pull"] or ()
    density = given["density_per_mm"]
    return FixtureSettings(
        model=given["model"],
        robust=given["robust"],
        tolerance_m=(given["tolerance_mm"] or (0.01,))[0] * 1e-3,
        density_per_m=density and density[0] * 1e3,
        arcs_m=given["arcs_mm"][0] * 1e-3 if given["arcs_mm"] else None,
        points_only=given["arcs_mm"] == (),
        stiffness=given["stiffness"],
        contact_radius=given["contact_radius_mm"][0] * 1e-3,
        point_radius=given["point_radius_mm"] * 1e-3,
        ignore_axis=given["ignore_axis"],
        seen_from=given["seen_from"],
        max_tre_m=given["max_tre_mm"] and given["max_tre_mm"][0] * 1e-3,
        margin=_margin_m(given["campaign"], given["margin"]) if probability else given["margin"],
        margin_side=given["margin_side"],
        find_markers=given["find_markers"],
        guide_m=given["guide_mm"] and given["guide_mm"][0] * 1e-3,
        guide_ends=given["guide_ends"],
        guide_stroke=given["guide_stroke"],
        guide_pull=(*pull[:1], *(1e-3 * speed for speed in pull[1:])),
        guide_cut_bends=given["guide_cut_bends"],
    )


def signature(keys_option: str = "--require-signature", required: bool = False) -> Callable[[F], F]:
    """What a bundle's signature must satisfy; the command gets `trust`, a `Trust` or `None`."""

    def wrap(function: F) -> F:
        @functools.wraps(function)
        def body(
            keys: Path | None,
            case: str | None,
            robot_serial: str | None,
            max_age: float | None,
            **kwargs: Any,
        ) -> Any:
            if keys is None:
                if (case, robot_serial, max_age) != (None, None, None):
                    raise click.UsageError(
                        f"--case, --robot-serial and --max-age need {keys_option} KEYS"
                    )
                return function(trust=None, **kwargs)
            from vfplan.bundle import Trust, read_keys

            return function(trust=Trust(read_keys(keys), case, robot_serial, max_age), **kwargs)

        for option in (
            click.option("--max-age", type=Duration(), help="How long ago it was registered."),
            click.option("--robot-serial", help="The robot it must be signed for."),
            click.option("--case", help="The case token it must be signed for."),
            click.option(
                keys_option,
                "keys",
                type=FILE,
                required=required,
                metavar="KEYS",
                help="File of trusted public keys (PEM); refuse what none of them signed.",
            ),
        ):
            body = option(body)
        return body  # type: ignore[return-value]

    return wrap
