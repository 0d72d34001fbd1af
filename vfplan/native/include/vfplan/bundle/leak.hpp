// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The leak certificate (docs/format.md, section 5): the part that every reader computes again.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "vfplan/bundle/content.hpp"
#include "vfplan/bundle/finding.hpp"
#include "vfplan/bundle/text.hpp"

namespace vfplan::bundle::detail {

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

/// "the fixture leaks ...", with the size of the opening and its place.
inline std::string leaking(const Content& content) {
    const std::vector<double>& place = content.at("/leak/place").f8;
    const bool curve = content.at("/leak@kind").string() == "curve";
    return std::string("the fixture leaks between samples: ") +
           (curve ? "gap between neighbours" : "covering radius of a triangle") + " of " +
           rounded(content.number("/leak@largest_m")) + " m at (" + rounded(place[0]) + ", " +
           rounded(place[1]) + ", " + rounded(place[2]) + "); at most " +
           rounded(content.number("/leak@limit_m")) + " m holds the proxy back";
}

inline void compare(const Content& content, std::string_view path, double wanted,
                    Findings& findings) {
    const Value* found = content.find(path);
    findings.require(
        found != nullptr && std::abs(found->number() - wanted) <= 1e-9 * std::max(wanted, 1e-3),
        "corrupt.leak", path,
        "is " + (found == nullptr ? "absent" : shown(found->number())) + "; the fixture gives " +
            shown(wanted));
}

/// Compares largest_m and limit_m; whether the fixture, of this kind, holds its proxy back.
inline bool holds_back(const Content& content, bool mesh, Findings& findings) {
    const double reach = content.number("/rendering@contact_radius_m") +
                         content.number("/rendering@point_radius_m") -
                         content.number("/rendering@band_m");
    compare(content, "/leak@limit_m", mesh ? reach : 2 * reach, findings);
    compare(content, "/leak@largest_m", mesh ? largest_cover(content) : largest_gap(content),
            findings);
    const bool holds = content.number("/leak@largest_m") <= content.number("/leak@limit_m");
    if (!holds) findings.error("unsafe.leak", "/leak", leaking(content));
    return holds;
}

inline void check_leak(const Content& content, Findings& findings) {
    findings.require(content.has_group("/rendering") == content.has_group("/leak"), "corrupt.leak",
                     "/leak", "must be there if and only if /rendering is");
    const std::string& found = content.at("/leak@kind").string();
    const bool mesh = content.has("/mesh/triangles"), curve = content.has("/curve/stroke");
    const std::string kind = mesh ? "mesh" : curve ? "curve" : "cloud";
    if (found != kind) {
        return findings.error("corrupt.leak", "/leak@kind",
                              "is " + in_quotes(found) + "; " + in_quotes(kind) + " wanted");
    }
    bool holds = false;
    if (kind != "cloud") {
        holds = holds_back(content, mesh, findings);
    } else {
        findings.require(!content.has("/leak@limit_m"), "corrupt.leak", "/leak@limit_m",
                         "must be absent of a cloud");
    }
    const bool says = content.at("/leak@certified").u1.front() != 0;
    findings.require(says == holds, "corrupt.leak", "/leak@certified",
                     "is " + std::to_string(says) + "; " + std::to_string(holds) + " wanted");
}

}  // namespace vfplan::bundle::detail
