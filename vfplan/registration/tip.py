"""Where a tool's tip is, from poses in which the tip stays on one point (a pivot calibration).

A pose (R, p) puts the tip t at R t + p, which is the pivot c in every pose: linear equations for t
and c, solved by least squares. Noise of a tracker turns with the tool. So its covariance, taken
from the residuals, is constant in the tool's frame, and carried from there to the tip.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from vfplan.display import count
from vfplan.errors import CheckFailed, MarkerError
from vfplan.geometry.lines import Array, row_lengths
from vfplan.io.files import MAX_SETTINGS_BYTES, FilePath, naming_place, read_text
from vfplan.registration.models import most_off, rms
from vfplan.registration.registration import pointwise_bound

# With six poses the 95 % bound holds in 95 to 99 % of simulated sets, with five in 90 to 99 %.
MIN_POSES = 6

# How far the tool must turn about two axes at least, as root mean square over the poses [degrees].
# A tracker's angular noise of 0.3 degrees, squared over this one, shortens the tip by 0.1 %.
MIN_TURN_DEG = 10.0

# A pose is off where equal noise would make one so so seldom. A tracker's noise turns with the tool
# and is not equal: of 2,000 simulated good sets it refuses one.
SURE_OUTLIER = 1e-5

# Places that differ by less are equal: tables are rounded to micrometres [m].
ROUNDING_M = 1e-6

# Shortest and longest distance of a tool's tip from its flange [m]. Beyond them a unit is wrong.
MIN_TIP_M, MAX_TIP_M = 0.003, 2.0


@dataclass(frozen=True, eq=False)
class Tip:
    """A calibrated tip."""

    # (3,) in the tool's frame, and the length that its error stays within with 0.95 [m]
    offset_m: Array
    error95_m: float
    # (3,) the point that the tip stood on, in the frame of the poses [m]
    pivot_m: Array
    # (n,) how far each pose puts the tip from the pivot [m]
    residuals_m: Array
    # How far the tool turned about the axis about which it turned least
    turn_deg: float

    @property
    def residual_rms_m(self) -> float:
        """The root mean square of the residuals [m]."""
        return rms(self.residuals_m)


def calibrate_tip(poses: Array, max_error_m: float = np.inf) -> Tip:
    """The tip of a tool from its poses (n, 4, 4) [m] about one point.

    Raises MarkerError: fewer than six poses, or turned about one axis at most
    Raises CheckFailed: a single pose that has moved the tip, or a 95 % error above `max_error_m`
    """
    n = len(poses)
    if n < MIN_POSES:
        message = f"holds {count(n, 'pose')}. Give at least {MIN_POSES}, with the tip on one point"
        raise MarkerError(message, code="tip-few-poses", numbers={"poses": n})
    R, p = poses[:, :3, :3], poses[:, :3, 3]
    # A direction v of the tool stays still where |mean R v| is 1.
    steadiest = np.linalg.norm(R.mean(axis=0), 2)
    turn_deg = float(np.degrees(np.arcsin(np.sqrt(max(0.0, 1 - steadiest**2)))))
    if turn_deg < MIN_TURN_DEG:
        raise MarkerError(
            f"the tool turned by {turn_deg:.1f}° about all axes but one, so the tip could lie "
            f"anywhere along that one. Tilt it by at least {MIN_TURN_DEG:g}° to all sides",
            code="tip-not-determined", numbers={"turn_deg": turn_deg},
        )  # fmt: skip

    # Least squares, with the origins about their mean so that far away places lose no digits.
    rows = np.concatenate([R, np.broadcast_to(-np.eye(3), R.shape)], axis=2)
    centre = p.mean(axis=0)
    inverse = np.linalg.pinv(rows.reshape(-1, 6))
    solution = inverse @ (centre - p).ravel()
    residuals = (rows @ solution) + p - centre

    # The covariance of the residuals in the tool's frame, and what it makes of the tip.
    in_tool = np.einsum("nji,nj->ni", R, residuals)
    covariances = R @ (in_tool.T @ in_tool / (n - 2)) @ R.transpose(0, 2, 1)
    weights = inverse[:3].reshape(3, n, 3)
    covariance = np.einsum("inj,njk,lnk->il", weights, covariances, weights)
    refuse_unit(solution[:3])
    error95_m = float(pointwise_bound(covariance[None], n - 2)[0])
    worst, apart, _, probability = most_off(rows, residuals, n * ROUNDING_M**2)
    if probability < SURE_OUTLIER:
        apart_m = float(np.linalg.norm(apart))
        raise CheckFailed(
            f"pose {worst + 1} puts the tip {1e3 * apart_m:.3f} mm from where the others do. Leave "
            "it out, or record it again",
            code="tip-pose-off", numbers={"pose": worst + 1, "apart_m": apart_m},
        )  # fmt: skip
    if not error95_m <= max_error_m:
        raise CheckFailed(
            f"the tip is known to {1e3 * error95_m:.3f} mm only, and --max-error allows "
            f"{1e3 * max_error_m:g} mm. Check the order (w before x, y, z), look at pose "
            f"{worst + 1}, or record more poses that tilt the tool more",
            code="tip-error-large", numbers={"error95_m": error95_m},
        )  # fmt: skip
    return Tip(solution[:3], error95_m, solution[3:] + centre, row_lengths(residuals), turn_deg)


def refuse_unit(tip: Array) -> None:
    """Refuse a tip (3,) [m] that lies where no tool has one: millimetres read as metres, or so."""
    length_m = float(np.linalg.norm(tip))
    if not MIN_TIP_M <= length_m <= MAX_TIP_M:
        raise CheckFailed(
            f"as read, the tip lies {1e3 * length_m:.3g} mm from the flange, and "
            f"{1e3 * MIN_TIP_M:g} mm to {MAX_TIP_M:g} m are allowed. Name the unit of the "
            "poses with --units",
            code="tip-unit", numbers={"length_m": length_m},
        )  # fmt: skip


def read_tip(path: FilePath) -> tuple[str, Array, str]:
    """Tool and tip (3,) [m] of a file that `vfplan tip -o` wrote, and its SHA-256.

    Raises MarkerError: the file cannot be read, or is none of a tip
    """
    text, sha256 = read_text(path, MAX_SETTINGS_BYTES, MarkerError)
    try:
        values = json.loads(text)
        tool, tip = values["tool"], np.array(values["tip_m"], float)
        is_told = isinstance(tool, str) and tool.isprintable() and tool != ""
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        is_told = False
    if not is_told or tip.shape != (3,) or not np.isfinite(tip).all():
        message = "tells no tool and tip. Give the file that vfplan tip -o wrote"
        raise MarkerError(message, where=path, code="tip-file")
    with naming_place(path):
        refuse_unit(tip)
    return tool, tip, sha256
