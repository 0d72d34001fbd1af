"""Where a plan came from: hashes, settings, version and time; no names, no paths."""

from __future__ import annotations

import datetime
import hashlib
import os
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from vfplan.fixture import Provenance


def make_provenance(inputs: dict[str, str], settings: Any) -> Provenance:
    """Provenance now; SOURCE_DATE_EPOCH, when set, is the time (reproducible-builds.org)."""
    from vfplan import __version__

    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    now = int(epoch) if epoch else int(time.time())
    stamp = datetime.datetime.fromtimestamp(now, datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    flat = {k: _plain(v) for k, v in asdict(settings).items() if v is not None}
    return Provenance(stamp, f"vfplan {__version__}", inputs, flat)


def _plain(value: Any) -> str | float | int | bool:
    return ",".join(map(str, value)) if isinstance(value, (tuple, list)) else value


def file_sha256(path: str | Path) -> str:
    """SHA-256 of a file's bytes, lower-case hex."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
