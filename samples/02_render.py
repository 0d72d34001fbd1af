"""Load a fixture and press onto the middle of its curve; beside it in C++: 02_render.cpp."""

import sys

import vfplan

if len(sys.argv) != 2:
    print("usage: 02_render.py FIXTURE.h5", file=sys.stderr)
    sys.exit(2)
try:
    fixture = vfplan.read_fixture(sys.argv[1])
    engine = vfplan.ProxyEngine.of(fixture)
except vfplan.VfplanError as error:
    print(error, file=sys.stderr)
    sys.exit(error.exit_code)
middle = fixture.points[len(fixture.points) // 2]
for i in range(100):
    step = engine.step([middle[0], middle[1] + 0.02 - 0.0002 * i, middle[2]])
print("{:.6f} {:.6f} {:.6f} N".format(*step.force))
