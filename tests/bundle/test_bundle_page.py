"""docs/format.md is enough: a seal and signature checked, and a bundle written, without our code.

What stands here was written from that page alone, with h5py, hashlib, struct and cryptography; HDF5
itself has the checksum.
"""

from __future__ import annotations

import hashlib
import io
import re
import struct
from pathlib import Path

import bundles
import h5py
import numpy as np
import pytest
from conftest import ROOT, file_with
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.serialization import load_pem_public_key
from vfplan._core import lookup3

import vfplan
from vfplan.bundle.validation import validate

GOLDEN = Path(__file__).parents[1] / "data" / "bundles"


def check_seal(data, public=None):
    """Section 4: (case, robot serial, time of registration) of sealed bytes, or an assertion."""
    assert len(data) >= 560
    assert data[-8:] == b"VFPLTAIL"
    size, zero = struct.unpack_from("<II", data, len(data) - 16)
    assert size in (512, 1024, 2048, 4096)
    payload, seal = data[:-size], data[-size:]
    magic, version, flags, also_size, length, digest = struct.unpack_from("<8sHHIQ32s", seal)
    assert (magic, version, zero) == (b"VFPLSEAL", 2, 0)
    assert flags in (0, 1, 3)
    assert (also_size, length) == (size, len(payload))
    assert len(payload) % 8 == 0
    moment, n_case, n_robot = struct.unpack_from("<QHH", seal, 136)
    end = 148 + n_case + n_robot
    assert size == next(b for b in (512, 1024, 2048, 4096) if end + 48 <= b)
    assert not any(seal[end:-48])
    assert flags or not any(seal[56:-48])
    assert hashlib.sha256(seal[:-48]).digest() == seal[-48:-16]
    assert hashlib.sha256(payload).digest() == digest
    assert struct.unpack_from("<Q", payload, 28) == (len(data),)
    if public is not None:
        assert seal[56:72] == hashlib.sha256(public.public_bytes_raw()).digest()[:16]
        public.verify(seal[72:136], b"vfplan bundle seal 2\0" + seal[:72] + seal[136:-48])
    return seal[148 : 148 + n_case].decode(), seal[148 + n_case : end].decode(), moment


def test_the_page_tells_how_a_signature_is_checked():
    data = (GOLDEN / "2.0-signed.h5").read_bytes()
    public = load_pem_public_key((GOLDEN / "signed.pub").read_bytes())
    assert check_seal(data, public)[:2] == ("case 17", "R-0042")
    forged = bytearray(data)
    forged[-512 + 140] ^= 1  # another day, sealed again
    forged[-48:-16] = hashlib.sha256(forged[-512:-48]).digest()
    with pytest.raises(InvalidSignature):
        check_seal(bytes(forged), public)


PAGE = (ROOT / "docs" / "format.md").read_text()


def test_every_must_of_the_page_has_a_number():
    """Rules are list items that begin with their number; tables name theirs in the text above."""
    rules = {}
    for item in re.split(r"\n(?=- |\n|#)", PAGE[PAGE.index("## 1. The file") :]):
        if "MUST" not in item or item.strip().startswith(("|", "<!--")):
            continue
        found = re.match(r"\s*- \*\*([A-Z])(\d+)\*\* ", item)
        assert found, f"a MUST without a number: {item.strip()[:100]!r}"
        rules.setdefault(found[1], []).append(int(found[2]))
    for letter, numbers in rules.items():
        assert numbers == list(range(1, len(numbers) + 1)), letter
    assert sorted(rules) == ["C", "K", "L", "M", "S", "V"]


def text(holder, name, value):
    raw = value.encode()
    holder.attrs.create(name, np.bytes_(raw), dtype=h5py.string_dtype("utf-8", len(raw)))


def dataset(group, name, values, unit=None, frame=None):
    made = group.create_dataset(name, data=values, fill_time="never")
    for key, value in (("unit", unit), ("frame", frame)):
        if value is not None:
            text(made, key, value)


def written(points):
    """A closed curve as a bundle, from sections 1 to 5."""
    stream = io.BytesIO()
    with h5py.File(stream, "w", libver=("v108", "v108")) as file:
        identity = hashlib.sha256(b"robot_base\0" + points.tobytes()).hexdigest()[:32]
        names = {"format": "vfplan-fixture", "version": "2.0", "frame": "robot_base"}
        for name, value in {**names, "id": identity}.items():
            text(file, name, value)
        dataset(file, "points", points, "m", "robot_base")
        curve = file.create_group("curve")
        dataset(curve, "stroke", np.zeros(len(points), "<i4"), "1")
        dataset(curve, "closed", np.ones(1, "u1"), "1")
        rendering = file.create_group("rendering")
        dataset(rendering, "stiffness", np.full(3, 1000.0), "N/m", "robot_base")
        rendering.attrs.update(contact_radius_m=0.005, band_m=1e-5, point_radius_m=0.0)
        steps = np.diff(points, axis=0, append=points[:1])
        gaps = np.linalg.norm(steps, axis=1)
        leak = file.create_group("leak")
        text(leak, "kind", "curve")
        leak.attrs["certified"] = np.uint8(1)
        leak.attrs.update(largest_m=gaps.max(), limit_m=2 * (0.005 - 1e-5))
        place = points[gaps.argmax()] + steps[gaps.argmax()] / 2
        dataset(leak, "place", place, "m", "robot_base")
        provenance = file.create_group("provenance")
        text(provenance, "created_utc", "2026-11-21T08:00:00Z")
        text(provenance, "software", "a program of somebody else's")
        words = np.array(["gezeichnet von Zoë".encode()], h5py.string_dtype("utf-8", 19))
        dataset(provenance, "history", words)
    payload = stream.getvalue()
    payload += bytes(-len(payload) % 8)
    superblock = payload[:28] + struct.pack("<Q", len(payload) + 512) + payload[36:44]
    payload = superblock + struct.pack("<I", lookup3(superblock)) + payload[48:]
    digest = hashlib.sha256(payload).digest()
    head = struct.pack("<8sHHIQ32s408x", b"VFPLSEAL", 2, 0, 512, len(payload), digest)
    tail = hashlib.sha256(head).digest() + struct.pack("<II8s", 512, 0, b"VFPLTAIL")
    return payload + head + tail


def test_the_page_tells_how_a_bundle_is_written(tmp_path):
    points = 0.4 + (bundles.large(60).points - 0.4) * 0.2
    path = file_with(tmp_path / "theirs.h5", written(points))
    check_seal(path.read_bytes())
    assert [issue.code for issue in validate(path)] == ["seal.unsigned", "review.missing"]
    fixture = vfplan.read_fixture(path)
    assert fixture.points.tobytes() == points.tobytes()
    assert fixture.provenance.history == ("gezeichnet von Zoë",)
