"""The haptic engine's Python side: what it accepts, its parameters, and the call into C++.

checks      what an engine takes, checked once
spacing     how far the points of a cloud stand apart
parameters  the paper's Table I, and what every engine answers with
tolerance   one tolerance in, every setting out
renderable  whether an engine takes what a fixture holds
proxy       `ProxyEngine`, the face over the native engine
moving      `MovingFrame`, the frame of a tracked fixture
guide       `Guide`, the drawn curve as a ruler, over the native guide
"""
