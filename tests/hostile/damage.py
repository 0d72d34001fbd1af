"""Damaged bundles, and the Python reader's verdict on them, in a process of its own."""

from __future__ import annotations

import hashlib
import io
from multiprocessing import get_context
from resource import RUSAGE_SELF, getrusage

import h5py
import numpy as np

from vfplan.bundle import seal
from vfplan.bundle.read import read_bundle
from vfplan.errors import BundleError

# Lengths of the seal of a bundle with short texts, and of what follows its texts [bytes].
SEAL, TAIL = 512, 48


def sealed(payload: bytes, *, end: int | None = None) -> bytes:
    """An HDF5 file as a bundle: filled up with zeros, its end of file set, a seal behind it.

    `end` is the end of file that it states, in place of the true one.
    """
    payload += bytes(-len(payload) % 8)
    if len(payload) >= 48:
        payload = seal.with_end_of_file(payload, len(payload) + SEAL if end is None else end)
    return payload + seal.seal_of(payload)


def resealed(data: bytes, damaged_seal: bool = False) -> bytes:
    """The bytes with a seal whose digests hold; the seal's own damage is kept if told so."""
    if len(data) < SEAL:
        return data
    payload, block = data[:-SEAL], bytearray(data[-SEAL:])
    if not damaged_seal:
        block[24:56] = hashlib.sha256(payload).digest()
    block[-TAIL:-16] = hashlib.sha256(block[:-TAIL]).digest()
    return payload + bytes(block)


def flipped(data: bytes, index: int, again: bool) -> bytes:
    """One bit of a bundle is another one; `again`: and the digests are those of the new bytes."""
    damaged = bytearray(data)
    damaged[index] ^= 1 << (index % 8)
    return resealed(bytes(damaged), index >= len(data) - SEAL) if again else bytes(damaged)


def cut(data: bytes, length: int, again: bool) -> bytes:
    """The first bytes of a bundle; `again`: under a seal of their own."""
    return sealed(data[:length]) if again else data[:length]


def equal(a, b) -> bool:
    """Whether two contents hold the same values, bit for bit."""
    return a.keys() == b.keys() and all(
        a[p].tobytes() == b[p].tobytes() if isinstance(a[p], np.ndarray) else a[p] == b[p]
        for p in a
    )


def by_h5py(data: bytes, paths) -> dict:
    """The values of a bundle at these paths as h5py reads them, in the form of `read_bundle`."""
    values = {}
    with h5py.File(io.BytesIO(data)) as file:
        for path in paths:
            where, _, name = path.partition("@")
            value = file[where].attrs[name] if name else file[where][...]
            if isinstance(value, np.ndarray) and value.dtype.kind == "S":
                value = tuple(text.decode() for text in value)
            values[path] = value.decode() if isinstance(value, bytes) else value
    return values


def verdict_of_two(data: bytes) -> str:
    """'.' refused, '=' read with the values that h5py reads, '!' read with others, or alone."""
    try:
        values = read_bundle(data)[0]
    except BundleError:
        return "."
    try:
        return "=" if equal(values, by_h5py(data, values)) else "!"
    except (OSError, KeyError, RuntimeError, ValueError, UnicodeDecodeError):
        return "!"


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
    fork = get_context("fork")
    reader, writer = fork.Pipe(duplex=False)

    def report():
        before = getrusage(RUSAGE_SELF).ru_maxrss
        text = work()
        writer.send((text, (getrusage(RUSAGE_SELF).ru_maxrss - before) / 1024))

    child = fork.Process(target=report)
    child.start()
    writer.close()
    try:
        assert reader.poll(limit_s), "the reading process hangs"
        return reader.recv()
    finally:
        child.kill()
        child.join()
