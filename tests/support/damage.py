"""Damaged bundles, and the Python reader's verdict on them, in a process of its own."""

from __future__ import annotations

import hashlib
import os
import resource
import signal
import struct

import numpy as np

from vfplan.bundle import read_bundle
from vfplan.errors import BundleError

BLOCK, DIGEST = 512, 32


def resealed(data: bytes, damaged_block: bool = False) -> bytes:
    """The bytes under a seal that holds; the block's own damage is kept if told so."""
    if len(data) < BLOCK:
        return data
    block, payload = bytearray(data[:BLOCK]), data[BLOCK:]
    if not damaged_block:
        block[16:24] = struct.pack("<Q", len(payload))
        block[24:56] = hashlib.sha256(payload).digest()
    block[-DIGEST:] = hashlib.sha256(block[:-DIGEST]).digest()
    return bytes(block) + payload


def sealed(payload: bytes) -> bytes:
    """A payload behind a fresh seal."""
    from vfplan.bundle.write import seal_of, to_block

    return to_block(seal_of(payload)) + payload


def flipped(data: bytes, index: int, again: bool) -> bytes:
    damaged = bytearray(data)
    damaged[index] ^= 1 << (index % 8)
    return resealed(bytes(damaged), index < BLOCK) if again else bytes(damaged)


def cut(data: bytes, length: int, again: bool) -> bytes:
    return resealed(data[:length]) if again else data[:length]


def equal(a, b) -> bool:
    """Whether two contents hold the same values, bit for bit."""
    return a.keys() == b.keys() and all(
        a[p].tobytes() == b[p].tobytes() if isinstance(a[p], np.ndarray) else a[p] == b[p]
        for p in a
    )


def verdict(data: bytes, wanted) -> str:
    """'.' refused, '=' read with the same values, '!' read with others."""
    try:
        return "=" if equal(read_bundle(data)[0], wanted) else "!"
    except BundleError:
        return "."


def in_child(work, limit_s: float = 300.0) -> tuple[str, float]:
    """(what `work` returned as text, memory it added at its peak [MiB]) of a forked child.

    A fork begins with its parent's memory, however much that is: only what comes on top counts.
    A crash, a hang beyond `limit_s` and any exception fail the calling test.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reader)
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            text = work()
            added = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
            os.write(writer, f"{added}\n".encode())
            with os.fdopen(writer, "w") as file:
                file.write(text)
            os._exit(0)
        except BaseException as error:
            os.write(2, f"{type(error).__name__}: {error}\n".encode())
            os._exit(1)
    os.close(writer)
    signal.alarm(int(limit_s) + 1)
    try:
        with os.fdopen(reader) as file:
            text = file.read()
    finally:
        signal.alarm(0)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0, "the reading process died"
    added, _, rest = text.partition("\n")
    return rest, float(added)
