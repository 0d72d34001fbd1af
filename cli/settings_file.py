"""`--settings FILE.json`: options from a file, for whoever repeats a plan.

The file is one JSON object. Its names are the fields of `ExtractSettings` and `FixtureSettings`,
and its values are in their units: metres, N/m, pixels. An option that is typed wins over the file.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

import click
from click.core import ParameterSource

from vfplan.errors import InputError, SettingError
from vfplan.io.files import MAX_SETTINGS_BYTES, naming_place, parse_decimal, read_whole
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.settings import MISFIT, argument_of, flat, value_as


def settings_of_file(path: Path) -> dict[str, Any]:
    """The settings in a file, of those whose options the running command has and nobody typed.

    Raises
    ------
    InputError
        No such file, or no JSON object.
    SettingError
        A name that the command has no option for, or a value that it does not take.
    """
    where = str(path)
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

    context = click.get_current_context()
    known = {}
    for kind in (ExtractSettings, FixtureSettings):
        types = get_type_hints(kind)
        for setting in fields(kind):
            if argument_of(setting) in context.params:
                known[setting.name] = setting, types[setting.name]
    chosen = {}
    for name, raw in settings.items():
        if name not in known:
            raise SettingError(
                f"has a setting {name!r}, which {context.info_name} does not have. Choose among "
                f"{', '.join(sorted(known))}",
                where=where, code="unknown-setting",
            )  # fmt: skip
        setting, declared = known[name]
        if name == "pixel_spacing_mm" and isinstance(raw, int | float):
            raw = [raw, raw]
        try:
            value = value_as(declared, flat(raw))
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
