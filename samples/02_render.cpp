// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Load a fixture and press onto the middle of its curve; beside it in Python: 02_render.py.
#include <cstdio>
#include <exception>

#include "vfplan/bundle/engine.hpp"

int main(int argc, char** argv) try {
    if (argc != 2) {
        std::fprintf(stderr, "usage: 02_render FIXTURE.h5\n");
        return 2;
    }
    const auto fixture = vfplan::bundle::read_fixture(argv[1]);
    vfplan::Engine engine(fixture);
    const double* middle = &fixture.points[3 * (fixture.size() / 2)];
    vfplan::Step s;
    for (int i = 0; i < 100; ++i)
        s = engine.step({{middle[0], middle[1] + 0.02 - 0.0002 * i, middle[2]}});
    std::printf("%.6f %.6f %.6f N\n", s.force[0], s.force[1], s.force[2]);
} catch (const vfplan::bundle::BundleError& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return error.kind() == "InputError" ? 3 : 4;  // the exit codes of docs/controller.md
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 3;
}
