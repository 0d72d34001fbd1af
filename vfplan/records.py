"""What a bundle records of its points: where they came from, how registered, how judged."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.io.reading import now_utc

Frame = Literal["image", "robot_base", "patient_lps"]
FRAMES: tuple[Frame, ...] = ("image", "robot_base", "patient_lps")


@dataclass(frozen=True, eq=False)
class RegistrationRecord:
    """The registration that carried the points into the robot's frame, and its error.

    Parameters
    ----------
    model
        "affine", "similarity" or "rigid".
    source_frame
        The frame of `source`: "image" [px] or "patient_lps" [m].
    T_robot_image
        (3, 3) acting on [u v 1], or (4, 4) acting on [x y z 1]; maps into `robot_base` [m].
    labels
        (M,) marker labels.
    source, target
        (M, 2|3) marker positions in the source frame and (M, 3) in `robot_base` [m].
    residuals_m
        (M,) distance of each marker from where the transform puts it [m].
    fre_rms_m, loo_rms_m, tre_rms_m
        Root mean squares [m]: fiducial registration error, leave-one-out, and the target
        registration error predicted over the curve.
    covariance
        (P, P) covariance of the transform's parameters, row-major T; `None` when unknown.
    tre_m
        (N,) predicted RMS TRE at each of the fixture's points [m]; `None` when unknown.
    """

    model: str
    source_frame: Frame
    T_robot_image: NDArray[np.float64]
    labels: tuple[str, ...]
    source: NDArray[np.float64]
    target: NDArray[np.float64]
    residuals_m: NDArray[np.float64]
    fre_rms_m: float
    loo_rms_m: float | None = None
    tre_rms_m: float | None = None
    covariance: NDArray[np.float64] | None = None
    tre_m: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class StabilityVerdict:
    """The stability gate's verdict on a fixture's K with one robot.

    Parameters
    ----------
    robot
        Its name.
    mass_kg, damping_n_s_per_m, rate_hz, delay_ticks
        What was simulated.
    k_n_per_m
        The K judged: the largest in any direction that the fixture renders [N/m].
    k_max_n_per_m
        The largest stable K found in closed loop [N/m].
    margin
        What K is multiplied by before it is held against `k_max_n_per_m`.
    """

    robot: str
    mass_kg: float
    damping_n_s_per_m: float
    rate_hz: float
    delay_ticks: int
    k_n_per_m: float
    k_max_n_per_m: float
    margin: float

    @property
    def k_linear_bound_n_per_m(self) -> float:
        """b / (T/2 + t_d) [N/m]."""
        return self.damping_n_s_per_m * self.rate_hz / (0.5 + self.delay_ticks)

    @property
    def k_pass_n_per_m(self) -> float:
        """The largest K that passes [N/m]."""
        return self.k_max_n_per_m / self.margin

    @property
    def stable(self) -> bool:
        """Whether K passes."""
        return self.k_n_per_m <= self.k_pass_n_per_m

    def as_dict(self) -> dict[str, str | float | bool]:
        """As a report holds it."""
        derived = ("k_linear_bound_n_per_m", "k_pass_n_per_m", "stable")
        return asdict(self) | {name: getattr(self, name) for name in derived}


@dataclass(frozen=True)
class Provenance:
    """Where a bundle came from; holds no file names, paths or patient identifiers.

    Parameters
    ----------
    created_utc
        ISO 8601, whole seconds, ending in "Z".
    software
        "vfplan VERSION".
    inputs
        Role ("image", "markers_image", ...) -> SHA-256 of the bytes, lower-case hex.
    settings
        The settings in force, by name.
    history
        One line for each earlier form of the file (migrations), oldest first.
    """

    created_utc: str
    software: str
    inputs: dict[str, str] = field(default_factory=dict)
    settings: dict[str, str | float | int | bool] = field(default_factory=dict)
    history: tuple[str, ...] = ()

    @classmethod
    def now(cls, inputs: dict[str, str], settings: Any) -> Provenance:
        """Of what is made now, or at the time that SOURCE_DATE_EPOCH says, by this program.

        settings: a dataclass or a dict; what is `None` is left out
        Raises `InputError` where SOURCE_DATE_EPOCH is no time.
        """
        from vfplan import __version__

        named = settings if isinstance(settings, dict) else asdict(settings)
        flat = {k: _plain(v) for k, v in named.items() if v is not None}
        return cls(now_utc(), f"vfplan {__version__}", inputs, flat)


def _plain(value: Any) -> str | float | int | bool:
    if not isinstance(value, (tuple, list)):
        return value
    nested = any(isinstance(v, (tuple, list)) for v in value)
    return (";" if nested else ",").join(str(_plain(v)) for v in value)
