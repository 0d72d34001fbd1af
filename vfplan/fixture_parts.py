"""What a bundle records beside its points: slice, rendering, guidance, registration, verdict."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Frame = Literal["image", "robot_base", "patient_lps"]


@dataclass(frozen=True)
class SourceImage:
    """The slice a curve was drawn on.

    Parameters
    ----------
    width_px, height_px
        Size of the image [px].
    pixel_spacing_mm
        (along u, along v) [mm/px]; `None` when nobody knows.
    """

    width_px: int
    height_px: int
    pixel_spacing_mm: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Rendering:
    """How the robot shall render the fixture (the paper's Table I).

    Parameters
    ----------
    stiffness
        (3,) K along the axes of the frame [N/m].
    contact_radius
        r_c [m].
    band
        r2 - r_c = r_c - r1 [m].
    point_radius
        r_v [m]; 0 for bare points.
    ignore_axis
        (3,) unit vector along which the fixture is infinite and renders no force; `None` in 3-D.
    max_iterations
        The most iterations of a tick; `None`: the engine's own limit.
    """

    stiffness: NDArray[np.float64]
    contact_radius: float
    band: float
    point_radius: float = 0.0
    ignore_axis: NDArray[np.float64] | None = None
    max_iterations: int | None = None


@dataclass(frozen=True)
class Guidance:
    """Strokes that guide: the tip is kept within a tube around them.

    Parameters
    ----------
    radius
        ρ of the tube [m].
    stiffness
        K beyond it [N/m].
    ends
        What the ends of an open stroke do: "stop" (a cap) or "open" (the tip goes free).
    stroke
        The one stroke that guides, the others are a forbidden region; `None`: every stroke guides,
        and nothing is forbidden.
    lead_force, lead_speed
        Pull along the curve [N], towards its beginning when negative, and the speed [m/s] at which
        it has fallen to 0; `None`: no pull, 0.02 m/s.
    """

    radius: float
    stiffness: float
    ends: Literal["stop", "open"] = "stop"
    stroke: int | None = None
    lead_force: float | None = None
    lead_speed: float | None = None


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
class Review:
    """That a person looked at the plan and approved it.

    It dies with any change: whoever makes another fixture of this one leaves it out.

    Parameters
    ----------
    by
        Who.
    utc
        When, as "2026-01-31T12:00:00Z".
    digest
        SHA-256 of what was shown, lower-case hex.
    """

    by: str
    utc: str
    digest: str


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
