// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Counts the loops over points that each state runs, by rules whose loops count themselves: the
// same code as shipped, with another table of loops. A line a rule, dimension, state and loop:
//
//     RULE DIMENSION STATE TICKS LOOP CALLS POINTS
#include <cstdio>
#include <cstring>

#include "scenes.hpp"
#include "vfplan/engine.hpp"

namespace {

constexpr int loops = 9;
constexpr const char* names[loops] = {"gather", "nearest2", "normal", "first", "distances",
                                      "out",    "meet",     "within", "patch"};
struct Count {
    long calls, points;
} counts[loops];

/// Loop number I of the real table, counted.
template <int I, int D, class R, class... A>
struct Counted {
    static inline R (*real)(const vfplan::PointSpan<D>&, A...) = nullptr;
    static R call(const vfplan::PointSpan<D>& in, A... a) {
        ++counts[I].calls;
        counts[I].points += static_cast<long>(in.n);
        return real(in, a...);
    }
};

template <int I, int D, class R, class... A>
void count(R (*&loop)(const vfplan::PointSpan<D>&, A...)) {
    Counted<I, D, R, A...>::real = loop;
    loop = Counted<I, D, R, A...>::call;
}

template <int D>
void count_all() {
    auto& k = vfplan::kernels<D>;
    count<0>(k.gather);
    count<1>(k.nearest2);
    count<2>(k.normal);
    count<3>(k.first_root_eq3);
    count<4>(k.distances);
    count<5>(k.last_root_eq7);
    count<6>(k.ray_hit);
    count<7>(k.indices_within);
    count<8>(k.accumulate_fit);
}

template <class RuleOf, class Space>
void play(const char* name, Space space, const scenes::Points& xyz, long length = 20000,
          const vfplan::Parameters& parameters = {}) {
    constexpr int D = Space::dimension;
    const auto cloud = vfplan::make_cloud(space, xyz.data(), xyz.size() / 3);
    auto rule = [&] {
        const vfplan::Parameters& p = parameters;
        if constexpr (std::is_same_v<RuleOf, vfplan::PaperRule<D>>)
            return RuleOf(cloud, p);
        else
            return RuleOf(p.R(), p.band, p.pace(), vfplan::Thinned<D>{cloud}, p);
    }();
    scenes::Path path(xyz);
    Count by_state[4][loops] = {};
    long ticks[4] = {};
    vfplan::Vec<D> proxy = space.project({{0.05, 0.05, 0.05}});
    for (long t = 0; t < length; ++t) {
        std::memset(counts, 0, sizeof counts);
        const auto tick = rule.step(proxy, space.project(path(t)));
        const int state = static_cast<int>(tick.state) + 1;
        ++ticks[state];
        for (int i = 0; i < loops; ++i) {
            by_state[state][i].calls += counts[i].calls;
            by_state[state][i].points += counts[i].points;
        }
    }
    for (int s = 0; s < 4; ++s)
        for (int i = 0; i < loops; ++i)
            std::printf("%s %d %d %ld %s %ld %ld\n", name, D, s - 1, ticks[s], names[i],
                        by_state[s][i].calls, by_state[s][i].points);
}

}  // namespace

int main() {
    vfplan::choose_kernels();
    count_all<2>();
    count_all<3>();
    const auto sheet = scenes::sheet(81, 5e-4), circle = scenes::circle(377, 0.03);
    const vfplan::Slice slice(vfplan::Vec3{{0, 0, 1}});
    play<vfplan::PaperRule<3>>("paper", vfplan::Space{}, sheet);
    play<vfplan::RobustRule<3>>("robust", vfplan::Space{}, sheet);
    vfplan::Parameters brute;
    brute.search = vfplan::Search::brute;
    play<vfplan::PaperRule<2>>("paper", slice, circle, 20000, brute);
    play<vfplan::RobustRule<2>>("robust", slice, circle, 20000, brute);
    // Points far apart, and a radius that covers millions of empty cells.
    vfplan::Parameters wide;
    wide.outer_radius = 5;
    const auto dust = scenes::dust(1000, 50);
    play<vfplan::RobustRule<3>>("wide", vfplan::Space{}, dust, 400, wide);
}
