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

/// The most features of a curve whose boxes lie within `reach` of any place, or some more: counted
/// on a grid, by what each box adds at its corners.
inline double crowd(const curve::Curve& curve, double reach) {
    Vec2 low = curve[0].least, high = curve[0].most;
    for (std::size_t i = 0; i < curve.size(); ++i)
        for (int k = 0; k < 2; ++k) {
            low.c[k] = std::min(low.c[k], curve[static_cast<int>(i)].least.c[k]);
            high.c[k] = std::max(high.c[k], curve[static_cast<int>(i)].most.c[k]);
        }
    double side = reach / 4;
    const auto count = [&](int k) { return std::floor((high.c[k] - low.c[k]) / side) + 1; };
    while (count(0) * count(1) > 8.0 * static_cast<double>(curve.size()) + 65536) side *= 1.25;
    const auto cell = [&](double place, int k) {
        const double most = count(k) - 1;
        const double at = std::floor((place - low.c[k]) / side);
        return static_cast<std::size_t>(std::min(std::max(at, 0.0), most));
    };
    const auto wide = static_cast<std::size_t>(count(0)) + 1;
    std::vector<double> sum(wide * (static_cast<std::size_t>(count(1)) + 1));
    for (std::size_t i = 0; i < curve.size(); ++i) {
        const curve::Feature& f = curve[static_cast<int>(i)];
        const std::size_t x0 = cell(f.least[0] - reach, 0), x1 = cell(f.most[0] + reach, 0) + 1;
        const std::size_t y0 = cell(f.least[1] - reach, 1), y1 = cell(f.most[1] + reach, 1) + 1;
        sum[y0 * wide + x0] += 1, sum[y1 * wide + x1] += 1;
        sum[y0 * wide + x1] -= 1, sum[y1 * wide + x0] -= 1;
    }
    for (std::size_t i = 1; i < sum.size(); ++i)
        if (i % wide != 0) sum[i] += sum[i - 1];
    for (std::size_t i = wide; i < sum.size(); ++i) sum[i] += sum[i - wide];
    return *std::max_element(sum.begin(), sum.end());
}

/// Time [s] that a tick of rule exact takes at most, by the features in its list; as above.
inline double tick_work(const std::vector<Stroke>& strokes, const Parameters& p) {
    constexpr double an_iteration = 7.5e-6, a_feature = 10e-9;  // [s]
    check(strokes);
    if (!p.ignore_axis) reject("rule exact needs an ignore_axis: it is planar");
    const curve::Curve curve(strokes, Slice(*p.ignore_axis), p.R());
    const double near = crowd(curve, curve::ExactRule::list_reach * p.R());
    return curve::ExactRule::most_iterations * (an_iteration + a_feature * near);
}

/// Likewise for a mesh: the most triangles that reach into a ball, counted by their middles.
inline double tick_work(const mesh::Surface& s, const Parameters& p) {
    using Rule = mesh::ExactRule;
    constexpr double an_iteration = 3e-6, a_triangle = 30e-9;  // [s]
    mesh::check(s);
    std::vector<double> middles(3 * s.k);
    double size = 0;
    for (std::size_t i = 0; i < s.k; ++i) {
        Vec3 corner[3], middle;
        for (std::size_t j = 0; j < 3; ++j) {
            const double* c = s.points + 3 * static_cast<std::size_t>(s.triangles[3 * i + j]);
            corner[j] = {{c[0], c[1], c[2]}};
            middle = middle + (1.0 / 3) * corner[j];
        }
        for (const Vec3& c : corner) size = std::max(size, norm(c - middle));
        std::copy_n(middle.c, 3, &middles[3 * i]);
    }
    const auto cloud = make_cloud(Space{}, middles.data(), s.k);
    return Rule::most_iterations *
           (an_iteration + a_triangle * crowd(cloud, Rule::list_reach * p.R() + size));
}

/// The most tick_work [s] that a loop of 1 kHz is given.
inline constexpr double most_tick_work = 0.3e-3;

}  // namespace vfplan
