"""Let a force go, and see the governor give it back slowly; beside it in C++: 03_govern.cpp."""

import sys

import vfplan

# The force may change by 0.5 N from one tick to the next.
try:
    governor = vfplan.Governor(force_step_n=0.5, force_max_n=10, stiffness_n_per_m=1000, mass_kg=1)
except vfplan.VfplanError as error:
    print(error, file=sys.stderr)
    sys.exit(error.exit_code)
for _ in range(20):
    governor.step([0, 0, 5])
for _ in range(3):
    force = governor.step([0, 0, 0])
    print(f"{force[2]:.3f} N, {governor.held_back_n:.3f} N held back")
