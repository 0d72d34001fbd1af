"""What a tracker's latency, rate and noise cost: the table of docs/moving.md.

    .venv/bin/python docs/make_moving.py

Each motion is seen by each tracker, and the frame that a loop of 1 kHz makes of it is held against
the motion: the RMS distance, and the largest step of the force at K = 1000 N/m, as `MovingFrame`
goes and as a pose that is held until the next one comes.
"""

from __future__ import annotations

import numpy as np

import vfplan

T = 1e-3
K = 1000.0
SECONDS = 20.0

MOTIONS = {  # name -> metres at t [s]
    "breathing, ±5 mm at 0.25 Hz": lambda t: 5e-3 * np.sin(2 * np.pi * 0.25 * t),
    "table, 20 mm in 2 s": lambda t: 20e-3 * np.clip((t - 5) / 2, 0, 1),
    "bump, 3 mm in 0.1 s": lambda t: 1.5e-3 * (1 + np.tanh((t - 10) / 0.025)),
    "still": lambda t: 0.0 * t,
}
TRACKERS = {  # name -> rate [Hz], latency [s], noise [m], part that is missing
    "100 Hz, 10 ms, 0.1 mm": (100, 0.010, 0.1e-3, 0.0),
    "60 Hz, 30 ms, 0.25 mm": (60, 0.030, 0.25e-3, 0.0),
    "60 Hz, 30 ms, 0.25 mm, 1 in 5 missing": (60, 0.030, 0.25e-3, 0.2),
    "20 Hz, 50 ms, 0.25 mm": (20, 0.050, 0.25e-3, 0.0),
}


def followed(motion, tracker, draw):
    """The frame (T,) [m] as it goes, as poses that are held, and the motion."""
    rate, latency, noise, missing = tracker
    times = T * np.arange(int(SECONDS / T))
    stamps = np.arange(0, SECONDS, 1 / rate)
    seen = motion(stamps) + draw.normal(0, noise, len(stamps))
    kept = draw.random(len(stamps)) >= missing
    stamps, seen = stamps[kept], seen[kept]
    frame, pose, n = vfplan.MovingFrame(), np.eye(4), 0
    went, held = np.zeros((2, len(times)))
    for k, t in enumerate(times):
        while n < len(stamps) and stamps[n] + latency <= t:
            pose[0, 3] = seen[n]
            frame.pose(stamps[n], pose)
            n += 1
        went[k], held[k] = frame.at(t)[0, 3], pose[0, 3]
    return went, held, motion(times)


def main() -> None:
    """Print the table."""
    draw = np.random.default_rng(18)
    print("| motion | tracker | RMS error [mm] | largest [mm] | step [N a tick] | if held [N] |")
    print("|---|---|---|---|---|---|")
    for name, motion in MOTIONS.items():
        for seen_by, tracker in TRACKERS.items():
            went, held, true = (rows[1000:] for rows in followed(motion, tracker, draw))
            apart = 1e3 * np.abs(went - true)
            error = f"{np.sqrt(np.mean(apart**2)):.2f} | {apart.max():.2f}"
            steps = [K * np.abs(np.diff(rows)).max() for rows in (went, held)]
            print(f"| {name} | {seen_by} | {error} | {steps[0]:.2f} | {steps[1]:.2f} |")


if __name__ == "__main__":
    main()
