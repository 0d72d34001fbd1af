// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   controller_ticks N    N ticks of a hand that presses, leaps, is lost and stands in millimetres,
//                         on a wall that moves, is exchanged and changes its stiffness
//
// No tick may allocate; no force may be NaN, exceed the governor's, or change by more than it lets;
// the proxy may never be inside unless the bit says so; and where the way is clear the force is
// gone within 0.1 s. Exit status 1 names the first failure.
#include <array>
#include <cstdio>
#include <cstdlib>

#include "allocations.hpp"
#include "scenes.hpp"
#include "vfplan/bundle/engine.hpp"
#include "vfplan/controller.hpp"

namespace {

using vfplan::Vec3;

[[noreturn]] void fail(const char* what, long tick, double value) {
    std::printf("%s at tick %ld: %.17g\n", what, tick, value);
    std::exit(1);
}

/// A wall across z, `up` along y.
vfplan::bundle::Fixture wall(double up, double stiffness, double radius) {
    vfplan::bundle::Fixture fixture;
    fixture.frame = "robot_base";
    for (int i = -200; i <= 200; ++i)
        fixture.points.insert(fixture.points.end(), {2.5e-4 * i, up, 0});
    fixture.rendering.emplace();
    fixture.rendering->stiffness = {stiffness, stiffness, stiffness};
    fixture.rendering->contact_radius = radius;
    fixture.rendering->band = 5e-5;
    fixture.rendering->ignore_axis = {0, 0, 1};
    return fixture;
}

}  // namespace

int main(int, char** argv) {
    const long ticks = std::atol(argv[1]);
    vfplan::ControllerSettings settings;
    settings.moving.emplace();
    settings.max_stiffness = 3000;
    settings.any_tick_time = true;
    vfplan::Controller controller(wall(0, 1000, 5e-3), {}, settings);
    scenes::Random random{7};
    Vec3 tip{{0, 12e-3, 0}}, last;
    double until = 0, way = 0, period = settings.governor.period;
    long clear = 0, stops = 0, bad = 0;
    for (long k = 0; k < ticks; ++k) {
        const double t = double(k) * period;
        if (k % 20 == 0)
            controller.pose(t, {{{1e-3 * std::sin(t), 1e-3 * std::cos(0.7 * t), 0}}, 1, {}});
        if (k % 977 == 0)
            controller.exchange(wall(random(-1e-3, 1e-3), random(1, 3000), random(3e-3, 7e-3)));
        if (k % 7919 == 0) controller.request_stop();
        if (k % 613 == 0) controller.set_stiffness(random(1, 3000));
        // Presses for some time, and then draws away.
        if (t > until) {
            until = t + random(0.02, 0.4);
            way = random(0, 1) < 0.4 ? 40e-3 : random(-4e-3, 8e-3);
        }
        tip[1] += std::clamp(way - tip[1], -4e-4, 4e-4);
        tip[0] = 30e-3 * std::sin(0.9 * t);
        std::array<double, 3> seen{tip[0], tip[1], tip[2]};
        const double luck = random(0, 1);
        if (luck < 1e-3)
            seen = {1e3 * tip[0], 1e3 * tip[1], 0};
        else if (luck < 2e-3)
            seen = {random(-1, 1), random(-1, 1), 0};
        else if (luck < 3e-3)
            seen[1] = std::nan("");
        const bool is_lost = luck < 3e-3 || (k / 5000) % 7 == 6;  // at times for long
        if ((k / 5000) % 7 == 6 && luck >= 3e-3) seen[0] = std::nan("");
        const Vec3 hip{{seen[0], seen[1], seen[2]}};
        const long had = allocations;
        const vfplan::Command out = controller.step(hip, t);
        // From a side that is free: a start inside may be led out on the other one.
        if (out.stop && !is_lost && tip[1] > 12e-3) controller.reset(tip);
        if (allocations != had) fail("allocation", k, double(allocations - had));
        if (!vfplan::is_within_range(out.force) || !vfplan::is_within_range(out.proxy))
            fail("no number", k, out.force[1]);
        if (norm(out.force) > settings.governor.force_max * (1 + 1e-9))
            fail("force", k, norm(out.force));
        if (norm(out.force - last) > settings.governor.force_step * (1 + 1e-9))
            fail("force step", k, norm(out.force - last));
        if (!(out.status &
              (vfplan::Status::inside | vfplan::Status::bad_hip | vfplan::Status::jumped))) {
            const Vec3 proxy = controller.frame()->now().in(out.proxy);
            const double room = controller.region()->distance(proxy) - controller.contact_radius();
            // What was handed over this tick is taken up in it.
            if (room < -6e-5) fail("inside", k, room);
        }
        // Away from a wall of at most 7 mm, and not on the way out of one that came over the tip.
        const bool is_free = !is_lost && tip[1] > 12e-3 && !(out.status & vfplan::Status::inside);
        clear = is_free ? clear + 1 : 0;
        if (clear > 100 && !(out.force == Vec3{})) fail("held in free space", k, norm(out.force));
        last = out.force;
        stops += out.stop;
        bad += is_lost;
    }
    std::printf("%ld ticks, %ld without a position, %ld stopped\n", ticks, bad, stops);
}
