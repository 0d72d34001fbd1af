"""Reports as text: parts with the names of numbers, of which those are told that are there."""

from __future__ import annotations

from contextlib import suppress
from string import Formatter
from typing import Any

# unit -> the factor from the SI unit that a report holds, decimals, and how it is written
UNITS = {
    "mm": (1e3, "3", " mm"),
    "um": (1e6, "2", " µm"),
    "mJ": (1e3, "4", " mJ"),
    "ms": (1e3, "1", " ms"),
}


class _Filling(Formatter):
    def format_field(self, value: Any, spec: str) -> str:
        if value is None:
            return "unknown"
        unit, _, digits = spec.partition(".")
        if unit not in UNITS:
            return format(value, spec)
        scale, usual, shown = UNITS[unit]
        kind = "" if digits.endswith("g") else "f"
        return format(scale * value, f"z.{digits or usual}{kind}") + shown


def told(found: dict[str, Any], *parts: str) -> str:
    """The parts, one after the other, each filled from a report as `str.format` does.

    A part is left out of which the report does not hold every name (a misspelt one too: what a
    part prints needs a test); a number that is None is "unknown". Lengths, energies and times take
    a unit for their format, with its usual decimals or others: `{force_step_max_n:.3f}`,
    `{fre_rms_m:mm}`, `{scene[band_m]:um.1}`, `{radius_m:mm.6g}`.
    """
    text = ""
    for part in parts:
        with suppress(KeyError):
            text += _Filling().vformat(part, (), found)
    return text
