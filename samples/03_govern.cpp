// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Let a force go, and see the governor give it back slowly; beside it in Python: 03_govern.py.
#include <cstdio>
#include <exception>

#include "vfplan/governor.hpp"

int main() try {
    vfplan::GovernorLimits limits;
    limits.force_step = 0.5;  // [N] a tick
    limits.force_max = 10;    // [N]
    vfplan::Governor governor(limits);
    for (int i = 0; i < 20; ++i) governor.step({{0, 0, 5}});
    for (int i = 0; i < 3; ++i) {
        const vfplan::Governed g = governor.step({{0, 0, 0}});
        std::printf("%.3f N, %.3f N held back\n", g.force[2], g.held_back);
    }
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;  // a setting out of range
}
