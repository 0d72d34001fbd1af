// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Press a tip onto three points; beside it in Python: 01_press.py.
#include <cstdio>
#include <exception>

#include "vfplan/cloud/band.hpp"
#include "vfplan/engine.hpp"

int main() try {
    const double points[] = {0, 0, 0, 0.0005, 0, 0, 0.001, 0, 0};  // x y z of each [m]
    vfplan::Parameters p;
    p.stiffness = {{800, 800, 800}};  // [N/m]
    p.band = vfplan::band_for(points, 3, p);
    vfplan::Engine engine(points, 3, p);
    vfplan::Step s;
    for (int i = 0; i <= 20; ++i) s = engine.step({{0.0005, 0, 0.010 - 0.0005 * i}});
    std::printf("proxy %.3f mm, force %.3f N\n", 1e3 * s.proxy[2], s.force[2]);
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;  // a setting out of range
}
