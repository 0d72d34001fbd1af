"""Where a rare event is most likely: the design point of structural reliability.

The marker errors are standard normals z. The design point is the z nearest to 0 at which the tool
comes as far as asked; trials drawn around it reach the event about every second time, and weights
take the shift back. A. M. Hasofer, N. C. Lind, J. Eng. Mech. Div. 100, 1974, 111-121, with the
iteration of R. Rackwitz, B. Fiessler, Computers and Structures 9, 1978, 489-494.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.campaign.trial import FREE, Trials
from vfplan.errors import SettingError

Array = NDArray[np.float64]
STEPS = 12
DELTA = 0.5  # of a standard deviation, to either side, for the slope
CLOSE_M = 1e-6


def design_point(trials: Trials, beyond_m: float) -> Array:
    """(D,) the most probable standard normals that bring the tool `beyond_m` beyond the curve.

    Raises SettingError: the hand does not touch the curve, or no such place was found
    """
    z = np.zeros(trials.dimension)
    for _ in range(STEPS):
        depth = _depth(trials, z)
        if depth == FREE:
            raise SettingError("the hand of these sessions never touches the curve")
        slope = _slope(trials, z)
        square = float(slope @ slope)
        if square == 0.0:
            break
        if abs(depth - beyond_m) < CLOSE_M:
            return z
        z = slope * ((slope @ z + beyond_m - depth) / square)
    raise SettingError(
        f"no marker errors were found that bring the tool {1e3 * beyond_m:g} mm beyond the curve: "
        f"after {STEPS} steps {1e3 * _depth(trials, z):.3f} mm"
    )


def _depth(trials: Trials, z: Array) -> float:
    """The depth [m] of session 0, with the fixture's own K and no tremor."""
    return trials.replay(trials.planned(z), 0, np.random.default_rng(0)).depth_m


def _slope(trials: Trials, z: Array) -> Array:
    """(D,) change of the depth for a standard deviation of each marker error [m].

    The curve's own deviations are left out: a thousand of them, each of micrometres.
    """
    slope = np.zeros(len(z))
    for k in range(trials.markers):
        step = np.zeros(len(z))
        step[k] = DELTA
        slope[k] = (_depth(trials, z + step) - _depth(trials, z - step)) / (2 * DELTA)
    return slope
