// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What the grid and the list around the proxy hand out, against a look at every point: along paths
// that slide, jump and stand, for radii from a micrometre to a kilometre. All points in reach must
// be among them, none twice; exit status 1 names the first failure. A line a scene and radius:
//
//     SCENE DIMENSION RADIUS POINTS most stretches of memory, most points, of any one question
#include <cstdio>
#include <cstdlib>

#include "scenes.hpp"
#include "vfplan/base/vec.hpp"
#include "vfplan/cloud/grid.hpp"

namespace {

template <int D>
long within(const vfplan::PointSpan<D>& s, const vfplan::Vec<D>& x, double reach) {
    long n = 0;
    for (std::size_t i = 0; i < s.n; ++i) {
        double d2 = 0;
        for (int k = 0; k < D; ++k) d2 += (s.c[k][i] - x.c[k]) * (s.c[k][i] - x.c[k]);
        n += d2 <= reach * reach;
    }
    return n;
}

struct Most {
    std::size_t spans = 0, points = 0;
};

/// Asks `search` for what lies within `reach` of x.
template <class Search, int D>
void ask(Search& search, const vfplan::Cloud<D>& cloud, const vfplan::Vec<D>& x, double reach,
         const std::string& scene, Most& most) {
    long found = 0;
    Most now;
    search.visit(x, reach, [&](const vfplan::PointSpan<D>& s) noexcept {
        found += within(s, x, reach);
        ++now.spans;
        now.points += s.n;
    });
    const long there = within(cloud.span(0, cloud.size()), x, reach);
    if (found != there) {
        std::printf("%s: %ld of %ld points within %g m\n", scene.c_str(), found, there, reach);
        std::exit(1);
    }
    most.spans = std::max(most.spans, now.spans);
    most.points = std::max(most.points, now.points);
}

template <class Space>
void play(const scenes::Scene& scene, Space space) {
    constexpr int D = Space::dimension;
    const auto cloud = vfplan::make_cloud(space, scene.points.data(), scene.points.size() / 3);
    const double radius = 6e-3, skin = 1e-3;
    vfplan::Neighbours<D> near(cloud, radius, skin, 2e-3, vfplan::Search::grid);
    scenes::Random random{5};
    scenes::Path path(scene.points);
    Most most;
    for (long t = 0; t < 4000; ++t) {
        const auto x = space.project(path(t));
        if (t % 1000 == 999) near.forget();
        for (int i = 0; i < 3; ++i) ask(near, cloud, x, random(0, radius + skin), scene.name, most);
    }
    for (double reach = 1e-6; reach < 2e3; reach *= 10) {
        most = {};
        for (long t = 0; t < 40; ++t)
            ask(near.index(), cloud, space.project(path(50 * t)), reach, scene.name, most);
        std::printf("%-27s %d %g %zu %zu %zu\n", scene.name.c_str(), D, reach, cloud.size(),
                    most.spans, most.points);
    }
}

}  // namespace

int main() {
    auto list = scenes::all();
    list.push_back({"sparse", scenes::dust(1000, 50), false, 0});
    list.push_back({"sparse, planar", scenes::dust(1000, 50), true, 0});
    for (const auto& scene : list)
        if (scene.planar)
            play(scene, vfplan::Slice(vfplan::Vec3{{0, 0, 1}}));
        else
            play(scene, vfplan::Space{});
}
