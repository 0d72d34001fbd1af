"""A setting is declared once, as a field: its option, its help, its range and its unit follow.

`vfplan.cli.options` makes the option of a field, and reads it from a
file of settings. This module knows neither of them. A bundle records all settings of a class, so
that its plan can be made again, also by a program with other defaults.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import Field, field, fields
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from vfplan.errors import InputError, SettingError

# What a command was given: the name of each option and its value.
Arguments = dict[str, Any]

# Unit that a person types a setting in -> what it is in SI units. Any other unit is SI.
SCALES = {"mm": 1e-3, "1/mm": 1e3}


def setting(default: Any, text: str, **rule: Any) -> Any:
    """A field of a class of settings, with the help of its option.

    Parameters
    ----------
    default
        In SI units. A help text that names the default itself, in brackets, stands for it, so that
        the option is `None` unless it is typed.
    text
        The help of the option.
    rule
        option: how the option is typed, where it is not named like the field without its unit
        form: how its value is typed, as the help shows it, such as "MM" or "U,V"
        unit: the unit of the option and of messages, of a number that the field holds in SI units
        choices: the values that are allowed; `flag` for an option without a value
        least, above: the smallest number, in the unit of the field; `whole` for whole ones alone
        most: the path in a bundle whose largest number is the largest here
        repeatable: whether the option may be given several times
        from_option: makes the field's value of the option's, where they differ
    """
    return field(default=default, metadata={"help": text, **rule})


def option_words(setting: Field) -> list[str]:
    """How the option of a field may be typed, without its dashes."""
    word = re.sub("_(m|mm|px)$", "", setting.name).replace("_", "-")
    return setting.metadata.get("option", word).split()


def argument_of(setting: Field) -> str:
    """The name under which a command gets the option of a field."""
    if "from_option" in setting.metadata:
        return option_words(setting)[0].replace("-", "_")
    return setting.name


def scale_of(setting: Field) -> float:
    """What a number in the unit of a setting is in SI units."""
    return SCALES.get(setting.metadata.get("unit", ""), 1.0)


def chosen_options(kind: type, arguments: Arguments) -> Arguments:
    """The settings of a class among a command's arguments; `None` is an option not typed.

    Those that came from a file are the argument `from_file`, by their names.
    """
    from_file = arguments.get("from_file", {})
    chosen = {}
    for setting in fields(kind):
        value = arguments.get(argument_of(setting))
        if setting.name in from_file:
            chosen[setting.name] = from_file[setting.name]
        elif value is not None:
            convert = setting.metadata.get("from_option", lambda given: given)
            chosen[setting.name] = convert(value)
    return chosen


def settings_from_options(kind: type, arguments: Arguments) -> Any:
    """A dataclass of settings from the arguments of a command."""
    return kind(**chosen_options(kind, arguments))


def is_length(value: Any) -> bool:
    """Whether a value is a finite number above 0."""
    return isinstance(value, (int, float)) and 0 < value < math.inf


def flat(value: Any) -> str | float | int | bool:
    """Lists as text, with commas between numbers and semicolons between lists."""
    if not isinstance(value, (tuple, list)):
        return value
    is_nested = any(isinstance(part, (tuple, list)) for part in value)
    return (";" if is_nested else ",").join(str(flat(part)) for part in value)


def recorded(settings: Any, prefix: str = "") -> dict[str, str | float | int | bool]:
    """All settings of a dataclass as a bundle holds them, with a text that names those unset."""
    values = {prefix + one.name: getattr(settings, one.name) for one in fields(settings)}
    unset = ",".join(name for name, value in values.items() if value is None)
    known = {name: flat(value) for name, value in values.items() if value is not None}
    return known | {f"{type(settings).__name__}.unset": unset}


def recalled(kind: type, values: Arguments, prefix: str = "") -> Any:
    """The settings that `recorded` gave, to the bit; `None` where none of this kind are recorded.

    Raises `InputError` for a setting that is missing or is not what its declaration says.
    """
    if f"{kind.__name__}.unset" not in values:
        return None
    unset = str(values[f"{kind.__name__}.unset"]).split(",")
    types, chosen = get_type_hints(kind), {}
    for setting in fields(kind):
        name = prefix + setting.name
        value = values.get(name, None if name in unset else MISFIT)
        fitting = value_as(types[setting.name], value)
        if fitting is MISFIT or (name in values and name in unset):
            held = "missing" if value is MISFIT else repr(value)
            raise incomplete_recipe(f"{name} is {held}")
        chosen[setting.name] = fitting
    try:
        return kind(**chosen)
    except SettingError as error:
        raise incomplete_recipe(error.message) from None


def incomplete_recipe(what: str) -> InputError:
    """The refusal of a bundle that does not say how it was planned."""
    text = f"The bundle's recipe is incomplete: {what}. Plan anew: vfplan plan IMAGE MARKERS"
    return InputError(text, code="recipe-incomplete")


# What stands for a value that a declaration does not allow.
MISFIT = object()


def value_as(declared: Any, value: Any) -> Any:
    """A recorded value as its declaration has it; `MISFIT` if it is no such value."""
    origin, kinds = get_origin(declared), get_args(declared)
    if origin in (Union, UnionType):
        return next((v for kind in kinds if (v := value_as(kind, value)) is not MISFIT), MISFIT)
    if origin is Literal:
        fits = value in kinds
    elif origin is tuple:
        separator = ";" if get_origin(kinds[0]) is tuple else ","
        parts = str(value).split(separator) if value != "" else ()
        value = tuple(value_as(kinds[0], number_in(part)) for part in parts)
        fits = MISFIT not in value and (kinds[-1] is ... or len(value) == len(kinds))
    else:
        fits = type(value) is declared or (type(value), declared) == (int, float)
    return value if fits else MISFIT


def number_in(text: str) -> Any:
    """The number that a text is; any other text as it is."""
    try:
        return json.loads(text, parse_constant=str)
    except ValueError:
        return text
