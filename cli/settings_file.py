"""`--settings FILE.json`: options from a file, for whoever repeats a plan.

The file is one JSON object. Its names are the fields of `ExtractSettings` and `FixtureSettings`,
and its values are in their units: metres, N/m, pixels. An option that is typed wins over the file.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource
from vfplan.cli.values import Number, Numbers, Written

from vfplan.errors import InputError, SettingError
from vfplan.io.files import read_whole

MOST_BYTES = 1 << 20
OF_THE_CALL = ("as_json", "quiet", "verbose", "overwrite", "settings_file")
"""Options that say how a command is called, and nothing of what it makes."""


def _arcs(metres: float | None) -> tuple[float, ...] | None:
    """As `--arcs` is parsed: millimetres."""
    if metres is None:
        return None
    return (1e3 * metres,)


def _no_arcs(points_only: bool) -> tuple[float, ...] | None:
    return () if points_only else None


def _pull(values: tuple[float, ...]) -> tuple[float, ...]:
    """As `--guide-pull` is parsed: N and mm/s."""
    return (*values[:1], *(1e3 * speed for speed in values[1:]))


def _gate(metres: float | str | None) -> tuple[float, ...] | None:
    """As `--max-residual` and `--max-tre` are parsed: millimetres, () for none, None: not given."""
    if metres is None:
        return ()
    if isinstance(metres, str):  # "contact radius", which is the option's default
        return None
    return (1e3 * metres,)


# A field whose option is parsed to another name or unit -> the option's, and how it gets there.
OTHERWISE: Mapping[str, tuple[str, Callable[[Any], Any]]] = {
    "arcs_m": ("arcs", _arcs),
    "points_only": ("arcs", _no_arcs),
    "guide_pull": ("guide_pull", _pull),
    "max_residual_m": ("max_residual", _gate),
    "max_tre_m": ("max_tre", _gate),
}


def with_settings_of(path: Path | None, given: dict[str, Any]) -> dict[str, Any]:
    """A command's arguments, with those of the file in place of what was not typed.

    Raises
    ------
    InputError
        No such file, or no JSON object.
    SettingError
        A name that the command has no option for, or a value that it does not take.
    """
    if path is None:
        return given
    context = click.get_current_context()
    params = {
        param.name: param
        for param in context.command.params
        if isinstance(param, click.Option)
        and not isinstance(param.type, Written)
        and param.name not in OF_THE_CALL
    }
    result = dict(given)
    for field, raw in _read(path).items():
        name, convert = OTHERWISE.get(field, (field, None))
        if name not in params:
            allowed = ", ".join(sorted(params))
            raise SettingError(
                f"has a setting {field!r}, which {context.info_name} has not; it has {allowed}",
                where=str(path),
                code="unknown-setting",
            )
        if convert is not None:
            value = convert(_as_tuple(raw))
        else:
            value = _value(params[name], raw, str(path))
        if context.get_parameter_source(name) is not ParameterSource.COMMANDLINE:
            result[name] = value
    return result


def _read(path: Path) -> dict[str, Any]:
    data = read_whole(path, MOST_BYTES)
    try:
        settings = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON: {error}", where=str(path), code="not-json") from None
    if not isinstance(settings, dict):
        raise InputError("is no JSON object of settings", where=str(path), code="not-json")
    return settings


def _value(param: click.Option, raw: Any, where: str) -> Any:
    """A JSON value as the option's own parser would have left it, but in the field's unit."""
    value = _as_tuple(raw)
    if isinstance(param.type, click.Choice) and value not in (None, *param.type.choices):
        raise SettingError(
            f"{param.name} {value!r}; allowed are {', '.join(param.type.choices)}",
            where=where,
            code="unknown-choice",
        )
    is_list = isinstance(param.type, Numbers) and not isinstance(param.type, Number)
    if is_list and isinstance(value, (int, float)) and not isinstance(value, bool):
        return (value,)
    return value


def _as_tuple(raw: Any) -> Any:
    if isinstance(raw, list):
        return tuple(_as_tuple(part) for part in raw)
    return raw
