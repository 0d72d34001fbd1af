// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   governor_ticks TICKS
//
// TICKS ticks of forces that creep, leap, turn round and are no numbers, with an arm that moves,
// and jumps now and then: no force and no torque may change by more than it is told to, none may
// exceed its limit, none may be other than finite, and no memory is taken. Prints the largest of
// each, as parts of the limits, and the time of a step [ns]; exit status 1 names the first failure.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "allocations.hpp"
#include "vfplan/governor.hpp"

namespace {

constexpr int joints = 7;

[[noreturn]] void fail(const char* what, long tick, double value) {
    std::printf("%s at tick %ld: %g\n", what, tick, value);
    std::exit(1);
}

struct Worst {
    double force_step = 0, force = 0, torque_step = 0, torque = 0;
    long held = 0;
};

/// Creeps, leaps, goes, or turns round; now and then it is no number.
vfplan::Vec3 next(vfplan::Vec3& force, std::mt19937_64& draw, long tick) {
    std::normal_distribution<double> normal;
    const long kind = tick % 400;
    for (int k = 0; k < 3; ++k) {
        if (kind < 300) force[k] += 0.05 * normal(draw);
        if (kind == 300) force[k] = 15 * normal(draw);
        if (kind == 340) force[k] = 0;
        if (kind == 370) force[k] = -force[k] + 8 * normal(draw);
    }
    vfplan::Vec3 sent = force;
    if (tick % 997 == 996) sent[tick % 3] = tick % 2 ? std::nan("") : -1e308;
    return sent;
}

/// A Jacobian of an arm of 0.8 m that swings slowly, and is elsewhere after every 5000 ticks.
void swing(long tick, double* jacobian) {
    for (int i = 0; i < 3 * joints; ++i) {
        const double phase = 0.7 * i + 3.0 * double(tick / 5000);
        jacobian[i] = 0.8 * std::sin(phase + 1e-3 * double(tick));
    }
}

Worst play(bool turns, long ticks, double& ns) {
    vfplan::GovernorLimits limits;
    limits.force_step = 0.4;
    if (turns)
        for (int j = 0; j < joints; ++j) {
            limits.torque_step[j] = 0.3;
            limits.torque_max[j] = j < 4 ? 9 : 6;
        }
    vfplan::Governor governor(limits);
    std::mt19937_64 draw(7);
    Worst worst;
    vfplan::Vec3 before{}, walk{};
    double torque[joints] = {}, jacobian[3 * joints];
    for (long t = 0; t < ticks; ++t) {
        const vfplan::Vec3 force = next(walk, draw, t);
        swing(t, jacobian);
        if (t % 1499 == 1498) jacobian[t % 21] = std::numeric_limits<double>::infinity();
        const long had = allocations;
        const auto began = std::chrono::steady_clock::now();
        const vfplan::Governed g =
            turns ? governor.step(force, jacobian, joints) : governor.step(force);
        ns += std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - began)
                  .count();
        if (allocations != had) fail("allocation", t, double(allocations));
        const double step = norm(g.force - before), size = norm(g.force);
        if (!(step <= limits.force_step)) fail("force step", t, step);
        if (!(size <= limits.force_max)) fail("force", t, size);
        worst.force_step = std::max(worst.force_step, step / limits.force_step);
        worst.force = std::max(worst.force, size / limits.force_max);
        for (int j = 0; turns && j < joints; ++j) {
            const double now = governor.torque()[j], change = std::abs(now - torque[j]);
            if (!(change <= limits.torque_step[j])) fail("torque step", t, change);
            if (!(std::abs(now) <= limits.torque_max[j])) fail("torque", t, now);
            worst.torque_step = std::max(worst.torque_step, change / limits.torque_step[j]);
            worst.torque = std::max(worst.torque, std::abs(now) / limits.torque_max[j]);
            torque[j] = now;
        }
        const bool sent = (g.status & (vfplan::GovernorStatus::bad_force |
                                       vfplan::GovernorStatus::bad_jacobian)) == 0;
        const bool whole = sent && !(g.held_back > 0);
        if (whole && !(g.force == force)) fail("changed, and nothing said", t, g.held_back);
        worst.held += g.held_back > 0;
        before = g.force;
    }
    return worst;
}

}  // namespace

int main(int argc, char** argv) {
    const long ticks = argc > 1 ? std::atol(argv[1]) : 200'000;
    for (const bool turns : {false, true}) {
        double ns = 0;
        const Worst worst = play(turns, ticks, ns);
        std::printf(
            "%s force_step %.9f force %.9f torque_step %.9f torque %.9f held %ld step_ns %.0f\n",
            turns ? "torques" : "forces", worst.force_step, worst.force, worst.torque_step,
            worst.torque, worst.held, ns / double(ticks));
    }
}
