// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// How much a tick may have to look at: a bound that a cloud, or a curve, and its rendering give
// before the first tick.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "vfplan/cloud.hpp"
#include "vfplan/curve/exact.hpp"
#include "vfplan/mesh/exact.hpp"
#include "vfplan/neighbours.hpp"
#include "vfplan/parameters.hpp"
#include "vfplan/space.hpp"
#include "vfplan/surfaces.hpp"
#include "vfplan/tuned.hpp"

namespace vfplan {

/// How many points lie in each cell of a box around a cloud, or, once `spread`, in the cells
/// around it.
template <int D>
class Census {
  public:
    /// `side` of a cell [m]: more where the box would have many more cells than the cloud points.
    Census(const Cloud<D>& cloud, double side) : box_(cloud.box()), side_(side) {
        const double most = std::min(4194304.0, 8.0 * static_cast<double>(cloud.size()) + 1024);
        while (cells() > most) side_ *= 1.25;
        for (int k = 0; k < D; ++k) count_[k] = static_cast<std::size_t>(along(k)) + 1;
        held_.assign(static_cast<std::size_t>(cells()), 0);
        for (std::size_t i = 0; i < cloud.size(); ++i) ++held_[cell(cloud[i])];
    }

    /// Adds up, for each cell, what lies within `reach` of any place in it, and some around.
    void spread(double reach) {
        const auto around = static_cast<std::size_t>(std::ceil(reach / side_));
        std::vector<std::uint64_t> before;
        for (std::size_t k = 0, stride = 1; k < D; stride *= count_[k], ++k) {
            before.assign(count_[k] + 1, 0);
            for (std::size_t first = 0; first < held_.size(); ++first)
                if (first / stride % count_[k] == 0)
                    spread_row(&held_[first], stride, around, before);
        }
    }
    double most() const { return *std::max_element(held_.begin(), held_.end()); }

  private:
    double along(int k) const { return std::floor((box_.high[k] - box_.low[k]) / side_); }
    double cells() const {
        double product = 1;
        for (int k = 0; k < D; ++k) product *= along(k) + 1;
        return product;
    }
    std::size_t cell(const Vec<D>& p) const {
        std::size_t at = 0;
        for (int k = D; k-- > 0;) {
            const auto i = static_cast<std::size_t>((p[k] - box_.low[k]) / side_);
            at = at * count_[k] + std::min(i, count_[k] - 1);
        }
        return at;
    }
    static void spread_row(std::uint32_t* row, std::size_t stride, std::size_t around,
                           std::vector<std::uint64_t>& before) {
        const std::size_t n = before.size() - 1;
        for (std::size_t i = 0; i < n; ++i) before[i + 1] = before[i] + row[i * stride];
        for (std::size_t i = 0; i < n; ++i)
            row[i * stride] = static_cast<std::uint32_t>(before[std::min(i + around + 1, n)] -
                                                         before[i > around ? i - around : 0]);
    }

    Box<D> box_;
    double side_;
    std::size_t count_[D] = {};
    std::vector<std::uint32_t> held_;
};

/// The most points within `reach` of any place, or some more.
template <int D>
double crowd(const Cloud<D>& cloud, double reach) {
    constexpr double cells_a_reach = 4;
    Census<D> census(cloud, reach / cells_a_reach);
    census.spread(reach);
    return census.most();
}

/// Time [s] that a tick of the robust rule takes at most, by what it has to look at: in each
/// iteration the points in its list, and those that touch, one by one. The three times are those
/// of the machine of docs/engine.md; tests/engine/test_worst_tick.py holds random fixtures to it.
template <class S>
double tick_work(const S& space, const double* xyz, std::size_t n, const Parameters& p) {
    constexpr double an_iteration = 2.5e-6, a_point = 1e-9, a_contact = 8e-9;  // [s]
    constexpr double beside = 16;  // iterations: what a tick does beside them
    constexpr int D = S::dimension;
    const auto cloud = make_cloud(space, xyz, n);
    const Surfaces<D, AllPoints<D>> surfaces(kernels<D>(Width::automatic), p.R(), p.band);
    const double list = std::max((1 + tuned::brief) * p.R(), surfaces.reach());
    const double near = crowd(cloud, list + tuned::skin * p.R());
    // From R - band to the shell, on one surface: as far around the foot.
    const double inner = p.R() - p.band, outer = surfaces.shell();
    const double touching = crowd(cloud, std::sqrt(outer * outer - inner * inner));
    return (p.max_iterations + beside) * (an_iteration + a_point * near + a_contact * touching);
}

inline double tick_work(const double* xyz, std::size_t n, const Parameters& p) {
    check(p);
    if (p.ignore_axis) return tick_work(Slice(*p.ignore_axis), xyz, n, p);
    return tick_work(Space{}, xyz, n, p);
}

/// The most of these boxes that lie within `reach` of any place, or some more: counted on a grid,
/// by what each box adds at its corners.
template <int D>
double crowd(const std::vector<Box<D>>& boxes, double reach) {
    Box<D> all = boxes[0];
    for (const Box<D>& b : boxes)
        for (int k = 0; k < D; ++k) {
            all.low.c[k] = std::min(all.low.c[k], b.low.c[k]);
            all.high.c[k] = std::max(all.high.c[k], b.high.c[k]);
        }
    double side = reach / 4;
    const auto count = [&](int k) { return std::floor((all.high.c[k] - all.low.c[k]) / side) + 1; };
    const auto cells = [&] {
        double product = 1;
        for (int k = 0; k < D; ++k) product *= count(k);
        return product;
    };
    while (cells() > 8.0 * static_cast<double>(boxes.size()) + (D == 3 ? 1048576 : 65536))
        side *= 1.25;
    std::size_t stride[D + 1] = {1};
    for (int k = 0; k < D; ++k)
        stride[k + 1] = stride[k] * (static_cast<std::size_t>(count(k)) + 1);
    const auto cell = [&](double place, int k) {
        const double at = std::floor((place - all.low.c[k]) / side);
        return static_cast<std::size_t>(std::min(std::max(at, 0.0), count(k) - 1)) * stride[k];
    };
    std::vector<double> sum(stride[D]);
    for (const Box<D>& b : boxes)
        for (int corner = 0; corner < 1 << D; ++corner) {
            std::size_t at = 0;
            double sign = 1;
            for (int k = 0; k < D; ++k) {
                const bool high = corner >> k & 1;
                at += high ? cell(b.high.c[k] + reach, k) + stride[k] : cell(b.low.c[k] - reach, k);
                if (high) sign = -sign;
            }
            sum[at] += sign;
        }
    for (int k = 0; k < D; ++k)
        for (std::size_t i = stride[k]; i < sum.size(); ++i)
            if (i % stride[k + 1] >= stride[k]) sum[i] += sum[i - stride[k]];
    return *std::max_element(sum.begin(), sum.end());
}

/// Time [s] that a tick of rule exact takes at most, by the features in its list; as above.
inline double tick_work(const std::vector<Stroke>& strokes, const Parameters& p) {
    constexpr double an_iteration = 7.5e-6, a_feature = 10e-9;  // [s]
    check(strokes);
    if (!p.ignore_axis) reject("rule exact needs an ignore_axis: it is planar");
    const curve::Curve curve(strokes, Slice(*p.ignore_axis), p.R());
    std::vector<Box<2>> boxes;
    for (std::size_t i = 0; i < curve.size(); ++i)
        boxes.push_back({curve[static_cast<int>(i)].least, curve[static_cast<int>(i)].most});
    const double near = crowd(boxes, curve::ExactRule::list_reach * p.R());
    return curve::ExactRule::most_iterations * (an_iteration + a_feature * near);
}

/// Likewise for a mesh, by the triangles in its list.
inline double tick_work(const mesh::Surface& s, const Parameters& p) {
    constexpr double an_iteration = 3e-6, a_triangle = 30e-9;  // [s]
    mesh::check(s);
    std::vector<Box<3>> boxes;
    mesh::Coarse(s, mesh::ExactRule::tolerance * p.R())
        .each([&](const Vec3& a, const Vec3& b, const Vec3& c, const auto&) {
            Box<3> box;
            for (int k = 0; k < 3; ++k) {
                box.low.c[k] = std::min({a.c[k], b.c[k], c.c[k]});
                box.high.c[k] = std::max({a.c[k], b.c[k], c.c[k]});
            }
            boxes.push_back(box);
        });
    const double near = crowd(boxes, mesh::ExactRule::list_reach * p.R());
    return mesh::ExactRule::most_iterations * (an_iteration + a_triangle * near);
}

/// The most tick_work [s] that a loop of 1 kHz is given.
inline constexpr double most_tick_work = 0.3e-3;

/// Whether a mesh is rendered best by its triangles: nearer to the truth than by its points
/// (docs/make_mesh.py), if a tick is short enough.
inline bool by_triangles(const mesh::Surface& s, const Parameters& p) {
    return tick_work(s, p) <= most_tick_work;
}

}  // namespace vfplan
