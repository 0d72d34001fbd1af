"""What an option's value may be: types for click that name the value found and what is allowed."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, ClassVar

import click

from vfplan.io.numbers import real

# Existence is checked by the library, which answers 3 (bad input) and not 2 (usage).
FILE = click.Path(path_type=Path)


class Written(click.Path):
    """A file to write: its suffix is the format's, so that no other program is misled.

    Parameters
    ----------
    suffixes
        What is allowed, e.g. ".png"; upper case will do. None: any but "-".
    """

    def __init__(self, *suffixes: str) -> None:
        super().__init__(path_type=Path)
        self.suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The path; a usage error (exit 2) names the suffix found and those allowed."""
        path = Path(str(value))
        if not self.suffixes and str(path) == "-":
            self.fail("'-' is no file name, and stdout takes no file", param, ctx)
        if self.suffixes and not path.name.lower().endswith(self.suffixes):
            found = f"suffix {path.suffix!r}" if path.suffix else "no suffix"
            wanted = " or ".join(self.suffixes)
            self.fail(f"{str(value)!r} has {found}; {wanted} is wanted", param, ctx)
        return path


PNG, GIF, CSV, HDF5 = Written(".png"), Written(".gif"), Written(".csv"), Written(".h5", ".hdf5")


class Numbers(click.ParamType):
    """One number, or several separated by commas, e.g. `0.59` or `0.59,0.61`.

    Parameters
    ----------
    counts
        How many numbers are allowed, e.g. `(1, 2)`.
    metavar
        The name shown in the help.
    positive
        Refuse numbers that are not above zero.
    """

    name = "numbers"

    def __init__(self, *counts: int, metavar: str, positive: bool = True) -> None:
        self.counts = counts
        self.metavar = metavar
        self.positive = positive

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """The name shown in the help."""
        return self.metavar

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Parse; a usage error (exit 2) names the value found and what is allowed."""
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(real(part) for part in str(value).split(","))
        except ValueError as error:
            self.fail(
                f"{value!r} is not a number or a comma-separated list of numbers: {error}",
                param,
                ctx,
            )
        if len(numbers) not in self.counts:
            allowed = " or ".join(map(str, self.counts))
            self.fail(f"{value!r} has {len(numbers)} numbers; {allowed} wanted", param, ctx)
        # Written so that NaN fails too.
        if not all(abs(x) < float("inf") and (x > 0 or not self.positive) for x in numbers):
            wanted = "finite and above 0" if self.positive else "finite"
            self.fail(f"{value!r} holds a number that is not {wanted}", param, ctx)
        return numbers


class OrNone(Numbers):
    """As `Numbers`, or `none`: no numbers."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Parse; a usage error (exit 2) names the value found and what is allowed."""
        return () if value == "none" else super().convert(value, param, ctx)


class Margin(click.ParamType):
    """`tre95`, or `p=P` with a probability P above 0 and below 1: the word, or the number."""

    name = "margin"

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """The name shown in the help."""
        return "tre95|p=P"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str | float:
        """Parse; a usage error (exit 2) names the value found and what is allowed."""
        if value == "tre95" or isinstance(value, float):
            return value
        try:
            p = real(str(value).removeprefix("p="))
        except ValueError:
            p = 0.0
        if not str(value).startswith("p=") or not 0 < p < 1:
            self.fail(f"{value!r}: allowed are tre95 and p=P with 0 < P < 1", param, ctx)
        return p


MARGIN = Margin()


class _Strict(click.ParamType):
    """What Python takes for a number and others do not, 1_000 or nan, is a usage error."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Parse; a usage error (exit 2) names the value found."""
        try:
            if isinstance(value, str):
                real(value)
        except ValueError as error:
            self.fail(str(error), param, ctx)
        return super().convert(value, param, ctx)


class Real(_Strict, click.FloatRange):
    """A decimal number within bounds."""


class Whole(_Strict, click.IntRange):
    """A whole number within bounds."""


class Duration(click.ParamType):
    """A length of time, e.g. `90s`, `30min`, `12h` or `2d`, as seconds."""

    name = "duration"
    UNITS: ClassVar = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """The name shown in the help."""
        return "TIME"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Parse; a usage error (exit 2) names the value found and what is allowed."""
        if isinstance(value, float):
            return value
        match = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)(s|min|h|d)", str(value))
        if match is None:
            self.fail(f"{value!r} is not a time; 90s, 30min, 12h and 2d are", param, ctx)
        return float(match[1]) * self.UNITS[match[2]]
