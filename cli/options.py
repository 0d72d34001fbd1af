"""Options that several commands share, each defined once."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import fields
from typing import Any, TypeVar

import click
from vfplan.cli.values import FILE, HDF5, MM, PNG, Number, Numbers, Parsed, Real, Whole

from vfplan.io.files import parse_decimal

F = TypeVar("F", bound=Callable[..., Any])


def option(*names: str, **more: Any) -> Callable[[F], F]:
    """`click.option`, whose default is shown where it has one."""
    return click.option(*names, **({"show_default": more.get("default") not in (None, "")} | more))


def taking(*options: Callable[[F], F]) -> Callable[[F], F]:
    """These options, in this order."""

    def wrap(function: F) -> F:
        for one in reversed(options):
            function = one(function)
        return function

    return wrap


OVERWRITE = option("--overwrite", is_flag=True, help="Replace output files that exist.")
FIXTURE = click.argument("fixture", type=FILE, metavar="FIXTURE.h5")
SESSION = click.argument("session", type=FILE, metavar="SESSION")
UNITS = option("--units", type=click.Choice(["m", "mm"]), default="m",
               help="Unit of the session's positions.")  # fmt: skip


def output(text: str, required: bool = True, kind: click.ParamType = HDF5) -> Callable[[F], F]:
    """`-o/--output FILE`, given to the command as `output`, and `--overwrite`."""
    return taking(option("-o", "--output", type=kind, required=required, help=text), OVERWRITE)


def _stroke(text: str) -> str | int:
    """`all`, `longest` or a stroke's number."""
    if text not in ("all", "longest") and not text.isdecimal():
        raise ValueError(f"{text!r} is neither 'all', 'longest' nor a stroke's number")
    return int(text) if text.isdecimal() else text


def _rectangle(text: str) -> tuple[int, ...]:
    """U,V,W,H in whole pixels."""
    value = Numbers(4, metavar="U,V,W,H", positive=False).parse(text)
    if not all(x.is_integer() and abs(x) < 2**31 for x in value):
        shown = ",".join(f"{x:g}" for x in value)
        if all(x.is_integer() for x in value):
            raise ValueError(f"'{shown}' holds a number that no image's pixels reach")
        raise ValueError(f"'{shown}' holds a part of a pixel; whole ones are wanted")
    return tuple(map(int, value))


def _margin(text: str) -> str | float:
    """`tre95`, or `p=P` with a probability P above 0 and below 1: the word, or the number."""
    if text == "tre95":
        return text
    try:
        p = parse_decimal(text.removeprefix("p="))
    except ValueError:
        p = 0.0
    if not text.startswith("p=") or not 0 < p < 1:
        raise ValueError(f"{text!r}: allowed are tre95 and p=P with 0 < P < 1")
    return p


def _seconds(text: str) -> float:
    """A length of time, e.g. `90s`, `30min`, `12h` or `2d`, as seconds."""
    match = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)(s|min|h|d)", text)
    if match is None:
        raise ValueError(f"{text!r} is not a time; 90s, 30min, 12h and 2d are")
    return float(match[1]) * SECONDS[match[2]]


SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}


RECTANGLE = Parsed("U,V,W,H", _rectangle)
MARGIN, TIME = Parsed("tre95|p=P", _margin), Parsed("TIME", _seconds)
PLACE = Numbers(2, metavar="U,V", positive=False)
VECTOR = Numbers(3, metavar="X,Y,Z", positive=False)
STIFFNESS = Numbers(1, 3, metavar="N_PER_M[,Y,Z]")
MM_OR_NONE = Numbers(1, metavar="MM|none", word="none")
MILLI = {"callback": lambda ctx, param, value: value and 1e-3 * value}  # given in millimetres
COLOUR = {"default": "red", "metavar": "NAME|#RRGGBB"}


def robot(purpose: str = "") -> Callable[[F], F]:
    """`--robot`: a shipped robot or a file, read by `vfplan.robot.read_robot`; none by default."""
    known = "A shipped robot (franka, fr3), a robot file (schemas/robot-1.1.json), or none."
    return option("--robot", metavar="NAME|FILE", help=f"{purpose} {known}".strip())


ROBOT = robot()
# Where a simulated arm stands, and its tip: `rehearse` and `plan --rehearse`.
BASE = {"type": Numbers(3, 7, metavar="X,Y,Z[,QW,QX,QY,QZ]", positive=False)}
TOOL = {"type": VECTOR, "default": "0,0,0.1"}
# How the curve is read from the image: `extract` and `plan`. Named as in `ExtractSettings`.
CURVE = taking(
    option("--colour", **COLOUR, help="The planning pen's colour."),
    option("--pixel-spacing", "pixel_spacing_mm", type=Numbers(1, 2, metavar="MM[,MM]"),
           callback=lambda c, p, v: v if v is None or len(v) == 2 else v * 2,
           help="Size of a pixel along u (between columns) and v (between rows); wins over the "
           "file's."),
    option("--method", type=click.Choice(["ridge", "skeleton", "mask"]), default="ridge",
           help="Sub-pixel ridge, bare skeleton, or every mask pixel."),
    option("--roi", type=RECTANGLE, help="Look only in this rectangle of pixels."),
    option("--stroke", type=Parsed("all|longest|N", _stroke),
           help="Which of several candidates is the curve."),
    option("--max-gap", "max_gap_px", type=Real(min=0), default=20.0, metavar="PX",
           help="Bridge pen lifts shorter than this."),
    option("--exclude", type=RECTANGLE, multiple=True, callback=lambda c, p, v: v or None,
           help="Do not look in this rectangle of pixels; may be given several times."),
    option("--start", type=PLACE, help="Where on the line the curve begins; gives its direction."),
    option("--end", type=PLACE, help="Where on the line the curve ends."),
    option("--accept-width", is_flag=True, default=None,
           help="Take a run wider than the rest as one pen's, pressed harder."),
    option("--curve", type=FILE, metavar="FILE",
           help="A curve drawn on the image as vectors: Slicer .mrk.json or .fcsv, ImageJ .roi, "
           "CSV u_px,v_px or X,Y, or a DICOM presentation state."),
    option("--curve-origin", type=click.Choice(["centre", "corner"]),
           help="Where on a pixel ImageJ counts from: a line's X,Y from the centre, an area's from "
           "the corner; asked for where the file leaves it open."),
    option("--frame", type=Whole(min=1), metavar="N",
           help="Which frame of a multi-frame DICOM or page of a TIFF."),
    option("--imager-spacing", is_flag=True, default=None,
           help="Accept DICOM's ImagerPixelSpacing, which is not the patient's."),
    option("--max-megapixels", type=Real(0, min_open=True), metavar="N",
           help="Read pictures of up to so many million pixels.  [default: 64]"),
    option("--mask-out", type=PNG, metavar="PNG", help="Write the pen's mask."),
    option("--overlay-out", type=PNG, metavar="PNG",
           help="Write the slice with the curve found on it, or the candidates' numbers."),
)  # fmt: skip

# How a curve becomes a fixture: `register` and `plan`. Named as in `FixtureSettings`.
MAKING = taking(
    option("--model", type=click.Choice(["affine", "similarity", "rigid"]), default="affine",
           help="The transform from image to robot."),
    option("--robust", is_flag=True, help="Find and leave out outlying markers; names them."),
    option("--tolerance", "tolerance_m", type=MM,
           help="How far a surface rendered from points may lie from the drawn one's; spacing, "
           "band and iteration limit follow from it.  [default: 0.01]"),
    option("--density", "density_per_m", type=Number("PTS_PER_MM", 1e3),
           help="Points a millimetre, instead of a tolerance."),
    option("--arcs", type=Numbers(1, metavar="MM|none", word="none"),
           help="The curve is held as lines and arcs this near to it, which rule `exact` renders "
           "as they are; `none`: as points alone.  [default: 0.001, where it can]"),
    option("--stiffness", type=STIFFNESS, default="1000",
           help="K, one for all axes of the robot's base or one each."),
    option("--contact-radius", type=MM, default="5", help="The proxy's radius r_c."),
    option("--point-radius", type=Real(min=0), default=0, metavar="MM", **MILLI,
           help="Radius r_v of each point of the cloud."),
    option("--ignore-axis", type=click.Choice(["normal", "x", "y", "z", "none"]),
           help="The fixture is infinite along it.  [default: normal, the drawn slice's]"),
    option("--seen-from", type=VECTOR,
           help="Direction in the robot's frame from which you look at the slice (0,0,1: from "
           "above); refuses mirrored markers."),
    option("--max-residual", type=MM_OR_NONE,
           help="Gate: write nothing (exit 1) if the markers miss their places by more (rms).  "
           "[default: 1]"),
    option("--max-tre", type=MM_OR_NONE,
           help="Gate: write nothing (exit 1) if the registration error may be larger anywhere on "
           "the curve (95 % bound).  [default: the contact radius]"),
    option("--markers-as-given", is_flag=True,
           help="Take the markers even if they meet no marks drawn on the slice, or if another "
           "order of their labels fits clearly better."),
    option("--common", is_flag=True,
           help="Use the markers that both files have.  [default: both must have the same]"),
    option("--margin", type=MARGIN,
           help="Add a safety margin to the point radius: that bound, or what makes entering less "
           "probable than P by --campaign.  [default: none]"),
    option("--campaign", type=FILE, metavar="DIR",
           help="Folder of `vfplan campaign`, for --margin p=P."),
    option("--find-markers", is_flag=True,
           help="Take the markers' pixels from the crosses or dots drawn near the given ones; says "
           "how far each moved."),
    option("--guide", "guide_m", type=MM,
           help="Keep the tip within a tube of this radius around the curve, instead of forbidding "
           "what lies near it."),
    option("--ends", "guide_ends", type=click.Choice(["stop", "open"]),
           help="What the ends of an open curve that guides do: a cap, or let the tip go free.  "
           "[default: stop]"),
    option("--guide-stroke", type=click.IntRange(0), metavar="N",
           help="Only this stroke guides, the others are forbidden.  [default: all guide]"),
    option("--guide-pull", type=Numbers(1, 2, metavar="N[,MM_PER_S]", positive=False),
           help="Lead the tip along the curve with this force, which has fallen to 0 at this "
           "speed, 20 mm/s unless given.  [default: no pull]"),
    option("--guide-cut-bends", is_flag=True,
           help="Take bends tighter than the tube is wide: the tip may cut them."),
    option("--picture-out", type=PNG, metavar="PNG",
           help="Write the slice with the residuals and the error along the curve."),
)  # fmt: skip


def settings(kind: type, given: dict[str, Any], **more: Any) -> Any:
    """A dataclass of settings from a command's arguments of the same names."""
    names = {field.name for field in fields(kind)}
    return kind(**{n: v for n, v in given.items() if n in names and v is not None} | more)


def fixture_settings(given: dict[str, Any]) -> Any:
    """`vfplan.planning.FixtureSettings` from a command's arguments."""
    from vfplan.planning import FixtureSettings

    if given["tolerance_m"] and given["density_per_m"]:
        raise click.UsageError("--tolerance and --density exclude each other; give one")
    margin = given["margin"]
    if isinstance(margin, float) != (given["campaign"] is not None):
        raise click.UsageError("--margin p=P and --campaign DIR: both or neither")
    if isinstance(margin, float):
        from vfplan.campaign import margin_for

        margin = margin_for(given["campaign"], margin)
    pull = given["guide_pull"] or ()
    gates = {}
    if given["max_residual"] is not None:
        gates["max_residual_m"] = _millimetres_or_none(given["max_residual"])
    if given["max_tre"] is not None:
        gates["max_tre_m"] = _millimetres_or_none(given["max_tre"])
    return settings(
        FixtureSettings, given, margin=margin, points_only=given["arcs"] == (),
        arcs_m=given["arcs"][0] * 1e-3 if given["arcs"] else None,
        guide_pull=(*pull[:1], *(1e-3 * speed for speed in pull[1:])), **gates,
    )  # fmt: skip


def _millimetres_or_none(value: tuple[float, ...]) -> float | None:
    """A gate's length [m]; `None` for the word "none"."""
    return 1e-3 * value[0] if value else None


def hold_campaign(given: dict[str, Any], fixture: Any) -> None:
    """Refuse the margin of a campaign on another plan."""
    if given["campaign"] is not None:
        from vfplan.campaign import require_same_plan

        require_same_plan(given["campaign"], fixture)


def signature(keys_option: str = "--require-signature", required: bool = False) -> Callable[[F], F]:
    """What a bundle's signature must satisfy; `trust` makes it of the command's arguments."""
    return taking(
        option(keys_option, "keys", type=FILE, required=required, metavar="KEYS",
               help="File of trusted public keys (PEM); refuse what none of them signed."),
        option("--case", help="The case token it must be signed for."),
        option("--robot-serial", help="The robot it must be signed for."),
        option("--max-age", type=TIME, help="How long ago it was registered."),
    )  # fmt: skip


def trust(given: dict[str, Any]) -> Any:
    """The `vfplan.bundle.Trust` that the options of `signature` ask for, or `None`."""
    wanted = given["case"], given["robot_serial"], given["max_age"]
    if given["keys"] is not None:
        from vfplan.bundle import Trust, read_keys

        return Trust(read_keys(given["keys"]), *wanted)
    if wanted != (None, None, None):
        raise click.UsageError("--case, --robot-serial and --max-age need --require-signature KEYS")
    return None
