"""The controller core as Python objects: parameters, engine, guide, governor and moving frame.

parameters  `ProxyParameters`, the paper's Table I, and the checks of what an engine is made of
answers     `Status`, `Step` and `Trace`, which every engine answers with
choosing    which rule renders a fixture, and whether its ticks are short enough for 1 kHz
proxy       `ProxyEngine`, the native engine
guide       `Guide`, which keeps the tip in a tube around the drawn curve
governor    `Governor`, which holds force and torques to what an arm accepts
moving      `MovingFrame`, the frame of a tracked fixture
"""

from __future__ import annotations
