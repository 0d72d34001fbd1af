"""OpenIGTLink messages with headers of version 1, which every version of it reads.

Lengths are in mm. Slicer's world is RAS. Positions in `patient_lps` therefore change the signs of x
and y; the robot's frame has no sides of a patient and is sent as it is.

Source: the OpenIGTLink protocol, versions 1 and 2 (J. Tokuda et al., Int. J. Med. Robot. 5, 2009,
423-434), and the ECMA-182 CRC.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
HEADER = struct.Struct(">H12s20sQQQ")

NEWTON = (0x0B << 54) | (1 << 50)
"""The protocol's code of the unit N."""

POLYNOMIAL = 0x42F0E1EBA9EA3693
"""Generator of the ECMA-182 CRC."""


class StatusCode(IntEnum):
    """The protocol's codes that this server sends."""

    OK = 1
    # No place for another client.
    BUSY = 6
    # The configuration or the input is not as it should be.
    WARNING = 13


@cache
def crc_table() -> list[int]:
    """The CRC's remainder of each byte."""
    table = []
    for byte in range(256):
        crc = byte << 56
        for _ in range(8):
            has_top_bit = crc >> 63
            crc = (crc << 1) % 2**64
            if has_top_bit:
                crc ^= POLYNOMIAL
        table.append(crc)
    return table


def crc64(data: bytes) -> int:
    """The ECMA-182 CRC of 64 bits, from 0."""
    table = crc_table()
    crc = 0
    for byte in data:
        crc = ((crc << 8) % 2**64) ^ table[(crc >> 56) ^ byte]
    return crc


def message(kind: str, device: str, time_s: float, body: bytes) -> bytes:
    """Header and body; `time_s` since 1970."""
    stamp = (int(time_s) << 32) | int((time_s % 1.0) * 2**32)
    head = HEADER.pack(1, kind.encode(), device.encode(), stamp, len(body), crc64(body))
    return head + body


def to_ras(frame: str) -> Array:
    """(3,) factors of each coordinate from m in `frame` to mm in RAS."""
    return np.array([-1e3, -1e3, 1e3]) if frame == "patient_lps" else np.array([1e3, 1e3, 1e3])


def transform(device: str, time_s: float, place_mm: Array) -> bytes:
    """TRANSFORM: a place (3,) [mm], without rotation."""
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
    device: str,
    time_s: float,
    points_mm: Array,
    *,
    lines: list[NDArray[np.integer]] | None = None,
    triangles: NDArray[np.integer] | None = None,
) -> bytes:
    """POLYDATA: points (N, 3) [mm], joined by lines or triangles, or each a vertex of its own."""
    vertices: list[NDArray[np.integer]] = []
    if lines is None and triangles is None:
        vertices = list(np.arange(len(points_mm))[:, None])
    faces: list[NDArray[np.integer]] = list(triangles) if triangles is not None else []
    # Of each kind of cell: how many there are, and each as its length and its points' indices.
    counts = []
    data = []
    for cells in (vertices, lines or [], faces):
        numbers: list[int] = []
        for cell in cells:
            numbers.append(len(cell))
            numbers.extend(cell)
        encoded = np.array(numbers, ">u4").tobytes()
        counts.extend((len(cells), len(encoded)))
        data.append(encoded)
    head = struct.pack(">10I", len(points_mm), *counts, 0, 0, 0)
    points = np.asarray(points_mm, ">f4").tobytes()
    return message("POLYDATA", device, time_s, head + points + b"".join(data))


def ball(radius_mm: float, rings: int = 12) -> tuple[Array, NDArray[np.int64]]:
    """Points (N, 3) [mm] and triangles (K, 3) of a sphere round 0."""
    theta = np.pi * np.arange(1, rings) / rings
    phi = np.pi * np.arange(2 * rings) / rings
    side = np.sin(theta)[:, None] * np.ones_like(phi)
    height = np.cos(theta)[:, None] * np.ones_like(phi)
    circles = np.stack([side * np.cos(phi), side * np.sin(phi), height], axis=-1).reshape(-1, 3)
    points = np.vstack([circles, [[0, 0, 1], [0, 0, -1]]]) * radius_mm
    # Each circle has n points; the two poles come after all circles.
    n = 2 * rings
    top = len(circles)
    bottom = top + 1
    k = np.arange(n)
    following = (k + 1) % n
    faces = [np.column_stack([np.full(n, top), k, following])]
    for row in range(rings - 2):
        upper = row * n
        lower = upper + n
        faces.append(np.column_stack([upper + k, lower + k, upper + following]))
        faces.append(np.column_stack([upper + following, lower + k, lower + following]))
    last = (rings - 2) * n
    faces.append(np.column_stack([np.full(n, bottom), last + following, last + k]))
    return points, np.vstack(faces)
