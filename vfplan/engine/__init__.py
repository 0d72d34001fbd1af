"""The controller core as Python objects: parameters, engine, guide, governor and moving frame.

parameters  `ProxyParameters`, the paper's Table I, and the checks of what an engine is made of
proxy       `ProxyEngine`, what it answers, which rule renders a fixture, and whether its ticks are
            short enough for 1 kHz
guide       `Guide`, which keeps the tip in a tube around the drawn curve
governor    `Governor`, which holds force and torques to what an arm accepts
moving      `MovingFrame`, the frame of a tracked fixture
"""

from __future__ import annotations

# The band of Algorithm 1, r2 - r_c = r_c - r1 [m].
PAPER_BAND = 10e-6
