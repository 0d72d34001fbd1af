"""A session at another rate, by straight lines between its samples."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vfplan.errors import SettingError
from vfplan.session.types import BLOCK, Pair, SessionStream, Source

FASTEST_HZ = 1e6  # far above any arm's; a rate mistyped by six zeros would fill the memory


def resampled(session: Source, rate_hz: float) -> SessionStream:
    """The session at t0, t0 + 1/rate, ... up to its last sample, by linear interpolation.

    Parameters
    ----------
    session
        Any source of blocks.
    rate_hz
        Samples a second.

    Raises
    ------
    SettingError
        A rate that is not above 0 and at most 1 MHz.
    """
    if not 0 < rate_hz <= FASTEST_HZ:
        raise SettingError(f"rate {rate_hz:g} Hz; above 0 and at most {FASTEST_HZ:g} wanted")
    return SessionStream(
        lambda: _interpolated(session, rate_hz),
        session.name,
        session.frame,
        session.sha256,
        {**session.notes, "resampled_hz": rate_hz},
    )


def _interpolated(session: Source, rate_hz: float) -> Iterator[Pair]:
    start = None
    done = 0  # samples given so far; sample k stands at start + k / rate
    carry_time, carry_hip = np.empty(0), np.empty((0, 3))
    for time, hip in session.blocks(BLOCK):
        start = time[0] if start is None else start
        time = np.concatenate((carry_time, time))
        hip = np.concatenate((carry_hip, hip))
        # The guard of 1e-9 sample keeps the last one when T * rate is a whole number.
        last = int(np.floor((time[-1] - start) * rate_hz + 1e-9))
        for first in range(done, last + 1, BLOCK):
            at = start + np.arange(first, min(first + BLOCK, last + 1)) / rate_hz
            yield at, np.stack([np.interp(at, time, hip[:, i]) for i in range(3)], axis=1)
        done = max(done, last + 1)
        carry_time, carry_hip = time[-1:], hip[-1:]
