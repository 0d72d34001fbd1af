"""A replay's ticks as CSV, for spreadsheets and plotting programs."""

from __future__ import annotations

import zlib
from typing import BinaryIO

import numpy as np

from vfplan.session.closing import Whole, require_same
from vfplan.session.ticks import TickBlock

HEADER = (
    "t,x,y,z,proxy_x,proxy_y,proxy_z,normal_x,normal_y,normal_z,force_x,force_y,force_z,"
    "state,penetration,overlap"
)


class CsvWriter(Whole):
    """Write ticks as CSV, one line a tick; numbers read back to the same bits.

    The file appears, whole, when the `with` statement ends well; raises `OutputError` when there
    is one already, or it cannot be written.
    """

    def _begin(self, file: BinaryIO) -> None:
        self._file = file
        self._sum = 0
        self._write(HEADER + "\n")

    def _write(self, text: str) -> None:
        data = text.encode("ascii")
        self._sum = zlib.crc32(data, self._sum)
        self._file.write(data)

    def append(self, block: TickBlock) -> None:
        """Add a block of ticks."""
        floats = np.column_stack(
            (block.time, block.hip, block.proxy, block.normal, block.force)
        ).tolist()
        tail = zip(
            floats,
            block.state.tolist(),
            block.penetration.tolist(),
            block.overlap.tolist(),
            strict=True,
        )
        self._write(
            "".join(
                f"{','.join(map(repr, row))},{state},{depth!r},{over!r}\n"
                for row, state, depth, over in tail
            )
        )

    def _close(self) -> None:
        pass

    def _verify(self) -> None:
        self._file.seek(0)
        found = 0
        while piece := self._file.read(1 << 20):
            found = zlib.crc32(piece, found)
        require_same(found, self._sum)
