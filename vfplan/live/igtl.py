"""OpenIGTLink messages with headers of version 1, which every version of it reads.

Lengths are in mm. Slicer's world is RAS: what is in `patient_lps` has x and y turned; the robot's
frame has no sides of a patient and is sent as it is.

Source: the OpenIGTLink protocol, versions 1 and 2 (J. Tokuda et al., Int. J. Med. Robot. 5, 2009,
423-434), and the ECMA-182 CRC.
"""

from __future__ import annotations

import struct
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
HEADER = struct.Struct(">H12s20sQQQ")
NEWTON = (0x0B << 54) | (1 << 50)  # the protocol's code of the unit N
OK, BUSY, WARNING = 1, 6, 13  # status codes: fine; taken; configuration or input that is not
POLYNOMIAL, ALL = 0x42F0E1EBA9EA3693, 2**64 - 1


@cache
def _table() -> list[int]:
    table = []
    for byte in range(256):
        crc = byte << 56
        for _ in range(8):
            crc = ((crc << 1) & ALL) ^ (POLYNOMIAL if crc >> 63 else 0)
        table.append(crc)
    return table


def crc64(data: bytes) -> int:
    """The ECMA-182 CRC of 64 bits, from 0."""
    table, crc = _table(), 0
    for byte in data:
        crc = ((crc << 8) & ALL) ^ table[(crc >> 56) ^ byte]
    return crc


def message(kind: str, device: str, time_s: float, body: bytes) -> bytes:
    """Header and body; `time_s` since 1970."""
    stamp = (int(time_s) << 32) | int((time_s % 1.0) * 2**32)
    head = HEADER.pack(1, kind.encode(), device.encode(), stamp, len(body), crc64(body))
    return head + body


def to_ras(frame: str) -> Array:
    """(3,) what each coordinate is multiplied by on its way from m in `frame` to mm in RAS."""
    return np.array([-1e3, -1e3, 1e3] if frame == "patient_lps" else [1e3, 1e3, 1e3])


def transform(device: str, time_s: float, place_mm: Array) -> bytes:
    """TRANSFORM: a place (3,) [mm], unturned."""
    columns = np.vstack([np.eye(3), place_mm])
    return message("TRANSFORM", device, time_s, columns.astype(">f4").tobytes())


def sensor(device: str, time_s: float, values: Array, unit: int = NEWTON) -> bytes:
    """SENSOR: an array of at most 255 numbers of one unit."""
    body = struct.pack(">BBQ", len(values), 0, unit) + np.asarray(values, ">f8").tobytes()
    return message("SENSOR", device, time_s, body)


def status(device: str, time_s: float, code: int, name: str, text: str) -> bytes:
    """STATUS: a code of the protocol, a name of at most 19 letters, and words."""
    body = struct.pack(">Hq20s", code, 0, name.encode()[:19]) + text.encode() + b"\0"
    return message("STATUS", device, time_s, body)


def polydata(
    device: str, time_s: float, points_mm: Array, *,
    lines: list[NDArray[np.integer]] | None = None, triangles: NDArray[np.integer] | None = None,
) -> bytes:  # fmt: skip
    """POLYDATA: points (N, 3) [mm], joined by lines or triangles, or each a vertex of its own."""
    vertices: list[NDArray[np.integer]] = []
    if lines is None and triangles is None:
        vertices = list(np.arange(len(points_mm))[:, None])
    faces = [] if triangles is None else list(triangles)
    parts = [_cells(cells) for cells in (vertices, lines or [], faces)]
    counts = [number for count, data in parts for number in (count, len(data))]
    head = struct.pack(">10I", len(points_mm), *counts, 0, 0, 0)
    points = np.asarray(points_mm, ">f4").tobytes()
    return message("POLYDATA", device, time_s, head + points + b"".join(d for _, d in parts))


def _cells(cells: list[NDArray[np.integer]]) -> tuple[int, bytes]:
    """How many cells, and each as its length and its points' indices."""
    flat = [number for cell in cells for number in (len(cell), *cell)]
    return len(cells), np.array(flat, ">u4").tobytes()


def ball(radius_mm: float, rings: int = 12) -> tuple[Array, NDArray[np.int64]]:
    """Points (N, 3) [mm] and triangles (K, 3) of a sphere round 0."""
    theta = np.pi * np.arange(1, rings) / rings
    phi = np.pi * np.arange(2 * rings) / rings
    side = np.sin(theta)[:, None] * np.ones_like(phi)
    height = np.cos(theta)[:, None] * np.ones_like(phi)
    ring = np.stack([side * np.cos(phi), side * np.sin(phi), height], axis=-1).reshape(-1, 3)
    points = np.vstack([ring, [[0, 0, 1], [0, 0, -1]]]) * radius_mm
    n, top, bottom = 2 * rings, len(ring), len(ring) + 1
    k, after = np.arange(n), (np.arange(n) + 1) % n
    faces = [np.column_stack([np.full(n, top), k, after])]
    for row in range(rings - 2):
        a, b, c, d = row * n + k, row * n + after, (row + 1) * n + k, (row + 1) * n + after
        faces += [np.column_stack([a, c, b]), np.column_stack([b, c, d])]
    last = (rings - 2) * n
    faces.append(np.column_stack([np.full(n, bottom), last + after, last + k]))
    return points, np.vstack(faces)
