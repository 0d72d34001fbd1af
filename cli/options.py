"""Options that several commands share, each defined once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])

# Existence is checked by the library, which answers 3 (bad input) and not 2 (usage).
FILE = click.Path(path_type=Path)


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
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a number or a comma-separated list of numbers", param, ctx)
        if len(numbers) not in self.counts:
            allowed = " or ".join(map(str, self.counts))
            self.fail(f"{value!r} has {len(numbers)} numbers; {allowed} wanted", param, ctx)
        # Written so that NaN fails too.
        if not all(abs(x) < float("inf") and (x > 0 or not self.positive) for x in numbers):
            self.fail(f"{value!r} holds a number that is not finite and positive", param, ctx)
        return numbers


def output(text: str, required: bool = True) -> Callable[[F], F]:
    """`-o/--output FILE` and `--overwrite`, given to the command as `output` and `overwrite`."""

    def wrap(function: F) -> F:
        function = click.option(
            "--overwrite", is_flag=True, help="Replace output files that exist."
        )(function)
        return click.option("-o", "--output", type=FILE, required=required, help=text)(function)

    return wrap
