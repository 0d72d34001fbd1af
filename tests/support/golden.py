"""The archived bundles of tests/data/bundles, and what an engine makes of each.

    python tests/support/golden.py     writes those of the present version anew

A version that was released is never written anew.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

from vfplan import ProxyEngine
from vfplan.fixture import Fixture

ARCHIVE = Path(__file__).parents[1] / "data" / "bundles"
TICKS = 3000


def path_near(points: np.ndarray) -> np.ndarray:
    """(TICKS, 3) positions of a hand that visits places within 8 mm of the points [m]."""
    draw = np.random.default_rng(7)
    stops = points[draw.integers(0, len(points), 31)] + draw.uniform(-0.008, 0.008, (31, 3))
    part = np.linspace(0.0, 1.0, TICKS // 30, endpoint=False)[:, None]
    return np.vstack([a + part * (b - a) for a, b in pairwise(stops)])


def engine_sums(fixture: Fixture) -> dict[str, str]:
    """Rule -> SHA-256 of the proxies, forces and states along `path_near`, to the bit."""
    region = None if fixture.rendering is None else fixture.region
    if region is None:
        return {}
    rules = ["paper", "robust"]
    if region.pieces is not None or region.mesh is not None:
        rules.append("exact")
    sums = {}
    for rule in rules:
        engine = ProxyEngine.of(region, rule)
        path = path_near(region.points)
        engine.reset(path[0])
        trace = engine.run(path)
        digest = hashlib.sha256()
        for values in (trace.proxy, trace.force, trace.state):
            digest.update(np.ascontiguousarray(values).tobytes())
        sums[rule] = digest.hexdigest()
    return sums


# Name in the archive -> the made-up fixture that it holds.
MADE = {
    "minimal": "minimal", "everything": "whole", "mesh": "sheet", "pixels": "pixels",
    "patient": "patient", "guided": "guided", "pieces": "drawn", "findings": "doubtful",
    "reviewed": "reviewed",
}  # fmt: skip


def write_archive() -> None:
    """The bundles of the present version, the signed one, and what `info` says of each."""
    import bundles

    import vfplan
    from vfplan.bundle.content import VERSION
    from vfplan.bundle.seal import keygen, sign
    from vfplan.bundle.validation import describe
    from vfplan.io.files import to_json_types

    for name, make in MADE.items():
        path = ARCHIVE / f"{VERSION}-{name}.h5"
        vfplan.write_fixture(getattr(bundles, make)(), path, overwrite=True)
    with tempfile.TemporaryDirectory() as folder:
        key = Path(folder) / "key"
        public, _ = keygen(key)
        approval = {"case": "case 17", "robot_serial": "R-0042", "despite_findings": True}
        approval["registered_utc"] = "2026-01-02T03:00:00Z"
        whole, signed = (ARCHIVE / f"{VERSION}-{name}.h5" for name in ("everything", "signed"))
        sign(whole, signed, key, **approval, overwrite=True)
        (ARCHIVE / "signed.pub").write_bytes(public.read_bytes())
    for path in ARCHIVE.glob(f"{VERSION}-*.h5"):
        text = json.dumps(to_json_types(describe(path)), indent=1)
        path.with_suffix(".json").write_text(text + "\n")


if __name__ == "__main__":
    write_archive()
