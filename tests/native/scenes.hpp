// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Clouds and HIP paths for the native tests, all from one small generator with a fixed seed.
#pragma once

#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "vfplan/engine.hpp"

namespace scenes {

using Points = std::vector<double>;  // x y z of each in turn

struct Random {
    std::uint64_t state;
    double operator()(double low, double high) {
        state = state * 6364136223846793005ull + 1442695040888963407ull;
        return low + (high - low) * static_cast<double>(state >> 11) * 0x1p-53;
    }
};

inline void add(Points& p, double x, double y, double z) { p.insert(p.end(), {x, y, z}); }

/// Square sheet in the plane z = 0 with n × n points.
inline Points sheet(int n, double h) {
    Points p;
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) add(p, (i - n / 2) * h, (j - n / 2) * h, 0);
    return p;
}

inline Points corner(int n, double h) {
    Points p;
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            add(p, i * h, j * h, 0);
            add(p, 0, i * h, j * h);
            add(p, i * h, 0, j * h);
        }
    return p;
}

inline Points double_sheet(int n, double h, double gap) {
    Points p = sheet(n, h), q = p;
    for (std::size_t i = 2; i < q.size(); i += 3) q[i] += gap;
    p.insert(p.end(), q.begin(), q.end());
    return p;
}

inline Points dust(int n, double half) {
    Random r{7};
    Points p;
    for (int i = 0; i < n; ++i) {  // one after the other: arguments have no order of their own
        const double z = r(-half, half), y = r(-half, half), x = r(-half, half);
        add(p, x, y, z);
    }
    return p;
}

inline Points circle(int n, double radius) {
    Points p;
    for (int i = 0; i < n; ++i) {
        const double t = 2 * 3.141592653589793 * i / n;
        add(p, radius * std::cos(t), radius * std::sin(t), 0);
    }
    return p;
}

/// Samples of a curve, close together; an arc as its chord where it is short, else as two arcs.
inline void trace(Points& p, double ax, double ay, double bx, double by, double bulge) {
    const double dx = bx - ax, dy = by - ay;
    if (std::hypot(dx, dy) < 2e-4) return add(p, ax, ay, 0);
    const double mx = (ax + bx + bulge * dy) / 2, my = (ay + by - bulge * dx) / 2;
    const double half = bulge / (1 + std::sqrt(1 + bulge * bulge));
    trace(p, ax, ay, mx, my, half);
    trace(p, mx, my, bx, by, half);
}

struct Scene {
    std::string name;
    Points points;
    bool planar;
    double point_radius;
    std::vector<vfplan::Stroke> strokes = {};  // that the points sample, where it is a curve
    std::vector<std::int32_t> triangles = {};  // of the points, where it is a mesh

    vfplan::Parameters parameters(vfplan::Rule rule) const {
        vfplan::Parameters p;
        p.max_hip_step = 0;  // these paths leap
        p.rule = rule;
        p.point_radius = point_radius;
        p.band = rule == vfplan::Rule::paper ? 1e-5 : 2e-5;
        if (planar) p.ignore_axis = vfplan::Vec3{{0, 0, 1}};
        return p;
    }

    vfplan::Engine engine(const vfplan::Parameters& p) const {
        if (!triangles.empty())
            return {{points.data(), points.size() / 3, triangles.data(), triangles.size() / 3}, p};
        if (p.rule == vfplan::Rule::exact) return {strokes, p};
        return {points.data(), points.size() / 3, p};
    }
};

/// Triangles: an open sheet with bumps, a saddle, a box, a corner, some that go through each other.
inline std::vector<Scene> meshes() {
    Scene bumps{"bumps, mesh", sheet(13, 4e-3), false, 0}, box{"box, mesh", {}, false, 0};
    for (int i = 0; i < 169; ++i) {
        bumps.points[static_cast<std::size_t>(3 * i + 2)] = 5e-4 * (i * i % 7);
        if (const int a = i, b = i + 1; i % 13 < 12 && i < 156)
            bumps.triangles.insert(bumps.triangles.end(), {a, b, a + 13, b, b + 13, a + 13});
    }
    Scene saddle{"saddle, mesh", bumps.points, false, 0, {}, bumps.triangles};
    for (std::size_t i = 0; i < saddle.points.size(); i += 3) {
        const double x = saddle.points[i], y = saddle.points[i + 1];
        saddle.points[i + 2] = 20 * (x * x - y * y);
    }
    for (int i = 0; i < 8; ++i)
        add(box.points, i & 1 ? 0.02 : -0.02, i & 2 ? 0.01 : -0.01, i & 4 ? 0.015 : -0.015);
    box.triangles = {0, 1, 3, 0, 3, 2, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4,
                     2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 3, 7, 1, 7, 5};
    const Scene walls{
        "three walls, mesh",        {0, 0, 0, 0.04, 0, 0, 0, 0.04, 0, 0, 0, 0.04}, false, 0, {},
        {0, 1, 2, 0, 2, 3, 0, 3, 1}};
    Scene heap{"heap, mesh", dust(60, 0.02), false, 2e-3};
    for (int i = 0; i < 60; ++i) heap.triangles.push_back(i);
    return {bumps, saddle, box, walls, heap};
}

inline Scene drawn(const char* name, std::vector<vfplan::Stroke> strokes) {
    Points p;
    for (const vfplan::Stroke& s : strokes) {
        const std::size_t n = s.bulges.size();
        for (std::size_t i = 0, j; i + (s.closed ? 0 : 1) < n; ++i) {
            j = (i + 1) % n;
            trace(p, s.vertices[3 * i], s.vertices[3 * i + 1], s.vertices[3 * j],
                  s.vertices[3 * j + 1], s.bulges[i]);
        }
        add(p, s.vertices[3 * n - 3], s.vertices[3 * n - 2], 0);
    }
    return {name, p, true, 0, std::move(strokes)};
}

/// Lines and arcs: a hollow, bends tighter than the proxy, cusps, a T, a crossing, a dot.
inline std::vector<Scene> curves() {
    const vfplan::Stroke ring{{-0.02, 0, 0, 0.02, 0, 0}, {1, 1}, true};
    const vfplan::Stroke cup{{-0.006, 0.02, 0, -0.006, 0, 0, 0.006, 0, 0, 0.006, 0.02, 0},
                             {0, 1, 0, 0}};
    const vfplan::Stroke zigzag{{0, 0, 0, 0.02, 2e-3, 0, 0, 4e-3, 0, 0.02, 9e-3, 0, 0.03, 0, 0},
                                {0.4, 0, -0.7, 0.1, 0}};
    const vfplan::Stroke line{{-0.03, -0.01, 0, 0.03, -0.01, 0}, {0, 0}};
    const vfplan::Stroke stem{{0, -0.01, 0, 0.004, 0.02, 0}, {0.2, 0}};
    const vfplan::Stroke across{{-0.02, -0.02, 0, 0.02, 0.01, 0}, {0, 0}};
    const vfplan::Stroke dot{{0.01, 0.012, 0}, {0}};
    return {drawn("ring", {ring}), drawn("cup", {cup}), drawn("zigzag", {zigzag}),
            drawn("T, crossing and dot", {line, stem, across, dot})};
}

inline std::vector<Scene> all() {
    Points twice = dust(300, 0.02);
    twice.insert(twice.end(), twice.begin(), twice.end());
    return {
        {"sheet", sheet(81, 5e-4), false, 0},
        {"coarse sheet, thick points", sheet(31, 2e-3), false, 6e-3},
        {"three walls", corner(50, 5e-4), false, 0},
        {"double sheet", double_sheet(61, 5e-4, 6e-3), false, 0},
        {"dust", dust(3000, 0.05), false, 0},
        {"dense dust", dust(3000, 0.01), false, 0},
        {"duplicates", twice, false, 1e-3},
        {"one point", {0, 0, 0}, false, 0},
        {"circle, planar", circle(377, 0.03), true, 0},
        {"dust, planar", dust(200, 0.05), true, 2e-3},
        {"kilometre", {0, 0, 0, 1000, 0, 0, 0, 1000, 0, 0, 0, 1e-3}, false, 0},
    };
}

/// A path of pieces: pressing and sliding, jumps, lifting, standing still, hitting points exactly.
class Path {
  public:
    explicit Path(const Points& points) : points_(points) {}

    vfplan::Vec3 operator()(long tick) {
        if (tick % 200 == 0) {
            kind_ = static_cast<int>(random_(0, 6));
            goal_ = near(0.012);
            if (kind_ == 3) at_ = near(0.3);
            if (kind_ == 4) at_ = near(0);
        }
        const double share = kind_ == 0 ? 0.02 : kind_ == 1 ? 0.3 : 0;
        for (int k = 0; k < 3; ++k) at_[k] += share * (goal_[k] - at_[k]);
        if (kind_ == 5) at_[static_cast<std::size_t>(tick % 3)] += 1e-4;
        return at_;
    }

  private:
    vfplan::Vec3 near(double around) {
        const auto i =
            static_cast<std::size_t>(random_(0, static_cast<double>(points_.size() / 3)));
        vfplan::Vec3 p;
        for (std::size_t k = 0; k < 3; ++k) p[k] = points_[3 * i + k] + random_(-around, around);
        return p;
    }

    const Points& points_;
    Random random_{42};
    vfplan::Vec3 at_{{0.05, 0.05, 0.05}}, goal_;
    int kind_ = 0;
};

}  // namespace scenes
