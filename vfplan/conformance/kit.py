"""Write the conformance kit: sound files with their values, broken files, and rendered paths."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from vfplan.bundle import seal
from vfplan.bundle.content import from_content, review_digest, to_content
from vfplan.bundle.read import read_bundle, read_fixture
from vfplan.bundle.write import completed, to_payload
from vfplan.conformance import fixtures, vectors
from vfplan.engine.guide import Guide
from vfplan.engine.proxy import ProxyEngine
from vfplan.fixture import Fixture
from vfplan.io.files import to_json_types

FIXTURES = (
    "minimal", "cloud", "curve", "registered", "navigated", "pixels", "patient", "mesh",
    "drawn_mesh", "pieces", "mirrored_pieces", "guided", "findings", "reviewed", "of_a_case",
    "touched",
)  # fmt: skip
# Those that are also there as a person approved them, each with its review digest.
REVIEWED = (
    "minimal", "cloud", "curve", "navigated", "pixels", "patient", "drawn_mesh", "pieces",
    "guided", "findings",
)  # fmt: skip
# Fixture -> rules by which a path is rendered.
RENDERED = {
    "cloud": ("paper", "robust"),
    "curve": ("paper", "robust"),
    "pieces": ("paper", "robust", "exact"),
    "mesh": ("paper", "robust", "exact"),
    "drawn_mesh": ("paper", "robust", "exact"),
    "guided": ("guide",),
}
# The part of its path that a hand has gone at each tick.
STEPS = np.linspace(0.0, 1.0, 60)[:, None]


def write_kit(folder: Path) -> int:
    """Write the kit into a folder; returns the number of files."""
    files = [(f"valid/{name}", data, {}) for name, data in valid_files()]
    for kind, broken in (("invalid", vectors.VECTORS), ("signed", vectors.UNTRUSTED)):
        for rule, name, why, make, *words in broken:
            files.append((f"{kind}/{name}", make(*words), {"rule": rule, "why": why}))
    files.append(("signed/trusted", vectors.signed("reviewed", False), {"rule": "S7"}))
    for kind in ("valid", "invalid", "signed", "render"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    for name, data, about in files:
        (folder / f"{name}.h5").write_bytes(data)
        if "why" not in about:
            content = read_bundle(data)[0]
            about["review_digest"] = review_digest(from_content(content))
            about["values"] = to_json_types(content)
        write_json(folder / f"{name}.json", about)
    (folder / "signed" / "keys.pub").write_bytes(trusted_key())
    rendered = [(name, rule) for name, rules in RENDERED.items() for rule in rules]
    for name, rule in rendered:
        path = folder / "valid" / f"{name}.h5"
        write_json(folder / "render" / f"{name}-{rule}.json", render(path, rule))
    return 2 * len(files) + 1 + len(rendered)


def valid_files() -> Iterator[tuple[str, bytes]]:
    """(name, bytes) of the sound files: each fixture as libhdf5 and as plain bytes lay it out."""
    for name in FIXTURES:
        content = vectors.content_of(name)
        yield name, b"".join(seal.sealed_file(to_payload(content)))
        yield f"{name}_plain", vectors.of_content(content)
    for name in REVIEWED:
        approved = fixtures.approved(getattr(fixtures, name)())
        yield f"{name}_reviewed", vectors.of_content(completed(to_content(approved)))
    yield "newer_minor", vectors.of_items(vectors.items("later"))
    # A setting's text holds a double quote and a backslash.
    quoted = {"/provenance/setting_values": ('"a"b\\c"', "1e-05", "false")}
    yield "quoted_setting", vectors.changed("curve", quoted)
    yield "signed", vectors.signed("reviewed", False)
    yield "signed_despite_findings", vectors.signed("findings", True)


def trusted_key() -> bytes:
    """The public key of the kit, as PEM."""
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

    public = vectors.key_of(vectors.KIT_SEED).public_key()
    return public.public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)


def render(bundle: Path, rule: str) -> dict[str, object]:
    """What an engine must make of a path: proxy [m], force on the hand [N] and state by tick.

    The state of a guide is 1 where it has hold of the tip.
    """
    fixture = read_fixture(bundle)
    engine = Guide.of(fixture) if rule == "guide" else ProxyEngine.of(fixture, rule)
    hip = path_of(fixture)
    engine.reset(hip[0])
    trace = engine.run(hip)
    return {
        "bundle": f"valid/{bundle.name}",
        "rule": rule,
        "tolerance": 1e-12,
        "hip": hip.tolist(),
        "proxy": trace.proxy.tolist(),
        "force": trace.force.tolist(),
        "state": (trace.held if isinstance(engine, Guide) else trace.state).astype(int).tolist(),
    }


def path_of(fixture: Fixture) -> np.ndarray:
    """(TICKS, 3) a path of the hand for a fixture [m].

    Along the closed stroke of a guide and out of its tube. From above onto a mesh of few corners,
    far from each. Else from 12 mm above the middle point, to press and to slide.
    """
    points = fixture.points
    if fixture.guidance is not None:
        return points[-1] + STEPS * [0.003, 0.004, 0.0]
    if fixture.sample_radius is not None:
        return points.mean(axis=0) + [0.0005, 0.003, 0.012] + STEPS * [0.004, -0.001, -0.011]
    return points[len(points) // 2] + [0.0005, 0.012, 0.003] + STEPS * [0.004, -0.011, -0.001]


def write_json(path: Path, value: object) -> None:
    """Write a value as a line of JSON."""
    path.write_text(json.dumps(value, ensure_ascii=False) + "\n", encoding="utf-8")
