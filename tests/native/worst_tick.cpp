// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   worst_tick TICKS REPEATS BUNDLE...
//
// Processor time of the worst tick of a loop with each bundle: a tick's is the least of its
// repeats, for what else the machine does is not the engine's. A line a bundle and rule: the bound
// of tick_time.hpp, the worst tick, and the worst one within 50 ticks of an exchange, in us.
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <fstream>
#include <string>
#include <vector>

#include "scenes.hpp"
#include "vfplan/bundle/engine.hpp"

namespace {

constexpr double fastest_m = 0.003;  // that HIP moves in a tick: the 3 m/s of the fastest arm here

constexpr long every_exchange = 8;  // of the episodes begins with one

double now_us() {
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

/// A HIP that is led about the points of a fixture: the first half of the ticks as scenes::Path
/// goes, the second half by episodes of 50 ticks, each anew from a place that may be inside, or in
/// the fixture moved by up to R.
class Hips {
  public:
    Hips(const vfplan::bundle::Fixture& f, double radius, long ticks)
        : points_(f.points), radius_(radius), half_(ticks / 2), path_(f.points), hip_(path_(0)) {}

    /// The HIP of a tick; `is_start`: whether the engine is put there first.
    vfplan::Vec3 operator()(long tick, bool& is_start) {
        is_start = tick >= half_ && tick % 50 == 0;
        if (is_start) {
            place_ = static_cast<std::size_t>(random_(0, static_cast<double>(points_.size() / 3)));
            hip_ = around(random_(0, 4));
        }
        if (tick < half_)
            goal_ = path_(tick);
        else if (tick % 10 == 0)
            goal_ = around(2);
        const vfplan::Vec3 way = goal_ - hip_;
        hip_ = hip_ + fastest_m / std::max(norm(way), fastest_m) * way;
        return hip_;
    }

  private:
    vfplan::Vec3 around(double reach) {
        vfplan::Vec3 x;
        for (std::size_t k = 0; k < 3; ++k)
            x[k] = points_[3 * place_ + k] + radius_ * random_(-reach, reach);
        return x;
    }

    const std::vector<double>& points_;
    double radius_;
    long half_;
    scenes::Path path_;
    scenes::Random random_{7};
    std::size_t place_ = 0;
    vfplan::Vec3 hip_, goal_;
};

/// Reads each page of memory that the program may write. A loop whose memory is locked waits for
/// none; a virtual machine maps one more when it is read first after it was written.
void touch_memory() {
    std::ifstream maps("/proc/self/maps");
    for (std::string line; std::getline(maps, line);) {
        unsigned long from, to;
        char rights[5];
        const int found = std::sscanf(line.c_str(), "%lx-%lx %4s", &from, &to, rights);
        if (found != 3 || rights[0] != 'r' || rights[1] != 'w') continue;
        for (; from < to; from += 4096) *reinterpret_cast<const volatile char*>(from);
    }
}

/// The engine of the fixture, moved.
vfplan::Engine moved(vfplan::bundle::Fixture f, const vfplan::Parameters& p,
                     const vfplan::Vec3& by) {
    const auto move = [&](std::vector<double>& xyz) {
        for (std::size_t i = 0; i < xyz.size(); ++i) xyz[i] += by[i % 3];
    };
    move(f.points);
    for (vfplan::Stroke& stroke : f.pieces) move(stroke.vertices);
    return vfplan::Engine(f, p.rule, vfplan::Use::replay);
}

/// The worst tick, and the worst one after an exchange [us].
std::array<double, 2> worst_us(const vfplan::bundle::Fixture& f, const vfplan::Parameters& p,
                               long ticks, int repeats) {
    std::vector<double> least(static_cast<std::size_t>(ticks), 1e300);
    for (int k = 0; k < repeats; ++k) {
        vfplan::Engine engine(f, p.rule, vfplan::Use::replay);
        Hips hips(f, p.R(), ticks);
        scenes::Random random{11};
        for (double& us : least) {
            bool is_start;
            const vfplan::Vec3 hip = hips(&us - least.data(), is_start);
            const long episode = (&us - least.data()) / 50;
            if (is_start && episode % every_exchange == 0) {
                const auto by = [&] { return p.R() * random(-1, 1); };
                engine.exchange(moved(f, p, {by(), by(), by()}));
                touch_memory();
            } else if (is_start) {
                engine.reset(hip);
            }
            const double began = now_us();
            engine.step(hip);
            us = std::min(us, now_us() - began);
        }
    }
    std::array<double, 2> worst{};
    for (long tick = 0; tick < ticks; ++tick) {
        const bool is_exchanged = tick >= ticks / 2 && tick / 50 % every_exchange == 0;
        double& most = worst[is_exchanged];
        most = std::max(most, least[static_cast<std::size_t>(tick)]);
    }
    return worst;
}

double bound(const vfplan::bundle::Fixture& f, const vfplan::Parameters& p) {
    if (p.rule != vfplan::Rule::exact) return vfplan::tick_time_bound(f.points.data(), f.size(), p);
    if (f.mesh.empty()) return vfplan::tick_time_bound(f.pieces, p);
    return vfplan::tick_time_bound(f.surface(), p);
}

void measure(const char* name, long ticks, int repeats) {
    const auto f = vfplan::bundle::read_fixture(name);
    for (const auto rule : {vfplan::Rule::robust, vfplan::Rule::paper, vfplan::Rule::exact}) {
        if (rule == vfplan::Rule::exact && f.pieces.empty() && f.mesh.empty()) continue;
        try {
            const auto p = vfplan::bundle::parameters(f, rule);
            const auto [worst, exchanged] = worst_us(f, p, ticks, repeats);
            std::printf("%s rule %d bound %.1f worst %.1f exchanged %.1f\n", name,
                        static_cast<int>(rule), 1e6 * bound(f, p), worst, exchanged);
        } catch (const std::exception& error) {
            std::printf("%s rule %d refused: %s\n", name, static_cast<int>(rule), error.what());
        }
    }
}

}  // namespace

int main(int argc, char** argv) {
    for (int k = 3; k < argc; ++k) measure(argv[k], std::atol(argv[1]), std::atoi(argv[2]));
}
