"""What a campaign varies: the errors of markers, hand and stiffness, and how a hand answers."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError
from vfplan.fixture import RegistrationRecord

Array = NDArray[np.float64]

BLOCK = 64
"""Number of trials in a block, about half a second of work."""

TREMOR_LOWEST_HZ = 8.0
"""Lower end of the band of physiological tremor [Hz] (Riviere, Gangloff, de Mathelin 2006)."""

TREMOR_HIGHEST_HZ = 12.0
"""Upper end of that band [Hz]."""


@dataclass(frozen=True)
class CampaignSettings:
    """What differs from trial to trial. What is `None` or 0 does not differ.

    Parameters
    ----------
    seed
        At least 0. Trial k draws from Philox keyed by (seed, k), whatever the others do.
    fle_image_px
        RMS distance [px] of a marker's picked pixel from its true one.
    fle_robot_m
        RMS distance [m] of a touched marker from its true place; `None`: as the residuals of the
        fixture's own registration say, all of it on this side.
    tremor_m
        RMS distance [m] of the hand from where it wants to be, at 8 to 12 Hz.
    stiffness_range
        Smallest and largest K [N/m] of the rendering, drawn evenly; `None`: the fixture's own.
    hand_stiffness
        k_h [N/m] of the hand that follows the session: a firm grip is 300 to 1000 N/m.

    Raises
    ------
    SettingError
        A value outside its range.
    """

    seed: int = 0
    fle_image_px: float = 0.0
    fle_robot_m: float | None = None
    tremor_m: float = 0.0
    stiffness_range: tuple[float, float] | None = None
    hand_stiffness: float = 500.0

    def __post_init__(self) -> None:
        if not 0 <= self.seed < 2**63:
            raise SettingError(
                f"seed is {self.seed}. Give a whole number from 0 to 2^63 - 1", code="seed"
            )
        for name in ("fle_image_px", "fle_robot_m", "tremor_m"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value >= 0):
                raise SettingError(
                    f"{name} is {value}. Give a finite number of at least 0", code="error-size"
                )
        low, high = self.stiffness_range or (1.0, 1.0)
        if not (0 < low <= high <= 1e6):
            raise SettingError(
                f"stiffness range is {low:g},{high:g}. Give A,B with 0 < A <= B <= 1e6 N/m",
                code="stiffness-range",
            )
        if not (isfinite(self.hand_stiffness) and self.hand_stiffness > 0):
            raise SettingError(
                f"hand stiffness is {self.hand_stiffness}. Give more than 0 N/m",
                code="hand-stiffness",
            )

    def as_dict(self) -> dict[str, Any]:
        """What is set, by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}


def tremor(time: Array, rms_m: float, rng: np.random.Generator) -> Array:
    """(T, 3) [m] a sum of three waves of 8 to 12 Hz along each axis, of `rms_m` in all."""
    hz = rng.uniform(TREMOR_LOWEST_HZ, TREMOR_HIGHEST_HZ, (3, 3))
    phase = rng.uniform(0, 2 * np.pi, (3, 3))
    waves = np.sin(2 * np.pi * hz * time[:, None, None] + phase).sum(axis=2)
    return rms_m * np.sqrt(2.0 / 9.0) * waves


def fle_of(record: RegistrationRecord) -> float:
    """RMS localisation error [m] of a marker, from the residuals of a registration.

    Raises
    ------
    SettingError
        Too few markers to estimate their error from.
    """
    # The number of parameters that the markers determine.
    if record.model == "rigid":
        parameters = 6
    elif record.model == "similarity":
        parameters = 7
    else:
        parameters = 3 * (record.source.shape[1] + 1)
    degrees_of_freedom = record.source.shape[0] * 3 - parameters
    if degrees_of_freedom < 1:
        raise SettingError(
            f"{len(record.source)} markers leave nothing to estimate their error from. Give "
            "--fle-robot MM",
            code="no-fle",
        )
    return float(np.sqrt(3 * (record.residuals_m**2).sum() / degrees_of_freedom))
