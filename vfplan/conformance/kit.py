"""Write the conformance kit: sound files with their values, broken files, and rendered paths."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from vfplan.bundle import seal
from vfplan.bundle.read import read_bundle, read_fixture
from vfplan.bundle.write import to_payload
from vfplan.conformance import vectors
from vfplan.engine.guide import Guide
from vfplan.engine.proxy import ProxyEngine
from vfplan.io.files import to_json_types

FIXTURES = (
    "minimal",
    "cloud",
    "curve",
    "registered",
    "navigated",
    "pixels",
    "patient",
    "mesh",
    "drawn_mesh",
    "pieces",
    "mirrored_pieces",
    "guided",
    "findings",
    "reviewed",
)
RENDERED = {
    "cloud": ("paper", "robust"),
    "curve": ("paper", "robust"),
    "pieces": ("paper", "robust", "exact"),
    "mesh": ("paper", "robust", "exact"),
    "drawn_mesh": ("paper", "robust", "exact"),
}
"""Fixture -> rules by which a path is rendered."""
TICKS = 60


def write_kit(folder: Path) -> int:
    """Write the kit into a folder; returns the number of files."""
    count = 0
    for kind in ("valid", "invalid", "signed", "render"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    for name, data in valid_files():
        path = folder / "valid" / f"{name}.h5"
        path.write_bytes(data)
        write_json(path.with_suffix(".json"), {"values": to_json_types(read_bundle(path)[0])})
        count += 2
    for vector in vectors.VECTORS:
        path = folder / "invalid" / f"{vector.name}.h5"
        path.write_bytes(vector.make())
        write_json(path.with_suffix(".json"), {"rule": vector.rule, "why": vector.why})
        count += 2
    for vector in vectors.UNTRUSTED:
        path = folder / "signed" / f"{vector.name}.h5"
        path.write_bytes(vector.make())
        write_json(path.with_suffix(".json"), {"rule": vector.rule, "why": vector.why})
        count += 2
    trusted = folder / "signed" / "trusted.h5"
    trusted.write_bytes(vectors.signed("reviewed", despite_findings=False))
    values = to_json_types(read_bundle(trusted)[0])
    write_json(trusted.with_suffix(".json"), {"rule": "S7", "values": values})
    (folder / "signed" / "keys.pub").write_bytes(trusted_key())
    count += 3
    for name, rules in RENDERED.items():
        for rule in rules:
            rendered = render(folder / "valid" / f"{name}.h5", rule)
            write_json(folder / "render" / f"{name}-{rule}.json", rendered)
            count += 1
    guided = render_guide(folder / "valid" / "guided.h5")
    write_json(folder / "render" / "guided-guide.json", guided)
    return count + 1


def valid_files() -> Iterator[tuple[str, bytes]]:
    """(name, bytes) of the sound files: each fixture as libhdf5 and as plain bytes lay it out."""
    for name in FIXTURES:
        content = vectors.content_of(name)
        yield name, b"".join(seal.unsigned(to_payload(content)))
        yield f"{name}_plain", vectors.of_content(content)
    yield "newer_minor", vectors.newer_minor()
    yield "quoted_setting", vectors.quoted_setting()
    yield "signed", vectors.signed("reviewed", despite_findings=False)
    yield "signed_despite_findings", vectors.signed("findings")


def trusted_key() -> bytes:
    """The public key of the kit, as PEM."""
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

    public = vectors.key_of(vectors.KIT_SEED).public_key()
    return public.public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)


def render(bundle: Path, rule: str) -> dict[str, object]:
    """What an engine must make of a path: proxy [m], force on the hand [N] and state by tick."""
    fixture = read_fixture(bundle)
    if fixture.sample_radius is None:
        hip = path_through(fixture.points)
    else:
        hip = path_between(fixture.points)
    engine = ProxyEngine.of(fixture, rule)
    engine.reset(hip[0])
    trace = engine.run(hip)
    return {
        "bundle": f"valid/{bundle.name}",
        "rule": rule,
        "tolerance": 1e-12,
        "hip": hip.tolist(),
        "proxy": trace.proxy.tolist(),
        "force": trace.force.tolist(),
        "state": [int(state) for state in trace.state],
    }


def render_guide(bundle: Path) -> dict[str, object]:
    """What the guide of a bundle must make of a path; state 1 where it has hold of the tip."""
    fixture = read_fixture(bundle)
    # The tip starts on the closed stroke, goes along it and leaves the tube by 3 mm.
    steps = np.linspace(0.0, 1.0, TICKS)[:, None]
    hip = fixture.points[-1] + steps * np.array([0.003, 0.004, 0.0])
    guide = Guide.of(fixture)
    guide.reset(hip[0])
    trace = guide.run(hip)
    return {
        "bundle": f"valid/{bundle.name}",
        "rule": "guide",
        "tolerance": 1e-12,
        "hip": hip.tolist(),
        "proxy": trace.proxy.tolist(),
        "force": trace.force.tolist(),
        "state": [int(is_held) for is_held in trace.held],
    }


def path_through(points: np.ndarray) -> np.ndarray:
    """(TICKS, 3) a hand that comes from 12 mm above the middle point, presses and slides [m]."""
    middle = points[len(points) // 2]
    steps = np.linspace(0.0, 1.0, TICKS)[:, None]
    start = middle + np.array([0.0005, 0.012, 0.003])
    return start + steps * np.array([0.004, -0.011, -0.001])


def path_between(corners: np.ndarray) -> np.ndarray:
    """(TICKS, 3) a hand that presses from above, far from every corner of a mesh [m]."""
    steps = np.linspace(0.0, 1.0, TICKS)[:, None]
    start = corners.mean(axis=0) + np.array([0.0005, 0.003, 0.012])
    return start + steps * np.array([0.004, -0.001, -0.011])


def write_json(path: Path, value: object) -> None:
    """Write a value as a line of JSON."""
    path.write_text(json.dumps(value, ensure_ascii=False) + "\n", encoding="utf-8")
