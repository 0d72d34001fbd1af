"""What an option's value may be, and the value found named where it may not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from vfplan.io.files import parse_decimal

# Existence is checked by the library, which answers 3 (bad input) and not 2 (usage).
FILE = click.Path(path_type=Path)


class Written(click.Path):
    """A file to write: its suffix is the format's, so that no other program is misled.

    `suffixes` are allowed, in upper case too; without any, every name but "-".
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


PNG = Written(".png")
CSV = Written(".csv")
HDF5 = Written(".h5", ".hdf5")


class Parsed(click.ParamType):
    """A value written as text: `parse` makes it, and its `ValueError` is a usage error (exit 2).

    The error names the value found and what is allowed.
    """

    name = "value"

    def __init__(self, metavar: str, parse: Callable[[str], Any]) -> None:
        self.metavar, self.parse = metavar, parse

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """The name shown in the help."""
        return self.metavar

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The value; what is parsed already stays as it is."""
        try:
            return self.parse(value) if isinstance(value, str) else value
        except ValueError as error:
            self.fail(str(error), param, ctx)


class Numbers(Parsed):
    """Several numbers separated by commas, e.g. `0.59,0.61`; `counts` says how many are allowed.

    They are above zero if `positive`; `word` may stand for none of them.
    """

    def __init__(
        self, *counts: int, metavar: str, positive: bool = True, word: str | None = None
    ) -> None:
        super().__init__(metavar, self.numbers)
        self.counts, self.positive, self.word = counts, positive, word

    def numbers(self, text: str) -> Any:
        """As `parse` of `Parsed`."""
        if text == self.word:
            return ()
        try:
            numbers = tuple(parse_decimal(part) for part in text.split(","))
        except ValueError as error:
            what = f"{text!r} is not a number or a comma-separated list of numbers: {error}"
            raise ValueError(what) from None
        if len(numbers) not in self.counts:
            allowed = " or ".join(map(str, self.counts))
            raise ValueError(f"{text!r} has {len(numbers)} numbers; {allowed} wanted")
        if self.positive and not min(numbers) > 0:
            raise ValueError(f"{text!r} holds a number that is not finite and above 0")
        return numbers


class Number(Numbers):
    """One number, in another unit: times `scale`."""

    def __init__(self, metavar: str, scale: float = 1.0, positive: bool = True) -> None:
        super().__init__(1, metavar=metavar, positive=positive)
        self.parse = lambda text: float(self.numbers(text)[0] * scale)


MM = Number("MM", 1e-3)  # given in millimetres, passed on in metres


class _Strict(click.ParamType):
    """What Python takes for a number and others do not, 1_000 or nan, is a usage error."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Parse; a usage error (exit 2) names the value found."""
        try:
            if isinstance(value, str):
                parse_decimal(value)
        except ValueError as error:
            self.fail(str(error), param, ctx)
        return super().convert(value, param, ctx)


class Real(_Strict, click.FloatRange):
    """A decimal number within bounds."""


class Whole(_Strict, click.IntRange):
    """A whole number within bounds."""
