"""Where a plan came from: hashes, settings, version and time; no names, no paths."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from pathlib import Path
from typing import Any

from vfplan.fixture import Provenance
from vfplan.io.clock import now_utc


def make_provenance(inputs: dict[str, str], settings: Any) -> Provenance:
    """Provenance now, or at the time that SOURCE_DATE_EPOCH says (reproducible-builds.org).

    Raises `InputError` where SOURCE_DATE_EPOCH is no time.
    """
    from vfplan import __version__

    flat = {k: _plain(v) for k, v in asdict(settings).items() if v is not None}
    return Provenance(now_utc(), f"vfplan {__version__}", inputs, flat)


def _plain(value: Any) -> str | float | int | bool:
    if not isinstance(value, (tuple, list)):
        return value
    nested = any(isinstance(v, (tuple, list)) for v in value)
    return (";" if nested else ",").join(str(_plain(v)) for v in value)


def file_sha256(path: str | Path) -> str:
    """SHA-256 of a file's bytes, lower-case hex."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
