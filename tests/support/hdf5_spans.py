"""What the bytes of an HDF5 file of a bundle's kind belong to, by a walk of its own.

The reader's tests use it to build files that hold nothing but what they refer to: h5py leaves
behind what it deletes, and the reader refuses such rests before it comes to anything else.
"""

from __future__ import annotations

NIL, LINK, LAYOUT, CONTINUATION = 0x00, 0x06, 0x08, 0x10


def number(data: bytes, at: int, width: int) -> int:
    """An unsigned number; what lies behind the end of the file counts as zeros."""
    return int.from_bytes(data[at : at + width], "little")


def headers(data: bytes):
    """Yields (first, end, messages) of each block of each reachable object header.

    Each message is (kind, first, end) of its body. Soft and external links lead nowhere.
    """
    waiting, seen = [number(data, 36, 8)], set()
    while waiting:
        at = waiting.pop()
        if at in seen or data[at : at + 4] != b"OHDR":
            continue
        seen.add(at)
        flags = data[at + 5]
        width = 1 << (flags & 3)
        front = 6 + (16 if flags & 0x20 else 0) + (4 if flags & 0x10 else 0) + width
        size = number(data, at + front - width, width)
        blocks = [(at, at + front, at + front + size)]
        for first, begin, end in blocks:
            messages = list(_messages(data, begin, min(end, len(data))))
            for kind, start, _ in messages:
                if kind == CONTINUATION and len(blocks) < 64:
                    there, length = number(data, start, 8), number(data, start + 8, 8)
                    blocks.append((there, there + 4, there + length - 4))
                elif kind == LINK:
                    waiting += _targets(data, start)
            yield first, end + 4, messages


def _messages(data: bytes, at: int, end: int):
    while end - at >= 4:
        size = number(data, at + 1, 2)
        yield data[at], at + 4, at + 4 + size
        at += 4 + size


def _targets(data: bytes, at: int) -> list[int]:
    flags = data[at + 1]
    hard = not flags & 8 or data[at + 2] == 0
    at += 2 + bool(flags & 8) + 8 * bool(flags & 4) + bool(flags & 16)
    width = 1 << (flags & 3)
    return [number(data, at + width + number(data, at, width), 8)] if hard else []


def contiguous(data: bytes, at: int):
    """(first, end, whether a checksum ends it) of what a layout message at `at` leads to."""
    if data[at : at + 2] == b"\x03\x01":
        there, size = number(data, at + 2, 8), number(data, at + 10, 8)
        if there < len(data):
            yield there, there + size, False


def spans(data: bytes) -> list[tuple[int, int, bool]]:
    """(first, end, whether a checksum ends it) of what a file refers to, in order of place."""
    found = [(0, 48, True)]
    for first, end, messages in headers(data):
        found.append((first, end, True))
        for kind, start, _ in messages:
            found += contiguous(data, start) if kind == LAYOUT else []
    return sorted((first, min(end, len(data)), sum_) for first, end, sum_ in found)


def rests(data: bytes):
    """(first, end) of bytes that belong to nothing: between the spans, and in empty messages."""
    at = 0
    for first, end, _ in spans(data):
        if at < first:
            yield at, min(first, len(data))
        at = max(at, end)
    if at < len(data):
        yield at, len(data)
    for _, _, messages in headers(data):
        yield from ((first, end) for kind, first, end in messages if kind == NIL)
