// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// All that a C++ user writes.
#include <cstdio>

#include "vfplan/engine.hpp"

int main() {
    const double points[] = {0, 0, 0, 0.0005, 0, 0, 0.001, 0, 0};  // x y z of each [m]
    vfplan::Parameters p;
    p.stiffness = {{800, 800, 800}};
    vfplan::Engine engine(points, 3, p);
    for (int i = 0; i <= 20; ++i) {
        const vfplan::Step s = engine.step({{0.0005, 0, 0.010 - 0.0005 * i}});
        if (i == 20) std::printf("%.3f %.3f\n", 1e3 * s.proxy[2], s.force[2]);
    }
}
