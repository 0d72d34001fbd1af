"""What the value of an option may be; the error of any other names the value and what to type."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from vfplan.cli.units import count

from vfplan.io.files import parse_decimal

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
