"""Numbers of a report as text, each with the unit that a person reads it in."""

from __future__ import annotations


def millimetres(metres: float | None, decimals: int = 3) -> str:
    """A length [m] in millimetres, e.g. "0.248 mm"; "unknown" for `None`."""
    return _scaled(metres, 1e3, decimals, "mm")


def micrometres(metres: float | None, decimals: int = 2) -> str:
    """A length [m] in micrometres, e.g. "1.25 µm"; "unknown" for `None`."""
    return _scaled(metres, 1e6, decimals, "µm")


def millijoules(joules: float | None) -> str:
    """An energy [J] in millijoules, e.g. "2.4431 mJ"; "unknown" for `None`."""
    return _scaled(joules, 1e3, 4, "mJ")


def milliseconds(seconds: float | None) -> str:
    """A time [s] in milliseconds, e.g. "12.5 ms"; "unknown" for `None`."""
    return _scaled(seconds, 1e3, 1, "ms")


def count(number: int, noun: str) -> str:
    """A number of things, e.g. "1 point" or "3 points"."""
    return f"1 {noun}" if number == 1 else f"{number} {noun}s"


def _scaled(value: float | None, factor: float, decimals: int, unit: str) -> str:
    return "unknown" if value is None else f"{value * factor:z.{decimals}f} {unit}"
