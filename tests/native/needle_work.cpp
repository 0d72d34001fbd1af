// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A line for each of many meshes of needles, and of some smooth bodies: the inner steps that a tick
// takes at most by tick_time_bound, and those of the worst of 2,000 ticks.
#include <cstdio>
#include <numeric>

#include "scenes.hpp"
#include "vfplan/tick_time.hpp"

namespace {

using vfplan::Vec3;

/// Needles of 50 mm, 10 um wide: parallel in space, side by side on a plane, in all directions,
/// nearly parallel, long around a cylinder, or in a flat heap.
std::vector<double> needles(int kind, int count, scenes::Random& random) {
    std::vector<double> corners;
    for (int i = 0; i < count; ++i) {
        const Vec3 anywhere{random(-0.1, 0.1), random(-0.1, 0.1), random(-0.1, 0.1)};
        const Vec3 any_way{random(-1, 1), random(-1, 1), random(-1, 1)};
        Vec3 from = anywhere, way{0.05, 0, 0};
        if (kind == 1) from[2] = 0;
        if (kind == 2) way = along(any_way, 0.05);
        if (kind == 3) way = way + 5e-4 * any_way;
        if (kind == 3) from[2] *= 0.1;
        if (kind == 4) from = 0.02 * along(Vec3{any_way[0], any_way[1], 0}, 1);
        if (kind == 4) way = {0, 0, 0.3};
        if (kind == 5) {
            from = {0.03 * anywhere[0], 0.03 * anywhere[1], 3e-5 * anywhere[2]};
            way = {0.06 * any_way[0], 0.06 * any_way[1], 6e-5 * any_way[2]};
        }
        const double thick = kind == 5 ? 1e-4 : 1e-5;
        const Vec3 aside{random(-thick, thick), random(-thick, thick), random(-thick, thick)};
        for (const Vec3& corner : {from, from + way, from + 0.5 * way + aside})
            corners.insert(corners.end(), corner.c, corner.c + 3);
    }
    return corners;
}

/// The numbers from 0 on: each triangle has corners of its own.
std::vector<std::int32_t> apart(std::size_t count) {
    std::vector<std::int32_t> rows(count);
    std::iota(rows.begin(), rows.end(), 0);
    return rows;
}

/// A wavy sheet of 40 mm, of 2 n² facets that stand for a smooth body: its corners.
std::vector<double> waves(int n) {
    std::vector<double> corners;
    for (int i = 0; i <= n; ++i)
        for (int j = 0; j <= n; ++j) {
            const double x = 0.04 * i / n - 0.02, y = 0.04 * j / n - 0.02;
            for (const double c : {x, y, 0.002 * std::sin(300 * x) * std::cos(300 * y)})
                corners.push_back(c);
        }
    return corners;
}
/// And its triangles.
std::vector<std::int32_t> facets(int n) {
    std::vector<std::int32_t> rows;
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            const int a = i * (n + 1) + j, b = a + n + 1;
            rows.insert(rows.end(), {a, b, a + 1, b, b + 1, a + 1});
        }
    return rows;
}

/// The HIP leaps about, `reach` from the middle at most [m].
void measure(const std::vector<double>& corners, const std::vector<std::int32_t>& rows,
             double reach, scenes::Random& random) {
    const vfplan::mesh::Surface surface{corners.data(), corners.size() / 3, rows.data(),
                                        rows.size() / 3};
    vfplan::Parameters p;
    const double bound = tick_time_bound(surface, p) / vfplan::mesh::MeshMotion::a_step;
    p.band = vfplan::exact_band(p, vfplan::largest_of(surface.points, surface.n));
    vfplan::mesh::Mesh mesh(surface);
    vfplan::mesh::SmoothBody body(mesh, p.R());
    const double rise = body.rise();
    p.band += rise;
    vfplan::mesh::MeshRule rule(p.R() - rise, p.band - rise, p.pace(), std::move(mesh),
                                std::move(body), p);
    Vec3 proxy{0.2, 0.2, 0.2}, hip = proxy, goal;
    std::int64_t worst = 0;
    for (int tick = 0; tick < 2000; ++tick) {
        if (tick % 100 == 0)
            goal = reach * Vec3{random(-1, 1), random(-0.8, 0.8), random(-0.8, 0.8)};
        const Vec3 way = goal - hip;
        hip = hip + (0.003 / std::max(norm(way), 0.003)) * way;
        const std::int64_t before = rule.motion().work();
        rule.step(proxy, hip);
        worst = std::max(worst, rule.motion().work() - before);
    }
    std::printf("%.0f %lld\n", bound, static_cast<long long>(worst));
}

}  // namespace

int main() {
    scenes::Random random{5};
    for (int kind = 0; kind < 5; ++kind)
        for (const int count : {300, 3000, 20000})
            measure(needles(kind, count, random), apart(3 * count), 0.15, random);
    for (const int count : {300, 900, 1100, 1200, 1240})
        measure(needles(5, count, random), apart(3 * count), 0.006, random);
    for (const int n : {20, 40, 80, 120}) measure(waves(n), facets(n), 0.015, random);
}
