"""Headers of `.npy` files, read with a limit on their length."""

from __future__ import annotations

import inspect
import io
from typing import IO

import numpy as np

NUMPY_READER = inspect.signature(np.lib.format.read_array_header_1_0)
MAX_HEADER_BYTES: int = NUMPY_READER.parameters["max_header_size"].default
"""NumPy's own limit."""


def npy_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, whether stored by columns, and type of the array in a `.npy` file.

    The stream is left where the array's data begin. Raises `ValueError`, in one line, for a header
    that is none or too long.
    """
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        size_bytes = 2
        read_header = np.lib.format.read_array_header_1_0
    elif version == (2, 0):
        size_bytes = 4
        read_header = np.lib.format.read_array_header_2_0
    else:
        raise ValueError(f".npy version {version}; 1.0 and 2.0 are read")
    size = stream.read(size_bytes)
    length = int.from_bytes(size, "little")
    if length > MAX_HEADER_BYTES:
        raise ValueError(f"the header is longer than {MAX_HEADER_BYTES} bytes")
    header = io.BytesIO(size + stream.read(length))
    try:
        return read_header(header)
    except Exception as error:  # NumPy parses the header as Python source.
        first_line = str(error)[:80].partition("\n")[0]
        raise ValueError(f"the header is none: {first_line}") from None
