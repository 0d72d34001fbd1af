"""The errors a trial draws: of the hand that trembles, of the markers where nobody says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.campaign.settings import TREMOR_HZ
from vfplan.errors import SettingError
from vfplan.fixture import RegistrationRecord

Array = NDArray[np.float64]


def tremor(time: Array, rms_m: float, rng: np.random.Generator) -> Array:
    """(T, 3) [m] a sum of three waves of 8 to 12 Hz along each axis, of `rms_m` in all."""
    hz = rng.uniform(*TREMOR_HZ, (3, 3))
    phase = rng.uniform(0, 2 * np.pi, (3, 3))
    waves = np.sin(2 * np.pi * hz * time[:, None, None] + phase).sum(axis=2)
    return rms_m * np.sqrt(2.0 / 9.0) * waves


def fle_of(record: RegistrationRecord) -> float:
    """RMS localisation error [m] of a marker that a registration's residuals speak of."""
    p = {"affine": 3 * (record.source.shape[1] + 1), "similarity": 7, "rigid": 6}[record.model]
    dof = record.source.shape[0] * 3 - p
    if dof < 1:
        raise SettingError(
            f"{len(record.source)} markers leave nothing to estimate their error from; "
            "--fle-robot is wanted"
        )
    return float(np.sqrt(3 * (record.residuals_m**2).sum() / dof))
