"""A replay's ticks as CSV, for spreadsheets and plotting programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vfplan.session.closing import Closing
from vfplan.session.result import TickBlock

HEADER = (
    "t,x,y,z,proxy_x,proxy_y,proxy_z,normal_x,normal_y,normal_z,force_x,force_y,force_z,"
    "state,penetration,overlap"
)


class CsvWriter(Closing):
    """Write ticks as CSV, one line a tick; numbers read back to the same bits."""

    def __init__(self, path: str | Path) -> None:
        self._file = Path(path).open("w", encoding="ascii", newline="")  # noqa: SIM115
        self._file.write(HEADER + "\n")

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
        self._file.writelines(
            f"{','.join(map(repr, row))},{state},{depth!r},{over!r}\n"
            for row, state, depth, over in tail
        )
