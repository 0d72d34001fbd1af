// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// An engine at one point, whose band is told to the compiler; all headers of a controller.

#include "vfplan/engine.hpp"
#include "vfplan/governor.hpp"
#include "vfplan/guide.hpp"
#include "vfplan/telemetry.hpp"

int main() {
    const double point[3] = {0, 0, 0};
    vfplan::Parameters p;
    p.band = BAND;
    return vfplan::Engine(point, 1, p).planar();
}
