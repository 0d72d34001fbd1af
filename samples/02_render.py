"""Load a fixture and press onto the middle of its curve; beside it in C++: 02_render.cpp."""

import sys

import vfplan

fixture = vfplan.read_fixture(sys.argv[1])
engine = vfplan.ProxyEngine.of(fixture)
middle = fixture.points[len(fixture.points) // 2]
for i in range(100):
    step = engine.step([middle[0], middle[1] + 0.02 - 0.0002 * i, middle[2]])
print("{:.6f} {:.6f} {:.6f} N".format(*step.force))
