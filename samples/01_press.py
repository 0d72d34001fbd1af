"""Press a tip onto three points; beside it in C++: 01_press.cpp."""

import sys

import vfplan

points = [[0, 0, 0], [0.0005, 0, 0], [0.001, 0, 0]]  # [m]
try:
    engine = vfplan.ProxyEngine(points, stiffness=800)  # [N/m]
except vfplan.VfplanError as error:
    print(error, file=sys.stderr)
    sys.exit(error.exit_code)
for i in range(21):
    step = engine.step([0.0005, 0, 0.010 - 0.0005 * i])
print(f"proxy {1e3 * step.proxy[2]:.3f} mm, force {step.force[2]:.3f} N")
