"""The digest of what a review sheet shows: 64 hexadecimal digits.

It covers every value of the bundle, so the SHA-256 of the slice too, and the findings. It does not
cover when and by which program the bundle was made, nor who answered a finding. So the same plan
has the same digest tomorrow and after its acceptance, and no other plan has it.
"""

from __future__ import annotations

import hashlib
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from vfplan.fixture import Fixture

# What changes although the plan does not.
LEFT_OUT = {"created_utc", "software", "history", "answered_by", "answered_utc", "reviewed"}

# So that no other program's digest of the same values is taken for one of a review.
DOMAIN = "vfplan review sheet 1"


def digest_of(fixture: Fixture, *, slice_shown: bool = True) -> str:
    """The digest of a fixture with its findings.

    Parameters
    ----------
    fixture
        The bundle's content.
    slice_shown
        Whether the sheet shows the slice that the curve was drawn on. A sheet without it has
        another digest: who saw that sheet has not seen the ends of the line.
    """
    seen = hashlib.sha256()
    _add(seen, DOMAIN)
    _add(seen, fixture)
    is_drawn = fixture.provenance.inputs.get("image") is not None
    _add(seen, "slice not shown" if is_drawn and not slice_shown else "all shown")
    return seen.hexdigest()


def _add(seen: Any, value: Any) -> None:
    """Feed a value to the hash, each with its kind and its length, so that no two run together."""
    if is_dataclass(value) and not isinstance(value, type):
        value = {f.name: getattr(value, f.name) for f in fields(value)}
    if isinstance(value, dict):
        kept = {str(k): v for k, v in value.items() if k not in LEFT_OUT and v is not None}
        seen.update(b"{%d" % len(kept))
        for name in sorted(kept):
            _add(seen, name)
            _add(seen, kept[name])
    elif isinstance(value, str):
        text = value.encode()
        seen.update(b"s%d:" % len(text) + text)
    elif isinstance(value, (list, tuple)):
        seen.update(b"[%d" % len(value))
        for item in value:
            _add(seen, item)
    elif isinstance(value, np.ndarray):
        _add(seen, "x".join(map(str, value.shape)))
        _add_array(seen, value)
    else:
        _add_array(seen, np.asarray(value))


def _add_array(seen: Any, array: np.ndarray) -> None:
    """Numbers by their values alone: a 1 read from a file may have another type than it had."""
    if array.dtype.kind not in "biuf":
        raise TypeError(f"no digest is defined for a value of type {array.dtype}")
    seen.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
