"""What a tracker's latency, rate and noise cost: the table of docs/moving.md.

    .venv/bin/python docs/make_moving.py

Each motion is seen by each tracker, and the frame that a loop of 1 kHz makes of it is held against
the motion: the RMS distance, and the largest step of the force at K = 1000 N/m, as `MovingFrame`
goes and as a pose that is held until the next one comes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import vfplan

T = 1e-3
K = 1000.0
SECONDS = 20.0

# The place [m] over the time [s] of each motion.
MOTIONS = {
    "breathing, ±5 mm at 0.25 Hz": lambda t: 5e-3 * np.sin(2 * np.pi * 0.25 * t),
    "table, 20 mm in 2 s": lambda t: 20e-3 * np.clip((t - 5) / 2, 0, 1),
    "bump, 3 mm in 0.1 s": lambda t: 1.5e-3 * (1 + np.tanh((t - 10) / 0.025)),
    "still": lambda t: 0.0 * t,
}


@dataclass(frozen=True)
class Tracker:
    """What a tracker measures, and how late."""

    rate_hz: float
    latency_s: float
    noise_m: float
    missing_share: float = 0.0


TRACKERS = {
    "100 Hz, 10 ms, 0.1 mm": Tracker(100, 0.010, 0.1e-3),
    "60 Hz, 30 ms, 0.25 mm": Tracker(60, 0.030, 0.25e-3),
    "60 Hz, 30 ms, 0.25 mm, 1 in 5 missing": Tracker(60, 0.030, 0.25e-3, 0.2),
    "20 Hz, 50 ms, 0.25 mm": Tracker(20, 0.050, 0.25e-3),
}


def follow(motion, tracker, rng):
    """(T,) places [m]: of the frame, of a pose that is held until the next one, of the motion."""
    times = T * np.arange(int(SECONDS / T))
    stamps = np.arange(0, SECONDS, 1 / tracker.rate_hz)
    measured = motion(stamps) + rng.normal(0, tracker.noise_m, len(stamps))
    arrives = rng.random(len(stamps)) >= tracker.missing_share
    stamps = stamps[arrives]
    measured = measured[arrives]
    frame = vfplan.MovingFrame()
    frame_places = np.zeros(len(times))
    held_places = np.zeros(len(times))
    pose = np.eye(4)
    n = 0
    for k, t in enumerate(times):
        while n < len(stamps) and stamps[n] + tracker.latency_s <= t:
            pose[0, 3] = measured[n]
            frame.pose(stamps[n], pose)
            n += 1
        frame_places[k] = frame.at(t)[0, 3]
        held_places[k] = pose[0, 3]
    return frame_places, held_places, motion(times)


def largest_force_step(places):
    """The largest step of the force [N] from one tick to the next."""
    return K * np.abs(np.diff(places)).max()


def main() -> None:
    """Print the table."""
    rng = np.random.default_rng(18)
    print(
        "| motion | tracker | RMS error [mm] | largest error [mm] | step [N] | step if held [N] |"
    )
    print("|---|---|---|---|---|---|")
    for name, motion in MOTIONS.items():
        for tracker_name, tracker in TRACKERS.items():
            frame_places, held_places, true_places = follow(motion, tracker, rng)
            # The first second, in which the frame finds the motion, is left out.
            frame_places = frame_places[1000:]
            held_places = held_places[1000:]
            error_mm = 1e3 * np.abs(frame_places - true_places[1000:])
            print(
                f"| {name} | {tracker_name} | {np.sqrt(np.mean(error_mm**2)):.2f} | "
                f"{error_mm.max():.2f} | {largest_force_step(frame_places):.2f} | "
                f"{largest_force_step(held_places):.2f} |"
            )


if __name__ == "__main__":
    main()
