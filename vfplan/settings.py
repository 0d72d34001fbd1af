"""A setting is declared once, as a field: its option, its help, its range and its unit follow.

`vfplan.cli.options` makes the option of a field, and `vfplan.cli.settings_file` reads it from a
file of settings. This module knows neither of them.
"""

from __future__ import annotations

import math
import re
from dataclasses import Field, field, fields
from typing import Any

from vfplan.errors import SettingError

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
        least, above, most: the range, in the unit of the field; `whole` for whole numbers alone
        repeatable: whether the option may be given several times
        to_option, from_option: the way between the values of field and option, where they differ
    """
    return field(default=default, metadata={"help": text, **rule})


def option_words(setting: Field) -> list[str]:
    """How the option of a field may be typed, without its dashes."""
    word = re.sub("_(m|mm|px)$", "", setting.name).replace("_", "-")
    return setting.metadata.get("option", word).split()


def argument_of(setting: Field) -> str:
    """The name under which a command gets the option of a field."""
    if "to_option" in setting.metadata:
        return option_words(setting)[0].replace("-", "_")
    return setting.name


def scale_of(setting: Field) -> float:
    """What a number in the unit of a setting is in SI units."""
    return SCALES.get(setting.metadata.get("unit", ""), 1.0)


def settings_from_options(kind: type, arguments: dict[str, Any]) -> Any:
    """A dataclass of settings from the arguments of a command; `None` is an option not typed."""
    chosen = {}
    for setting in fields(kind):
        value = arguments.get(argument_of(setting))
        if value is not None:
            convert = setting.metadata.get("from_option")
            chosen[setting.name] = value if convert is None else convert(value)
    return kind(**chosen)


def check_ranges(settings: Any) -> None:
    """Refuse a number out of the range of its field; raises `SettingError`."""
    for setting in fields(settings):
        rule = setting.metadata
        value = getattr(settings, setting.name)
        if value is None or "most" not in rule:
            continue
        unit, scale = rule["unit"], 1 / scale_of(setting)
        smallest, largest = rule["least"] * scale, rule["most"] * scale
        for number in value if isinstance(value, tuple) else (value,):
            number = number * scale
            if not smallest <= number <= largest:
                name = setting.name.removesuffix("_m").replace("_", " ")
                raise SettingError(
                    f"{name} is {number:g} {unit}. Give {smallest:g} to {largest:g} {unit}",
                    code="setting-range",
                    numbers={"value": number, "smallest": smallest, "largest": largest},
                )


def is_length(value: Any) -> bool:
    """Whether a value is a finite number above 0."""
    return isinstance(value, (int, float)) and 0 < value < math.inf
