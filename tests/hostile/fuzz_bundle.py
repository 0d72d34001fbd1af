"""Fuzz target for the bundle reader: mutated payloads behind a good seal, checksums repaired.

Plain mutation would stop at libhdf5's checksums; here those of superblock and object headers are
computed anew, so that what lies behind them is reached.

    python tests/hostile/fuzz_bundle.py [CORPUS_FOLDER] -max_total_time=600

It needs the package atheris.
"""

from __future__ import annotations

import random
import struct
import sys
from functools import lru_cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "hostile"))
sys.path.insert(0, str(Path(__file__).parents[1] / "making"))
sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

if __name__ == "__main__":
    import atheris

    with atheris.instrument_imports(include=["vfplan.bundle"]):
        import vfplan.bundle.validation  # noqa: F401 - and with it the reader

import bundles
import damage
import hdf5_spans
from vfplan._core import lookup3

from vfplan.bundle.content import to_content
from vfplan.bundle.read import read_bundle
from vfplan.bundle.validation import validate
from vfplan.bundle.write import completed, to_payload
from vfplan.errors import BundleError


def checked_spans(payload: bytes):
    """(first, end) of each piece of metadata whose checksum follows it directly."""
    for first, end, summed in hdf5_spans.spans(payload):
        if summed and first < end - 4 <= len(payload) - 4:
            yield first, end - 4


def repaired(payload: bytes) -> bytes:
    """The payload with the checksums that its metadata should have."""
    data = bytearray(payload)
    for first, end in checked_spans(payload):
        if end + 4 <= len(data):
            data[end : end + 4] = struct.pack("<I", lookup3(bytes(data[first:end])))
    return bytes(data)


@lru_cache(maxsize=16)
def spans_of(payload: bytes) -> tuple[tuple[int, int], ...]:
    """The checked spans of a sound payload, of which many mutants are made."""
    return tuple(checked_spans(payload))


def mutated(payload: bytes, draw: random.Random) -> bytes:
    """A few random edits, most of them in the metadata, checksums repaired."""
    data = bytearray(payload)
    spans = spans_of(payload)
    for _ in range(draw.choice((1, 1, 1, 2, 3, 8))):
        first, end = draw.choice(spans) if draw.random() < 0.9 else (0, len(data))
        at = draw.randrange(first, end)
        kind = draw.random()
        if kind < 0.4:
            data[at] ^= 1 << draw.randrange(8)
        elif kind < 0.7:
            data[at] = draw.choice((0, 1, 2, 3, 4, 8, 16, 0x7F, 0x80, 0xFE, 0xFF))
        elif kind < 0.85:
            width = draw.choice((2, 4, 8))
            value = draw.choice(
                (0, 1, len(data), 1 << 31, 1 << 40, (1 << 64) - 1, draw.randrange(1 << 63))
            )
            data[at : at + width] = (value & ((1 << 8 * width) - 1)).to_bytes(width, "little")
        else:
            source = draw.randrange(0, len(data) - 32)
            length = draw.randrange(1, 32)
            data[at : at + length] = data[source : source + length]
    return repaired(bytes(data[: len(payload)]))


# The made-up fixtures of which mutants are made.
SEEDS = ("small", "whole", "doubtful", "drawn", "guided", "sheet", "patient", "pixels")


def mutants(first: int, count: int):
    """Bundles made of sound ones by a few edits, each sealed anew: number -> the same bytes."""
    good = [to_payload(completed(to_content(getattr(bundles, name)()))) for name in SEEDS]
    for number in range(first, first + count):
        draw = random.Random(number)
        yield damage.sealed(mutated(draw.choice(good), draw))


def attempt(payload: bytes) -> bool:
    """Read and validate a payload behind a good seal; only `BundleError` may come out of it."""
    data = damage.sealed(payload)
    try:
        read_bundle(data)
    except BundleError:
        read = False
    else:
        read = True
    valid = not any(issue.severity == "error" for issue in validate(data))
    assert valid <= read, "valid, and yet not read"
    return read


def main() -> None:
    import atheris
    import hostile

    seed = hostile.sound()

    def mutate(data, max_size, number):
        return mutated(data if len(data) > 64 else seed, random.Random(number))[:max_size]

    atheris.Setup([*sys.argv, "-max_len=65536"], attempt, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
