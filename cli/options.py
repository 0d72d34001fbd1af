"""Options that several commands share, each defined once.

What the value of an option may be; the error of any other names the value and what to type.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

import click

from vfplan.display import count
from vfplan.io.files import parse_decimal, parse_seconds

FILE = click.Path(path_type=Path)
"""An input. The library checks that it exists, and answers with exit code 3 instead of 2."""


class OutputFile(click.Path):
    """A file to write, with the suffix of its format, so that no other program is misled.

    Parameters
    ----------
    suffixes
        Those allowed, in upper case too. Without any, every name is but "-".
    """

    def __init__(self, *suffixes: str) -> None:
        super().__init__(path_type=Path)
        self.suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The path; a usage error (exit 2) names its suffix and those allowed."""
        path = Path(str(value))
        if not self.suffixes and str(path) == "-":
            self.fail("'-' is no file name. Name a file", param, ctx)
        if self.suffixes and not path.name.lower().endswith(self.suffixes):
            suffix = f"suffix {path.suffix!r}" if path.suffix else "no suffix"
            allowed = " or ".join(self.suffixes)
            self.fail(f"{str(value)!r} has {suffix}. End the name in {allowed}", param, ctx)
        return path


PNG = OutputFile(".png")
CSV = OutputFile(".csv")
HDF5 = OutputFile(".h5", ".hdf5")


class Parsed(click.ParamType):
    """A value written as text.

    Parameters
    ----------
    metavar
        Its name in the help.
    parse
        Makes the value of the text. Its `ValueError` is a usage error (exit 2).
    """

    name = "value"

    def __init__(self, metavar: str, parse: Callable[[str], Any]) -> None:
        self.metavar = metavar
        self.parse = parse

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """The name in the help."""
        return self.metavar

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The value; one that is no text any more stays as it is."""
        if not isinstance(value, str):
            return value
        try:
            return self.parse(value)
        except ValueError as error:
            self.fail(str(error), param, ctx)


class Numbers(Parsed):
    """Several numbers separated by commas, e.g. `0.59,0.61`.

    Parameters
    ----------
    counts
        How many are allowed.
    positive
        Whether each must be above 0.
    word
        A word that may stand for none of them.
    """

    def __init__(
        self, *counts: int, metavar: str, positive: bool = True, word: str | None = None
    ) -> None:
        super().__init__(metavar, self.numbers)
        self.counts = counts
        self.positive = positive
        self.word = word

    def numbers(self, text: str) -> Any:
        """The numbers of a text, as a tuple."""
        if text == self.word:
            return ()
        try:
            numbers = tuple(map(parse_decimal, text.split(",")))
        except ValueError as error:
            raise ValueError(
                f"{text!r} cannot be read: {error}. Type numbers with commas between them"
            ) from None
        if len(numbers) not in self.counts:
            allowed = " or ".join(map(str, self.counts))
            raise ValueError(f"{text!r} has {count(len(numbers), 'number')}. Type {allowed}")
        if self.positive and not min(numbers) > 0:
            if len(numbers) > 1:
                raise ValueError(
                    f"{text!r} holds a number that is not above 0. The comma separates two "
                    "numbers: type 0.5 for a half"
                )
            raise ValueError(f"{text!r} is not above 0. Type a larger number")
        return numbers


class Number(Numbers):
    """One number, in another unit: times `scale`.

    Parameters
    ----------
    positive
        Whether it must be above 0.
    zero_allowed
        Whether it must be 0 or above.
    """

    def __init__(
        self,
        metavar: str,
        scale: float = 1.0,
        positive: bool = True,
        zero_allowed: bool = False,
    ) -> None:
        super().__init__(1, metavar=metavar, positive=positive and not zero_allowed)
        self.zero_allowed = zero_allowed
        self.scale = scale
        self.parse = self.number

    def number(self, text: str) -> float:
        """The number of a text, scaled."""
        value = self.numbers(text)[0]
        if self.zero_allowed and value < 0:
            raise ValueError(f"{text!r} is below 0. Type 0 or a number above")
        return float(value * self.scale)


MM = Number("MM", 1e-3)
"""A length above 0: typed in millimetres, handed on in metres."""

MM_OR_ZERO = Number("MM", 1e-3, zero_allowed=True)
"""A length of 0 or above: typed in millimetres, handed on in metres."""


class _StrictNumber(click.ParamType):
    """Refuses texts that Python takes for numbers and other programs do not, as 1_000 or nan."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number; a usage error (exit 2) names the value and what is allowed."""
        if isinstance(value, str):
            try:
                parse_decimal(value)
            except ValueError as error:
                self.fail(str(error), param, ctx)
        return super().convert(value, param, ctx)


class DecimalNumber(_StrictNumber, click.FloatRange):
    """A decimal number within bounds."""


class WholeNumber(_StrictNumber, click.IntRange):
    """A whole number within bounds."""


F = TypeVar("F", bound=Callable[..., Any])

SIGNED_FOR = {"case": "--case CASE", "robot_serial": "--robot-serial SERIAL"}
"""What a signature may be for, and the option that demands it."""


def option(*names: str, **attributes: Any) -> Callable[[F], F]:
    """`click.option`, whose help shows the default where there is one."""
    if "show_default" not in attributes:
        attributes["show_default"] = attributes.get("default") not in (None, "")
    return click.option(*names, **attributes)


def options_in_order(*decorators: Callable[[F], F]) -> Callable[[F], F]:
    """These options, which the help lists in this order."""

    def wrap(function: F) -> F:
        for decorator in reversed(decorators):
            function = decorator(function)
        return function

    return wrap


def output_option(
    text: str, required: bool = True, kind: click.ParamType = HDF5
) -> Callable[[F], F]:
    """`-o/--output FILE`, which the command gets as `output`, and `--overwrite`."""
    return options_in_order(
        option("-o", "--output", type=kind, required=required, help=text), OVERWRITE
    )


def robot_option(purpose: str = "") -> Callable[[F], F]:
    """`--robot`: a shipped robot or a file, read by `vfplan.robot.read_robot`; none by default."""
    names = "NAME is franka, fr3 or none; FILE is a robot file (schemas/robot-1.1.json)."
    return option("--robot", metavar="NAME|FILE", help=f"{purpose} {names}".strip())


def signature_options(
    keys_option: str = "--require-signature", required: bool = False
) -> Callable[[F], F]:
    """What the signature of a bundle must satisfy; `trust` makes it of the command's arguments."""
    return options_in_order(
        option(keys_option, "keys", type=FILE, required=required, metavar="KEYS",
               help="Refuse a bundle that none of the public keys (PEM) in this file signed."),
        option("--case", metavar="CASE",
               help="Refuse a bundle that is signed for another case."),
        option("--robot-serial", metavar="SERIAL",
               help="Refuse a bundle that is signed for another robot."),
        option("--max-age", type=Parsed("TIME", parse_seconds),
               help="Refuse a bundle that is older than this, such as 90s, 30min, 12h or 2d."),
    )  # fmt: skip


def parse_stroke(text: str) -> str | int:
    """`all`, `longest` or the number of a stroke."""
    if text in ("all", "longest"):
        return text
    if not text.isdecimal():
        raise ValueError(f"{text!r} is no stroke. Type all, longest or a number")
    return int(text)


def parse_rectangle(text: str) -> tuple[int, ...]:
    """U,V,W,H in whole pixels."""
    values = Numbers(4, metavar="U,V,W,H", positive=False).numbers(text)
    for value in values:
        if not value.is_integer():
            raise ValueError(f"{text!r} holds a part of a pixel. Type whole numbers")
        # As in every image format, 32 bits hold a pixel's number and its sign.
        if abs(value) >= 2**31:
            raise ValueError(
                f"{text!r} holds a number that no image's pixels reach. Type smaller ones"
            )
    return tuple(map(int, values))


def parse_side(text: str) -> str | tuple[float, ...]:
    """`above`, `below`, or the direction X,Y,Z."""
    if text in ("above", "below"):
        return text
    try:
        return VECTOR.numbers(text)
    except ValueError:
        raise ValueError(
            f"{text!r} is no side. Type above, below, or X,Y,Z such as 0,0,1"
        ) from None


def parse_margin(text: str) -> str | float:
    """`tre95`, or the probability P of `p=P`, which is above 0 and below 1."""
    if text == "tre95":
        return text
    probability = 0.0
    if text.startswith("p="):
        try:
            probability = parse_decimal(text.removeprefix("p="))
        except ValueError:
            probability = 0.0
    if not 0 < probability < 1:
        raise ValueError(f"{text!r} is no margin. Type tre95, or p=P with P between 0 and 1")
    return probability


def both_spacings(
    ctx: click.Context, param: click.Parameter, value: tuple[float, ...] | None
) -> tuple[float, ...] | None:
    """One pixel spacing counts along u and v."""
    return value if value is None or len(value) == 2 else value * 2


def none_if_empty(ctx: click.Context, param: click.Parameter, value: Any) -> Any:
    """An option that was not given is `None`, as the settings want it."""
    return value or None


OVERWRITE = option("--overwrite", is_flag=True, help="Replace output files that exist.")
FIXTURE = click.argument("fixture", type=FILE, metavar="FIXTURE.h5")
SESSION = click.argument("session", type=FILE, metavar="SESSION")
UNITS = option("--units", type=click.Choice(["m", "mm"]), default="m",
               help="Unit of the session's positions.")  # fmt: skip
ROBOT = robot_option("Write nothing if the stiffness is not stable with this robot.")

RECTANGLE = Parsed("U,V,W,H", parse_rectangle)
PLACE = Numbers(2, metavar="U,V", positive=False)
VECTOR = Numbers(3, metavar="X,Y,Z", positive=False)
STIFFNESS = Numbers(1, 3, metavar="N_PER_M[,Y,Z]")
MM_OR_NONE = Numbers(1, metavar="MM|none", word="none")
COLOUR = {"default": "red", "metavar": "NAME|#RRGGBB"}

ARM_BASE = {"type": Numbers(3, 7, metavar="X,Y,Z[,QW,QX,QY,QZ]", positive=False)}
"""Where a simulated arm stands: `rehearse` and `plan --rehearse`."""

ARM_TOOL = {"type": VECTOR, "default": "0,0,0.1"}
"""The tip of a simulated arm in the frame of its flange: `rehearse` and `plan --rehearse`."""

EXTRACT_OPTIONS = options_in_order(
    option("--colour", **COLOUR, help="Colour of the planning pen."),
    option("--pixel-spacing", "pixel_spacing_mm", type=Numbers(1, 2, metavar="MM[,MM]"),
           callback=both_spacings,
           help="Size of a pixel along u and v [mm], in place of the size in the file."),
    option("--method", type=click.Choice(["ridge", "skeleton", "mask"]), default="ridge",
           help="Measure the middle of the line (ridge), thin it (skeleton), or take every "
           "pixel of the pen (mask)."),
    option("--roi", type=RECTANGLE, help="Look for the line in this rectangle only [px]."),
    option("--stroke", type=Parsed("all|longest|N", parse_stroke),
           help="Take this candidate if there are several."),
    option("--max-gap", "max_gap_px", type=DecimalNumber(min=0), default=20.0, metavar="PX",
           help="Bridge gaps in the pen's line up to this length [px]."),
    option("--exclude", type=RECTANGLE, multiple=True, callback=none_if_empty,
           help="Ignore the ink in this rectangle [px]; repeatable."),
    option("--start", type=PLACE, help="Begin the curve at this place on the line [px]."),
    option("--end", type=PLACE, help="End the curve at this place on the line [px]."),
    option("--accept-width", is_flag=True, default=None,
           help="Take a wider stretch as the same pen, pressed harder."),
    option("--curve", type=FILE, metavar="FILE",
           help="Take the curve from this vector file (Slicer, ImageJ, CSV or DICOM)."),
    option("--curve-origin", type=click.Choice(["centre", "corner"]),
           help="Count ImageJ's X,Y from the centre or from the corner of a pixel. Needed if "
           "the file does not say it."),
    option("--page", "--frame", "frame", type=WholeNumber(min=1), metavar="N",
           help="Read this frame of a multi-frame DICOM, or this page of a TIFF."),
    option("--imager-spacing", is_flag=True, default=None,
           help="Take the pixel spacing from DICOM's ImagerPixelSpacing, which is that of the "
           "detector and not of the patient."),
    option("--max-megapixels", type=DecimalNumber(0, min_open=True), metavar="N",
           help="Read pictures of up to this many million pixels.  [default: 64]"),
    option("--mask-out", type=PNG, metavar="PNG", help="Write a picture of the pen's mask."),
    option("--overlay-out", type=PNG, metavar="PNG",
           help="Write a picture of the slice with the curve, or with the numbered candidates."),
)  # fmt: skip
"""How the curve is read from the image: `extract`, `plan` and `review`; fields of
`ExtractSettings`."""

FIXTURE_OPTIONS = options_in_order(
    option("--model", type=click.Choice(["affine", "similarity", "rigid"]), default="affine",
           help="Kind of transform from image to robot."),
    option("--robust", is_flag=True, help="Leave out markers that do not fit, and name them."),
    option("--tolerance", "tolerance_m", type=MM,
           help="Allow a surface that is rendered from points to lie this far from the drawn one "
           "[mm].  [default: 0.01]"),
    option("--density", "density_per_m", type=Number("PTS_PER_MM", 1e3),
           help="Put this many points on a millimetre, in place of --tolerance."),
    option("--arcs", type=Numbers(1, metavar="MM|none", word="none"),
           help="Fit lines and arcs to the curve within this distance [mm]; none makes points "
           "only.  [default: 0.001, if it can be reached]"),
    option("--stiffness", type=STIFFNESS, default="1000",
           help="Stiffness K [N/m]: one number, or one for each axis."),
    option("--contact-radius", type=MM, default="5",
           help="Distance that the tool keeps from the curve [mm]."),
    option("--point-radius", type=MM_OR_ZERO, default="0",
           help="Radius of each point, added to the contact radius [mm]."),
    option("--ignore-axis", type=click.Choice(["normal", "x", "y", "z", "none"]),
           help="Extend the fixture without end along this axis.  [default: normal, of the "
           "drawn slice]"),
    option("--seen-from", type=Parsed("above|below|X,Y,Z", parse_side),
           help="Say from which side you look at the slice: above (robot +z), below, or a "
           "direction in the robot's frame. Refuse markers that say otherwise."),
    option("--max-residual", type=MM_OR_NONE,
           help="Refuse markers whose residual (rms) is larger [mm].  [default: 1]"),
    option("--max-tre", type=MM_OR_NONE,
           help="Refuse a plan whose 95 % bound of the error is larger [mm].  [default: the "
           "contact radius]"),
    option("--markers-as-given", is_flag=True,
           help="Skip the checks of the labels and of the marks on the slice."),
    option("--common", is_flag=True,
           help="Use the markers that both files have, and drop the others."),
    option("--margin", type=Parsed("tre95|p=P", parse_margin),
           help="Add the 95 % bound (tre95), or the margin that --campaign gives for P, to the "
           "point radius.  [default: none]"),
    option("--campaign", type=FILE, metavar="DIR",
           help="Folder of `vfplan campaign`, for --margin p=P."),
    option("--find-markers", is_flag=True,
           help="Move each marker to the centre of the cross or dot that is drawn near it."),
    option("--guide", "guide_m", type=MM,
           help="Make a guide: keep the tip in a tube of this radius around the curve [mm]."),
    option("--ends", "guide_ends", type=click.Choice(["stop", "open"]),
           help="Close the ends of a guide's tube, or let the tip leave there.  [default: stop]"),
    option("--guide-stroke", type=click.IntRange(0), metavar="N",
           help="Guide along this stroke only; the others are a forbidden region.  [default: all "
           "strokes guide]"),
    option("--guide-pull", type=Numbers(1, 2, metavar="N[,MM_PER_S]", positive=False),
           help="Pull the tip along the curve with this force [N], which falls to 0 at this speed "
           "[mm/s].  [default: no pull; 20 mm/s]"),
    option("--guide-cut-bends", is_flag=True,
           help="Accept a bend that is tighter than the tube. The tip may cut it."),
    option("--picture-out", type=PNG, metavar="PNG",
           help="Write a picture of the slice with the residuals and the error along the curve."),
)  # fmt: skip
"""How a curve becomes a fixture: `register`, `plan` and `review`; fields of `FixtureSettings`."""


def settings_from_options(kind: type, arguments: dict[str, Any]) -> Any:
    """A dataclass of settings from the arguments of a command that have its fields' names."""
    chosen = {}
    for setting in fields(kind):
        if arguments.get(setting.name) is not None:
            chosen[setting.name] = arguments[setting.name]
    return kind(**chosen)


def fixture_settings(arguments: dict[str, Any]) -> Any:
    """`vfplan.planning.FixtureSettings` from the arguments of a command."""
    from vfplan.planning.settings import FixtureSettings

    # Combinations of options that would leave one of them without effect.
    margin = arguments["margin"]
    is_probability = isinstance(margin, float)
    if arguments["tolerance_m"] and arguments["density_per_m"]:
        raise click.UsageError("--tolerance and --density exclude each other. Give one")
    if is_probability != (arguments["campaign"] is not None):
        raise click.UsageError("--margin p=P and --campaign DIR belong together. Give both")

    # Options that are written in another unit than the field, or in another form.
    chosen = dict(arguments)
    if is_probability:
        from vfplan.campaign.statistics import margin_for

        chosen["margin"] = margin_for(arguments["campaign"], margin)
    if arguments["arcs"] == ():
        chosen["points_only"] = True
    elif arguments["arcs"] is not None:
        chosen["arcs_m"] = 1e-3 * arguments["arcs"][0]
    if arguments["guide_pull"]:
        force, *speeds = arguments["guide_pull"]
        chosen["guide_pull"] = (force, *(1e-3 * speed for speed in speeds))
    settings = settings_from_options(FixtureSettings, chosen)

    # A gate that is typed is a length, or none.
    for name, setting in (("max_residual", "max_residual_m"), ("max_tre", "max_tre_m")):
        if arguments[name] == ():
            settings = replace(settings, **{setting: None})
        elif arguments[name] is not None:
            settings = replace(settings, **{setting: 1e-3 * arguments[name][0]})
    return settings


def check_campaign_matches(arguments: dict[str, Any], fixture: Any) -> None:
    """Refuse the margin of a campaign on another plan."""
    if arguments["campaign"] is not None:
        from vfplan.campaign.statistics import require_same_plan

        require_same_plan(arguments["campaign"], fixture)


def trust(arguments: dict[str, Any]) -> Any:
    """The `vfplan.Trust` that `signature_options` ask for, or `None`."""
    demands = (arguments["case"], arguments["robot_serial"], arguments["max_age"])
    if arguments["keys"] is not None:
        from vfplan.bundle.seal import Trust, read_keys

        return Trust(read_keys(arguments["keys"]), *demands)
    if demands != (None, None, None):
        raise click.UsageError(
            "--case, --robot-serial and --max-age read a signature. Give --require-signature KEYS"
        )
    return None


def not_compared(seal: dict[str, Any], arguments: dict[str, Any]) -> list[str]:
    """What a trusted signature is for and the command did not demand: names of `SIGNED_FOR`.

    seal: as `Seal.describe` gives it
    """
    if arguments["keys"] is None:
        return []
    return [name for name in SIGNED_FOR if name in seal and arguments[name] is None]


def not_compared_warnings(seal: dict[str, Any], arguments: dict[str, Any]) -> list[str]:
    """A warning for each name that `not_compared` gives."""
    warnings = []
    for name in not_compared(seal, arguments):
        words = name.replace("_", " ")
        warnings.append(
            f"The bundle is signed for {words} {seal[name]!r}, which was compared with nothing. "
            f"Give {SIGNED_FOR[name]} as it must be."
        )
    return warnings
