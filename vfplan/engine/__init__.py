"""The haptic engine's Python side: what it accepts, its parameters, and the call into C++.

parameters  the paper's Table I, and the checks of what an engine is made of
ticks       what a tick takes, and what every engine answers with
renderable  whether an engine takes what a fixture holds
proxy       `ProxyEngine`, the face over the native engine
moving      `MovingFrame`, the frame of a tracked fixture
guide       `Guide`, the drawn curve as a ruler, over the native guide
"""
