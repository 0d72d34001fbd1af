// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   moving_clock      what MovingFrame says of a bad clock of the loop
//
// Prints a line for each case: how many of the 99 ticks after the first were stale. The engine is a
// spring to the fixture's origin, so every force is known.
#include <cstdio>
#include <limits>

#include "vfplan/moving.hpp"

namespace {

using vfplan::Vec3;

struct Spring {
    vfplan::Step step(const Vec3& hip) noexcept {
        vfplan::Step s;
        s.force = -1.0 * hip;
        return s;
    }
};

/// Ticks k = 1..99 at the times clock(k), with or without a pose every 10 ticks on the good clock.
template <class Clock>
void ticks(const char* name, bool has_poses, double pose_offset, Clock&& clock) {
    vfplan::MovingFrame frame;
    Spring spring;
    const Vec3 hip{{1e-3, 2e-3, 3e-3}};
    frame.pose(100, {});
    int stale = (frame.step(spring, 100, hip).status & vfplan::Status::stale_pose) != 0 ? 1000 : 0;
    for (int k = 1; k < 100; ++k) {
        if (has_poses && k % 10 == 0) frame.pose(pose_offset + 1e-3 * k, {});
        const vfplan::Step s = frame.step(spring, clock(k), hip);
        stale += (s.status & vfplan::Status::stale_pose) != 0;
        for (std::size_t i = 0; i < 3; ++i)
            if (s.force[i] != -hip[i]) stale += 1000;
    }
    std::printf("%s, %s: %d\n", name, has_poses ? "poses" : "no poses", stale);
}

}  // namespace

int main() {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const double infinite = std::numeric_limits<double>::infinity();
    for (const bool has_poses : {false, true}) {
        ticks("good", has_poses, 100, [](int k) { return 100 + 1e-3 * k; });
        ticks("stuck", has_poses, 100, [](int) { return 100.0; });
        ticks("not a number", has_poses, 100, [&](int) { return nan; });
        ticks("infinite", has_poses, 100, [&](int) { return infinite; });
        ticks("back 100 s", has_poses, 100, [](int k) { return 1e-3 * k; });
        ticks("back 100 s with its tracker", has_poses, 0, [](int k) { return 1e-3 * k; });
        ticks("one tick back", has_poses, 100,
              [](int k) { return 100 + 1e-3 * (k == 50 ? 48 : k); });
        ticks("one tick not a number", has_poses, 100,
              [&](int k) { return k == 50 ? infinite : 100 + 1e-3 * k; });
    }
}
