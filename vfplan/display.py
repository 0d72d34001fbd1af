"""Numbers as a person reads them: three digits, with the unit that suits their size.

Numbers of a report as text, each with the unit that a person reads it in.
"""

from __future__ import annotations

import math
import re
import shlex
import unicodedata
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

# What a command or a part of it found, by name, as `--json` prints it.
Report = dict[str, Any]

# Takes the number of steps just done.
Advance = Callable[[int], None]

# Shows how far a long work is: given its name and its number of steps, a `with` block that yields
# what is called as they are done.
Progress = Callable[[str, int], AbstractContextManager[Advance]]

# Things of one kind that a text or a report lists one by one; of more, their number.
MAX_LISTED = 20

# Numbers on a picture of a slice. More would cover it.
MAX_NUMBERED = 12

# Number of points of a cloud or of a path that a picture draws. More look the same.
MAX_DRAWN = 4000

# Millimetres in a metre.
MM = 1e3

_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def length(metres: float) -> str:
    """A length [m] as "4.02 µm"; within a nanometre of 0 it is rounding, and only the side is said.

    A negative length is a penetration where a clearance is meant, so its sign is never lost.
    """
    if 0 < metres < 1e-9:
        return "< 1 nm"
    return "> -1 nm" if -1e-9 < metres < 0 else _in_units(metres, "m")


def duration(seconds: float) -> str:
    """A time [s] as "0.71 s" or "16 µs"."""
    return _in_units(seconds, "s")


def nice_length(longest: float) -> float:
    """1, 2 or 5 times a power of ten, at most `longest`: the length of a scale bar."""
    power = 10.0 ** math.floor(math.log10(longest))
    return max(factor * power for factor in (1, 2, 5) if factor == 1 or factor * power <= longest)


def three_digits(value: float) -> str:
    """A number with three digits that count, never with an exponent: "0.0125", "12.5", "1250"."""
    if value == 0 or not math.isfinite(value):
        return f"{value:zg}"
    decimals = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{decimals}f}"


def resolved(value: float, digits: int = 6) -> str:
    """A number of a report in its SI unit, as finely as a quantity is known: to 1e-9, e.g. 1 nm."""
    return f"{round(value, 9):z.{digits}g}"


def _in_units(value: float, unit: str) -> str:
    factor, prefix = next((p for p in _PREFIXES if abs(value) >= p[0]), _PREFIXES[-1])
    return f"{three_digits(value / factor)} {prefix}{unit}"


def millimetres(metres: float | None, decimals: int = 3) -> str:
    """A length [m] in millimetres, e.g. "0.248 mm"; "unknown" for `None`."""
    return _scaled(metres, 1e3, decimals, "mm")


def micrometres(metres: float | None, decimals: int = 2) -> str:
    """A length [m] in micrometres, e.g. "1.25 µm"; "unknown" for `None`."""
    return _scaled(metres, 1e6, decimals, "µm")


def command_of(*words: str | Path | None) -> str:
    """A `vfplan` command, to be pasted; a file whose name begins like an option gets its folder.

    A word that is `None` is left out.
    """
    parts = [f"./{word}" if str(word).startswith("-") and isinstance(word, Path) else str(word)
             for word in words if word is not None]  # fmt: skip
    return shlex.join(["vfplan", *parts])


def coordinates(values: Iterable[float], decimals: int = 0, separator: str = ", ") -> str:
    """Numbers such as coordinates, e.g. "12.5, -4.0, 0.0"; none that rounds to 0 has a sign.

    Of two whole numbers that are as close it is the larger one, as on the page.
    """
    rounded = values if decimals else (math.floor(value + 0.5) for value in values)
    return separator.join(f"{value:z.{decimals}f}" for value in rounded)


def isolated(name: str) -> str:
    """A name between the marks that keep its letters from turning the numbers beside it."""
    is_turned = any(unicodedata.bidirectional(letter) in ("R", "AL") for letter in name)
    return f"\u2068{name}\u2069" if is_turned else name


def finding_name(number: int) -> str:
    """What a finding is called on sheet, page and pictures: markers are often named F1, F2."""
    return f"#{number}"


def quoted(path: str | Path) -> str:
    """A file's name as the shell takes it, for a line that a person copies from."""
    return shlex.quote(str(path))


def wrote(*paths: str | Path | None) -> str:
    """The line that names the files which a command wrote."""
    return "wrote " + ", ".join(quoted(path) for path in paths if path is not None)


def count(number: int, noun: str) -> str:
    """A number of things, e.g. "1 point" or "3 points"."""
    return f"1 {noun}" if number == 1 else f"{number} {noun}s"


def in_singular(text: str) -> str:
    """A text with "1 tick" where a number before "ticks" made it "1 ticks"; also of other nouns."""
    return re.sub(r"(?<![\d.,])1 (tick|episode|limit|time)s\b", r"1 \1", text)


def or_not(is_so: bool, word: str) -> str:
    """A word or its opposite, e.g. "signed" or "not signed"."""
    return word if is_so else f"not {word}"


def _scaled(value: float | None, factor: float, decimals: int, unit: str) -> str:
    return "unknown" if value is None else f"{value * factor:z.{decimals}f} {unit}"
