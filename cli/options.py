"""Options that several commands share, and what the values of options may be.

The error of a value that may not be names it, and says what to type.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import click
from click.core import ParameterSource

from vfplan.display import Report, count
from vfplan.errors import InputError, SettingError
from vfplan.io.files import (
    MAX_SETTINGS_BYTES,
    naming_place,
    parse_decimal,
    parse_seconds,
    read_whole,
)
from vfplan.planning.settings import ExtractSettings, FixtureSettings, margin_length
from vfplan.settings import (
    MISFIT,
    Arguments,
    argument_of,
    chosen_options,
    flat,
    option_words,
    scale_of,
    value_as,
)

# An input. The library checks that it exists, and answers with exit code 3 instead of 2.
FILE = click.Path(path_type=Path, readable=False)


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


def numbers_of(
    *counts: int, metavar: str, positive: bool = True, word: str | None = None
) -> Parsed:
    """Several numbers separated by commas, e.g. `0.59,0.61`.

    counts: how many are allowed
    positive: whether each must be above 0
    word: a word that may stand for none of them
    """

    def parse(text: str) -> tuple[float, ...]:
        if text == word:
            return ()
        numbers = tuple(map(parse_decimal, text.split(",")))
        if len(numbers) not in counts:
            allowed = " or ".join(map(str, counts))
            raise ValueError(f"{text!r} has {count(len(numbers), 'number')}. Type {allowed}")
        if positive and not min(numbers) > 0:
            raise ValueError(
                f"{text!r} holds a number that is not above 0. The comma separates two numbers: "
                "type 0.5 for a half"
            )
        return numbers

    return Parsed(metavar, parse)


VECTOR = numbers_of(3, metavar="X,Y,Z", positive=False)
RECTANGLE = numbers_of(4, metavar="U,V,W,H", positive=False)


def number_of(metavar: str, scale: float = 1.0, least: float | None = None) -> Parsed:
    """One number, in another unit: times `scale`; above 0, or `least` or above."""

    def parse(text: str) -> float:
        value = parse_decimal(text)
        if least is None and value <= 0:
            raise ValueError(f"{text!r} is not above 0. Type a larger number")
        if least is not None and value < least:
            raise ValueError(f"{text!r} is below {least:g}. Type that or a number above")
        return float(value * scale)

    return Parsed(metavar, parse)


# A length above 0: typed in millimetres, handed on in metres.
MM = number_of("MM", 1e-3)

# A length of 0 or above: typed in millimetres, handed on in metres.
MM_OR_ZERO = number_of("MM", 1e-3, least=0)


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


def refuse_unused(when: str, *names: str) -> None:
    """Refuse options that were typed and change nothing: they would be taken for some that do.

    when: says when they change nothing, such as "without --window"
    names: as the command's function has them
    """
    context = click.get_current_context()
    for param in context.command.params:
        source = context.get_parameter_source(param.name)
        is_typed = source is ParameterSource.COMMANDLINE and context.params[param.name] != ()
        if param.name in names and is_typed:
            what = param.opts[0] if isinstance(param, click.Option) else "a file"
            raise click.UsageError(f"{what} has no effect {when}. Leave it out")


F = TypeVar("F", bound=Callable[..., Any])
Decorator = Callable[[F], F]

# What a signature may be for, and the option that demands it.
SIGNED_FOR = {"case": "--case CASE", "robot_serial": "--robot-serial SERIAL"}


def option(*names: str, **attributes: Any) -> Decorator:
    """`click.option`, whose help shows the default where there is one."""
    if "show_default" not in attributes:
        attributes["show_default"] = attributes.get("default") not in (None, "")
    return click.option(*names, **attributes)


def options_in_order(*decorators: Decorator) -> Decorator:
    """These options, which the help lists in this order."""

    def wrap(function: F) -> F:
        for decorator in reversed(decorators):
            function = decorator(function)
        return function

    return wrap


def output_option(text: str, required: bool = True, kind: click.ParamType = HDF5) -> Decorator:
    """`-o/--output FILE`, which the command gets as `output`, and `--overwrite`."""
    return options_in_order(
        option("-o", "--output", type=kind, required=required, help=text), OVERWRITE
    )


def robot_option(purpose: str) -> Decorator:
    """`--robot`: a shipped robot or a file, read by `vfplan.robot.read_robot`; none by default."""
    names = "NAME is franka, fr3 or none; FILE is a robot file (schemas/robot-1.1.json)."
    return option("--robot", metavar="NAME|FILE", help=f"{purpose} {names}")


def signature_options(
    keys_option: str = "--require-signature", required: bool = False
) -> Decorator:
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
    if text not in ("all", "longest") and not text.isdecimal():
        raise ValueError(f"{text!r} is no stroke. Type all, longest or a number")
    return int(text) if text.isdecimal() else text


def parse_rectangle(text: str) -> tuple[int, ...]:
    """U,V,W,H in whole pixels."""
    values = RECTANGLE.parse(text)
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
        return VECTOR.parse(text)
    except ValueError:
        raise ValueError(
            f"{text!r} is no side. Type above, below, or X,Y,Z such as 0,0,1"
        ) from None


def parse_margin(text: str) -> str | float:
    """`tre95`, `tre95+MM`, or the probability P of `p=P`, which is above 0 and below 1."""
    if isinstance(margin_length(text, 0.0), float):
        return text
    with suppress(ValueError):
        probability = parse_decimal(text.removeprefix("p="))
        if text.startswith("p=") and 0 < probability < 1:
            return probability
    raise ValueError(f"{text!r} is no margin. Type tre95, tre95+MM, or p=P with P between 0 and 1")


OVERWRITE = option("--overwrite", is_flag=True, help="Replace output files that exist.")
FIXTURE = click.argument("fixture", type=FILE, metavar="FIXTURE.h5")
SESSION = click.argument("session", type=FILE, metavar="SESSION")
MARKERS = options_in_order(
    click.argument("markers", type=FILE), click.argument("markers2", type=FILE, required=False)
)
# As `vfplan.io.files.METRES`.
UNIT = click.Choice(["m", "cm", "mm", "um", "in"])
UNITS = option("--units", type=UNIT, default="m", help="Unit of the session's positions.")
ROBOT = robot_option("Write nothing if the stiffness is not stable with this robot.")

# A page in the browser: `review` and `ar`.
BROWSER = options_in_order(
    option("--no-browser", is_flag=True, help="Print the address, and open no browser."),
    option("--port", type=WholeNumber(0, 65535), default=0, metavar="N",
           help="Port of the page on 127.0.0.1; 0 takes any free one."),
)  # fmt: skip

# The page of what is printed.
PAPER = option("--paper", type=click.Choice(["a4", "letter"]), default="a4",
               help="The printer's paper.")  # fmt: skip

# Form of a setting -> what reads it.
FORMS = {
    kind.metavar: kind
    for kind in (
        numbers_of(2, metavar="U,V", positive=False), Parsed("U,V,W,H", parse_rectangle),
        numbers_of(1, 2, metavar="MM[,MM]"), numbers_of(1, metavar="MM|none", word="none"),
        numbers_of(1, 3, metavar="N_PER_M[,Y,Z]"),
        numbers_of(1, 2, metavar="N[,MM_PER_S]", positive=False),
        Parsed("all|longest|N", parse_stroke), Parsed("above|below|X,Y,Z", parse_side),
        Parsed("tre95[+MM]|p=P", parse_margin),
    )
}  # fmt: skip

# Where a simulated arm stands: `rehearse` and `plan --rehearse`.
ARM_BASE = {"type": numbers_of(3, 7, metavar="X,Y,Z[,QW,QX,QY,QZ]", positive=False)}

# The tip of a simulated arm in the frame of its flange: `rehearse` and `plan --rehearse`.
ARM_TOOL = {"type": VECTOR, "default": "0,0,0.1"}


# Of the commands that register.
TIP = option("--tip", type=FILE, metavar="TIP.json",
             help="Record the tool that touched the markers, from `vfplan tip -o`.")  # fmt: skip


def setting_option(kind: type, name: str) -> Decorator:
    """The option of a field of a class of settings, as `vfplan.settings` declares it."""
    setting = next(setting for setting in fields(kind) if setting.name == name)
    rule, form = setting.metadata, setting.metadata.get("form")
    default = setting.default if "[default:" not in rule["help"] else None
    attributes = {"help": rule["help"], "multiple": "repeatable" in rule}
    if "flag" in rule or isinstance(default, bool):
        attributes |= {"is_flag": True, "show_default": False}
    elif "choices" in rule:
        attributes["type"] = click.Choice(rule["choices"])
    elif form in ("MM", "PTS_PER_MM"):
        attributes["type"] = number_of(
            form, scale_of(setting), 0 if rule.get("least") == 0 else None
        )
        if default is not None:
            default = f"{default / scale_of(setting):g}"
    elif form in FORMS:
        attributes["type"] = FORMS[form]
        if default:
            default = ",".join(f"{number:g}" for number in default)
    else:
        attributes["metavar"] = form
        if "whole" in rule:
            attributes["type"] = WholeNumber(rule["least"])
        elif "least" in rule or "above" in rule:
            least = rule.get("least", rule.get("above"))
            attributes["type"] = DecimalNumber(least, min_open="above" in rule)
    if not attributes["multiple"]:
        attributes["default"] = default
    return option(*map("--{}".format, option_words(setting)), argument_of(setting), **attributes)


def setting_options(kind: type, names: str) -> Decorator:
    """The options of some fields of a class of settings."""
    return options_in_order(*(setting_option(kind, name) for name in names.split()))


# How the curve is read from the image: `extract`, `plan` and `review`.
EXTRACT_OPTIONS = options_in_order(
    setting_options(
        ExtractSettings,
        "colour pixel_spacing_mm method roi stroke max_gap_px exclude start end accept_width",
    ),
    option("--curve", type=FILE, metavar="FILE",
           help="Take the curve from this vector file (Slicer, ImageJ, CSV or DICOM)."),
    setting_options(
        ExtractSettings, "curve_origin curve_type frame pixels imager_spacing max_megapixels"
    ),
    option("--mask-out", type=PNG, metavar="PNG", help="Write a picture of the pen's mask."),
    option("--overlay-out", type=PNG, metavar="PNG",
           help="Write a picture of the slice with the curve, or with the numbered candidates."),
)  # fmt: skip

# How a curve becomes a fixture: `register`, `plan` and `review`.
FIXTURE_OPTIONS = options_in_order(
    setting_options(
        FixtureSettings,
        "model robust tolerance_m density_per_m arcs_m stiffness contact_radius point_radius "
        "ignore_axis seen_from max_residual_m max_tre_m markers_as_given common margin",
    ),
    option("--campaign", type=FILE, metavar="DIR",
           help="Folder of `vfplan campaign`, for --margin p=P."),
    setting_options(
        FixtureSettings,
        "find_markers guide_m guide_ends guide_stroke guide_pull guide_cut_bends",
    ),
    option("--picture-out", type=PNG, metavar="PNG",
           help="Write a picture of the slice with the residuals and the error along the curve."),
)  # fmt: skip


def given_settings(kind: type, arguments: Arguments) -> Arguments:
    """The settings of a class that were typed or stand in a file of settings, by name."""
    source_of = click.get_current_context().get_parameter_source
    given = {n: v for n, v in arguments.items() if source_of(n) is not ParameterSource.DEFAULT}
    return chosen_options(kind, given)


def given_of_plan(arguments: Arguments) -> Arguments:
    """The same of a fixture, with the margin of a campaign in place of its probability."""
    margin = arguments["margin"]
    if isinstance(margin, float) != (arguments["campaign"] is not None):
        raise click.UsageError("--margin p=P and --campaign DIR belong together. Give both")
    if isinstance(margin, float):
        from vfplan.campaign.store import margin_for

        arguments = arguments | {"margin": margin_for(arguments["campaign"], margin)}
    given = given_settings(FixtureSettings, arguments)
    if given.get("tolerance_m") and given.get("density_per_m"):
        raise click.UsageError("--tolerance and --density exclude each other. Give one")
    return given


def check_campaign_matches(arguments: Arguments, fixture: Any) -> None:
    """Refuse the margin of a campaign on another plan."""
    if arguments["campaign"] is not None:
        from vfplan.campaign.store import require_same_plan

        require_same_plan(arguments["campaign"], fixture)


# The settings that a file may hold.
SETTINGS = (*fields(ExtractSettings), *fields(FixtureSettings))


def settings_of_file(path: Path) -> Arguments:
    """The settings in a file, of those whose options the running command has and nobody typed.

    The file is one JSON object, which may also stand in place of the file's name. Its names are the
    fields of `ExtractSettings` and `FixtureSettings`, and its values are in their units: metres,
    N/m, pixels.

    Raises
    ------
    InputError
        No such file, or no JSON object.
    SettingError
        A name that the command has no option for, or a value that it does not take.
    """
    where = data = str(path)
    if not data.startswith("{"):
        data = read_whole(path, MAX_SETTINGS_BYTES)
    try:
        with naming_place(where):
            # Python's reader of JSON would let NaN and Infinity pass.
            settings = json.loads(
                data, parse_constant=parse_decimal, parse_int=parse_whole,
                parse_float=parse_decimal, object_pairs_hook=dict_of_pairs,
            )  # fmt: skip
        if not isinstance(settings, dict):
            raise ValueError("it is no object")
    except (ValueError, RecursionError) as error:
        message = f"is not JSON: {error}. Write one object of settings"
        raise InputError(message, where=where, code="not-json") from None

    context = click.get_current_context()
    known = {one.name: one for one in SETTINGS if argument_of(one) in context.params}
    types = get_type_hints(ExtractSettings) | get_type_hints(FixtureSettings)
    chosen = {}
    for name, raw in settings.items():
        if name not in known:
            raise SettingError(
                f"has a setting {name!r}, which {context.info_name} does not have. Choose among "
                f"{', '.join(sorted(known))}",
                where=where, code="unknown-setting",
            )  # fmt: skip
        setting = known[name]
        if name == "pixel_spacing_mm" and isinstance(raw, int | float):
            raw = [raw, raw]
        try:
            value = value_as(types[name], flat(raw))
        except RecursionError:
            value = MISFIT
        if value is MISFIT and "choices" in setting.metadata:
            message = f"{name} is {raw!r}. Choose one of {', '.join(setting.metadata['choices'])}"
            raise SettingError(message, where=where, code="unknown-choice")
        if value is MISFIT:
            message = f"{name} is {raw!r}. Give a value as docs/cli.md has it for this option"
            raise SettingError(message, where=where, code="setting-of-another-form")
        if context.get_parameter_source(argument_of(setting)) is not ParameterSource.COMMANDLINE:
            chosen[name] = value
    return chosen


def parse_whole(text: str) -> int:
    """A whole number of JSON; raises `ValueError` for one that is larger than a float64 holds."""
    parse_decimal(text)
    return int(text)


def dict_of_pairs(pairs: list[tuple[str, Any]]) -> Arguments:
    """An object of JSON; raises `InputError` where a name stands twice: which one counts?"""
    settings = dict(pairs)
    if len(settings) < len(pairs):
        (name, count), *_ = Counter(name for name, _ in pairs).most_common(1)
        message = f"{name!r} stands there {count} times. Leave one"
        raise InputError(message, code="setting-twice", numbers={"count": count})
    return settings


def trust(arguments: Arguments) -> Any:
    """The `vfplan.Trust` that `signature_options` ask for, or `None`."""
    if arguments["keys"] is None:
        refuse_unused("without --require-signature KEYS", *SIGNED_FOR, "max_age")
        return None
    from vfplan.bundle.seal import Trust, read_keys

    demands = (arguments[name] for name in (*SIGNED_FOR, "max_age"))
    return Trust(read_keys(arguments["keys"]), *demands)


def not_compared(seal: Report, arguments: Arguments) -> dict[str, str]:
    """What a trusted signature is for and the command did not demand, with a warning for each.

    seal: as `read_sealed` gives it
    """
    if arguments["keys"] is None:
        return {}
    return {
        name: f"The bundle is signed for {name.replace('_', ' ')} {seal[name]!r}, which was "
        f"compared with nothing. Give {demand} as it must be."
        for name, demand in SIGNED_FOR.items()
        if name in seal and arguments[name] is None
    }
