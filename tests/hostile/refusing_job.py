"""A job for `vfplan.io.sandbox`, which refuses what it is to read."""

import numpy as np

from vfplan.errors import SessionError


def refuse(_stream):
    yield 1
    raise SessionError(
        "the clock goes back",
        where="session.csv",
        code="clock-goes-back",
        numbers={"line": np.int64(7), "back_s": np.float64(0.25), "at_m": np.array([1.0, np.nan])},
    )
