"""`--settings FILE.json`: options from a file, for whoever repeats a plan.

The file is one JSON object. Its names are the fields of `ExtractSettings` and `FixtureSettings`,
and its values are in their units: metres, N/m, pixels. An option that is typed wins over the file.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource
from vfplan.cli.options import Number, Numbers, OutputFile, Parsed

from vfplan.errors import InputError, SettingError
from vfplan.io.files import MAX_SETTINGS_BYTES, naming_place, parse_decimal, read_whole
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.settings import argument_of

# Options that say how a command is called, and nothing of its result.
OPTIONS_OF_THE_CALL = ("as_json", "quiet", "verbose", "overwrite", "settings_file")


# Fields whose option has another name or unit: the option's name, and the way to its value.
CONVERTED_FIELDS = {
    setting.name: (argument_of(setting), setting.metadata["to_option"])
    for kind in (ExtractSettings, FixtureSettings)
    for setting in fields(kind)
    if "to_option" in setting.metadata
}


def merge_settings_file(path: Path | None, arguments: dict[str, Any]) -> dict[str, Any]:
    """The arguments of a command, with those of the file in place of the options not typed.

    Raises
    ------
    InputError
        No such file, or no JSON object.
    SettingError
        A name that the command has no option for, or a value that it does not take.
    """
    if path is None:
        return arguments
    context = click.get_current_context()
    params = {
        param.name: param
        for param in context.command.params
        if isinstance(param, click.Option)
        and not isinstance(param.type, OutputFile)
        and param.name not in OPTIONS_OF_THE_CALL
    }
    where = str(path)

    # The file holds one JSON object.
    data = read_whole(path, MAX_SETTINGS_BYTES)
    try:
        with naming_place(where):
            settings = json.loads(
                data, parse_constant=refuse_constant, parse_int=parse_whole,
                parse_float=parse_decimal, object_pairs_hook=dict_of_pairs,
            )  # fmt: skip
    except (ValueError, RecursionError) as error:
        message = f"is not JSON: {error}. Write one object of settings"
        raise InputError(message, where=where, code="not-json") from None
    if not isinstance(settings, dict):
        message = "is no JSON object. Write one object of settings"
        raise InputError(message, where=where, code="not-json")

    # Each of its settings takes the place of an option that was not typed.
    merged = dict(arguments)
    for field, raw in settings.items():
        name, convert = CONVERTED_FIELDS.get(field, (field, None))
        if name not in params:
            raise SettingError(
                f"has a setting {field!r}, which {context.info_name} does not have. Choose "
                f"among {', '.join(sorted(params))}",
                where=where, code="unknown-setting",
            )  # fmt: skip
        kind, value = params[name].type, _lists_to_tuples(raw)
        if convert is not None:
            try:
                value = convert(value)
            except TypeError:
                message = f"{field} {raw!r} is no such setting. See its form in docs/cli.md"
                raise SettingError(message, where=where, code="setting-of-another-form") from None
        elif isinstance(kind, click.Choice) and value is not None and value not in kind.choices:
            message = f"{field} is {value!r}. Choose one of {', '.join(kind.choices)}"
            raise SettingError(message, where=where, code="unknown-choice")
        elif not fits_option(params[name], value):
            message = f"{field} is {raw!r}. Give a value as docs/cli.md has it for this option"
            raise SettingError(message, where=where, code="setting-of-another-form")
        elif isinstance(kind, Numbers) and not isinstance(kind, Number) and is_number(value):
            value = (value,)
        if context.get_parameter_source(name) is not ParameterSource.COMMANDLINE:
            merged[name] = value
            context.set_parameter_source(name, ParameterSource.DEFAULT_MAP)
    return merged


def refuse_constant(name: str) -> float:
    """Refuse NaN and Infinity, which Python's reader of JSON would let pass."""
    raise ValueError(f"{name} is no number of JSON")


def parse_whole(text: str) -> int:
    """A whole number of JSON; raises `ValueError` for one that is larger than a float64 holds."""
    parse_decimal(text)
    return int(text)


def dict_of_pairs(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of JSON; raises `InputError` where a name stands twice: which one counts?"""
    settings = dict(pairs)
    if len(settings) < len(pairs):
        (name, count), *_ = Counter(name for name, _ in pairs).most_common(1)
        message = f"{name!r} stands there {count} times. Leave one"
        raise InputError(message, code="setting-twice", numbers={"count": count})
    return settings


def fits_option(param: click.Option, value: Any) -> bool:
    """Whether a value of a settings file has the form of an option's value: `None` always has."""
    kind = param.type
    if value is None:
        return True
    if param.is_flag:
        return isinstance(value, bool)
    if isinstance(kind, Numbers) or param.multiple:
        return all_numbers(value)
    if isinstance(kind, (click.FloatRange, click.IntRange)):
        return is_number(value)
    return isinstance(value, str) or (isinstance(kind, Parsed) and all_numbers(value))


def is_number(value: Any) -> bool:
    """Whether a value is a number."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def all_numbers(value: Any) -> bool:
    """Whether a value is a number, or a list of numbers or of such lists."""
    return all(map(all_numbers, value)) if isinstance(value, tuple) else is_number(value)


def _lists_to_tuples(raw: Any) -> Any:
    """JSON's lists as tuples, which the settings hold."""
    return tuple(map(_lists_to_tuples, raw)) if isinstance(raw, list) else raw
