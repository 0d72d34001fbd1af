"""Where a line is wider than elsewhere: two of its runs side by side would be measured midway.

A pen changes its strength with its opacity and with the ground under it, its width it keeps. So a
place counts as wide by the smaller of two ratios to the line's own median: of the coverage summed
across the line, and of that sum over the profile's peak. Over curves of 2 to 8 px, bends down to
3 px, bright bones, opacities of 35 to 100 % and both ways of blending the widest run measured 1.08
in PNG and 1.17 in JPEG 50 and 75; at corners of 30 to 90 degrees, where a line touches itself for a
few pixels, 1.17 and 1.20. Two runs of a 3 px pen d px apart reach 1 + d/3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.centreline.profile import Profiles

CLEAN = 0.006  # of coverage beside the line: less, and the colour has no noise of JPEG's
RUN, LEAST_RUN = 4.0, 12  # widths, points: a corner or a blot is shorter
DOUBTED, REFUSED = (1.1, 1.25), (1.3, 1.35)  # in clean pictures, in those with JPEG's noise


@dataclass(frozen=True)
class Widening:
    """The widest run of a line.

    Parameters
    ----------
    ratio
        Its width over the line's own median.
    place
        (u, v) of its middle [px].
    doubted, refused
        Whether this may be, or surely is, no single run of the pen.
    """

    ratio: float
    place: tuple[float, float]
    doubted: bool
    refused: bool


def widest_run(
    profiles: Profiles, base: NDArray, valid: NDArray, width: float, closed: bool
) -> Widening:
    """The widest run of 4 widths along a (M, 2) path, where (M,) `valid` says it was seen."""
    from scipy.ndimage import uniform_filter1d

    seen = np.where(profiles.seen, np.clip(profiles.alpha, 0.0, None), 0.0)
    mass = seen.sum(1)
    across = mass / np.maximum(seen.max(1), 1e-6)
    both = np.minimum(mass / np.median(mass[valid]), across / np.median(across[valid]))
    count = min(max(LEAST_RUN, round(RUN * width)), len(base))
    mode = "wrap" if closed else "nearest"
    run = uniform_filter1d(np.where(valid, both, 1.0), count, mode=mode)
    at = int(run.argmax())
    noisy = int(np.median(np.abs(profiles.alpha[:, [0, -1]])) > CLEAN)
    ratio = float(run[at])
    place = (float(base[at, 0]), float(base[at, 1]))
    return Widening(ratio, place, ratio > DOUBTED[noisy], ratio > REFUSED[noisy])
