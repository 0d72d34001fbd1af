// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   worst_tick TICKS REPEATS BUNDLE...
//
// Processor time of the worst tick of a loop with each bundle: a tick's is the least of its
// repeats, for what else the machine does is not the engine's. HIP goes where scenes::Path goes, at
// up to 3 m/s. A line a bundle and rule: the bound on its work and the worst tick, in us, or
// "refused" where no engine for a robot is made of it.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <vector>

#include "scenes.hpp"
#include "vfplan/bundle/engine.hpp"

namespace {

constexpr double fastest_m = 0.003;  // that HIP moves in a tick: the 3 m/s of the fastest arm here

double now_us() {
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

double worst_us(const vfplan::bundle::Fixture& f, vfplan::Rule rule, long ticks, int repeats) {
    std::vector<double> least(static_cast<std::size_t>(ticks), 1e300);
    for (int k = 0; k < repeats; ++k) {
        vfplan::Engine engine(f, rule);
        scenes::Path path(f.points);
        vfplan::Vec3 hip = path(0);
        for (double& us : least) {
            const vfplan::Vec3 way = path(&us - least.data()) - hip;
            hip = hip + fastest_m / std::max(norm(way), fastest_m) * way;
            const double began = now_us();
            engine.step(hip);
            us = std::min(us, now_us() - began);
        }
    }
    return *std::max_element(least.begin(), least.end());
}

void measure(const char* name, long ticks, int repeats) {
    const auto f = vfplan::bundle::read_fixture(name);
    for (const auto rule : {vfplan::Rule::robust, vfplan::Rule::paper, vfplan::Rule::exact}) {
        if (rule == vfplan::Rule::exact && f.pieces.empty() && f.mesh.empty()) continue;
        try {
            const auto p = vfplan::bundle::parameters(f, rule);
            const double us = worst_us(f, rule, ticks, repeats);
            const double bound = rule == vfplan::Rule::exact
                                     ? f.mesh.empty()
                                           ? vfplan::tick_time_bound(f.pieces, p)
                                           : vfplan::tick_time_bound(vfplan::bundle::surface(f), p)
                                     : vfplan::tick_time_bound(f.points.data(), f.size(), p);
            std::printf("%s rule %d bound %.1f worst %.1f\n", name, static_cast<int>(rule),
                        1e6 * bound, us);
        } catch (const std::exception& error) {
            std::printf("%s rule %d refused: %s\n", name, static_cast<int>(rule), error.what());
        }
    }
}

}  // namespace

int main(int argc, char** argv) {
    for (int k = 3; k < argc; ++k) measure(argv[k], std::atol(argv[1]), std::atoi(argv[2]));
}
