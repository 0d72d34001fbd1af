// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The leak certificate (docs/format.md, section 5): the part that every reader computes again, as
// vfplan/bundle/check.py does.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "vfplan/hdf5/content.hpp"
#include "vfplan/hdf5/error.hpp"

namespace vfplan::hdf5::detail {

using Point = std::array<double, 3>;

/// Distances between a fixture's points, across the ignored axis if there is one.
class Across {
  public:
    explicit Across(const Content& content) : points_(content.at("/points").f8) {
        if (const Value* axis = content.find("/rendering/ignore_axis")) {
            std::copy_n(axis->f8.begin(), 3, axis_.begin());
        }
    }
    [[nodiscard]] double distance(std::size_t i, std::size_t j) const {
        const Point d{points_[3 * i] - points_[3 * j], points_[3 * i + 1] - points_[3 * j + 1],
                      points_[3 * i + 2] - points_[3 * j + 2]};
        const double along = d[0] * axis_[0] + d[1] * axis_[1] + d[2] * axis_[2];
        double sum = 0;
        for (std::size_t k = 0; k < 3; ++k) sum += std::pow(d[k] - along * axis_[k], 2);
        return std::sqrt(sum);
    }

  private:
    const std::vector<double>& points_;
    Point axis_{0, 0, 0};
};

/// The widest gap between neighbours along the strokes, closed ones too [m].
inline double largest_gap(const Content& content) {
    const Across across(content);
    const std::vector<std::int32_t>& stroke = content.at("/curve/stroke").i4;
    const std::vector<std::uint8_t>& closed = content.at("/curve/closed").u1;
    double largest = 0;
    std::size_t first = 0;
    for (std::size_t i = 1; i <= stroke.size(); ++i) {
        if (i < stroke.size() && stroke[i] == stroke[i - 1]) {
            largest = std::max(largest, across.distance(i, i - 1));
            continue;
        }
        if (closed[static_cast<std::size_t>(stroke[i - 1])] != 0) {
            largest = std::max(largest, across.distance(first, i - 1));
        }
        first = i;
    }
    return largest;
}

/// The largest distance of a point in a triangle of these sides to its nearest corner.
inline double covering_radius(std::array<double, 3> sides) {
    std::sort(sides.begin(), sides.end());
    const auto [a, b, c] = sides;
    if (c == 0) return 0;
    if (a * a + b * b <= c * c) return b * b * c / (b * b + c * c - a * a);
    const double product = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c));
    return a * b * c / std::sqrt(std::max(product, 0.0));
}

inline double largest_cover(const Content& content) {
    const Across across(content);
    const std::vector<std::int32_t>& t = content.at("/mesh/triangles").i4;
    double largest = 0;
    for (std::size_t i = 0; i + 2 < t.size(); i += 3) {
        const auto corner = [&](std::size_t k) { return static_cast<std::size_t>(t[i + k]); };
        largest = std::max(largest, covering_radius({across.distance(corner(0), corner(1)),
                                                     across.distance(corner(1), corner(2)),
                                                     across.distance(corner(2), corner(0))}));
    }
    return largest;
}

inline void compare(const Content& content, std::string_view path, double wanted) {
    const Value* found = content.find(path);
    if (found == nullptr || std::abs(found->number() - wanted) > 1e-9 * std::max(wanted, 1e-3)) {
        refuse("corrupt.leak", path, "differs from what the fixture gives");
    }
}

inline void check_leak(const Content& content) {
    if (content.has_group("/rendering") != content.has_group("/leak")) {
        refuse("corrupt.leak", "/leak", "must be there if and only if /rendering is");
    }
    if (!content.has_group("/leak")) return;
    const bool mesh = content.has("/mesh/triangles"), curve = content.has("/curve/stroke");
    const std::string kind = mesh ? "mesh" : curve ? "curve" : "cloud";
    if (content.at("/leak@kind").string() != kind) {
        refuse("corrupt.leak", "/leak@kind", kind + " wanted");
    }
    const bool says = content.at("/leak@certified").u1.front() != 0;
    bool holds = false;
    if (kind == "cloud") {
        if (content.has("/leak@limit_m")) refuse("corrupt.leak", "/leak@limit_m", "must be absent");
    } else {
        const double reach = content.at("/rendering@contact_radius_m").number() +
                             content.at("/rendering@point_radius_m").number() -
                             content.at("/rendering@band_m").number();
        compare(content, "/leak@limit_m", mesh ? reach : 2 * reach);
        compare(content, "/leak@largest_m", mesh ? largest_cover(content) : largest_gap(content));
        holds = content.at("/leak@largest_m").number() <= content.at("/leak@limit_m").number();
        if (!holds) refuse("unsafe.leak", "/leak", "the fixture leaks between samples");
    }
    if (says != holds) refuse("corrupt.leak", "/leak@certified", "says otherwise");
}

}  // namespace vfplan::hdf5::detail
