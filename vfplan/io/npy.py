"""The headers of `.npy` files, whose makers are not known."""

from __future__ import annotations

import io
from typing import IO

import numpy as np

MOST_HEADER = 10_000  # bytes, as NumPy has it


def npy_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, whether by columns, and type of the array in a .npy file, left where its data begin.

    Raises `ValueError`, in one line: it has no such header, or a long one.
    """
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f".npy version {version}; 1.0 or 2.0 wanted")
    size = stream.read(2 * version[0])
    length = int.from_bytes(size, "little")
    if length > MOST_HEADER:
        raise ValueError(f"the header is longer than {MOST_HEADER} bytes")
    reads = (np.lib.format.read_array_header_1_0, np.lib.format.read_array_header_2_0)
    header = io.BytesIO(size + stream.read(length))
    try:
        return reads[version[0] - 1](header)
    except Exception as error:  # NumPy parses it as Python
        raise ValueError(f"the header is none: {str(error)[:80].partition(chr(10))[0]}") from None
