"""How a number is read from text, wherever text from outside holds one, and written as JSON."""

from __future__ import annotations

import math
import re
from typing import Any

# Digits, a point, an exponent: not the 1_000, 0x10, 1d3, nan or digits of other scripts that one
# reader or another takes.
_REAL = re.compile(r"[ \t]*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)[ \t]*")


# More no program writes: bytes of a line, numbers in one, bytes of a file of text.
MOST_LINE, MOST_COLUMNS, MOST_TEXT = 1 << 16, 1000, 1 << 28


def require_short(data: bytes) -> None:
    """Raise `ValueError` for text that is long, or has a long line: tables take times its size."""
    if len(data) > MOST_TEXT:
        raise ValueError(f"{len(data)} bytes of text; at most {MOST_TEXT} are read")
    at = 0
    while len(data) - at > MOST_LINE:  # from each stretch of that length to its last line's end
        end = data.rfind(b"\n", at, at + MOST_LINE)
        if end < 0:
            raise ValueError(f"the line at byte {at} is longer than {MOST_LINE} bytes")
        at = end + 1


def real(text: str) -> float:
    """A decimal number, blanks around it allowed; raises `ValueError` for anything else.

    What is beyond the largest float64, 1.8e308, is no number either.
    """
    match = _REAL.fullmatch(text)
    if match is None:
        raise ValueError(f"{text[:40]!r} is no number" if text.strip() else "a number is missing")
    value = float(match[1])
    if math.isinf(value):
        raise ValueError(f"{text[:40]!r} is larger than a float64 holds, 1.8e308")
    return value


def jsonable(value: Any) -> Any:
    """The value as JSON holds it: arrays as nested lists, NaN and infinities as `null`."""
    if isinstance(value, dict):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [jsonable(v) for v in value]
    if hasattr(value, "tolist"):  # NumPy arrays and scalars, without importing NumPy here
        return jsonable(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
