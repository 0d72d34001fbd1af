"""Values as JSON holds them."""

from __future__ import annotations

import math
from typing import Any


def to_json_types(value: Any) -> Any:
    """The value in JSON's types: arrays as nested lists, NaN and infinities as `null`."""
    if isinstance(value, dict):
        return {str(k): to_json_types(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json_types(v) for v in value]
    if hasattr(value, "tolist"):  # NumPy arrays and scalars, without importing NumPy here.
        return to_json_types(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
