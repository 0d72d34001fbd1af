// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The same surface by fewer triangles. A mesh is refined until points alone hold the proxy back;
// for its triangles those in one plane need not be many.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "vfplan/cloud.hpp"

namespace vfplan::mesh {

inline constexpr double never = std::numeric_limits<double>::infinity();

/// A mesh as it is handed to the engine: three rows of points a triangle.
struct Surface {
    const double* points = nullptr;  ///< x y z of each in turn [m]
    std::size_t n = 0;
    const std::int32_t* triangles = nullptr;
    std::size_t k = 0;
};

/// Throws std::invalid_argument on a surface that no engine takes.
inline void check(const Surface& s) {
    if (s.k == 0) reject("a mesh needs at least one triangle");
    for (std::size_t i = 0; i < 3 * s.n; ++i)
        if (!(std::abs(s.points[i]) <= largest_coordinate)) reject("points must be within 1e6 m");
    for (std::size_t i = 0; i < 3 * s.k; ++i)
        if (s.triangles[i] < 0 || static_cast<std::size_t>(s.triangles[i]) >= s.n)
            reject("triangles name points that are not there");
}

/// Takes corners away, the last first, where the triangles around one lie in planes that those left
/// fill as they were: each time none is moved by more than `tolerance` [m].
class Coarse {
  public:
    using Face = std::array<std::uint32_t, 3>;

    Coarse(const Surface& s, double tolerance) : points_(s.points), tolerance_(tolerance) {
        faces_.resize(s.k);
        around_.resize(s.n);
        for (std::size_t i = 0; i < s.k; ++i)
            for (std::size_t j = 0; j < 3; ++j) {
                faces_[i][j] = static_cast<std::uint32_t>(s.triangles[3 * i + j]);
                around_[faces_[i][j]].push_back(static_cast<std::uint32_t>(i));
            }
        for (bool more = true; more;) {
            more = false;
            for (std::size_t v = s.n; v-- > 0;) more |= drop(static_cast<std::uint32_t>(v));
        }
    }

    /// Calls f(a, b, c, rows) with the corners of each triangle that is left.
    template <class F>
    void each(F&& f) const {
        for (const Face& t : faces_)
            if (t[0] != gone) f(at(t[0]), at(t[1]), at(t[2]), t);
    }

  private:
    static constexpr std::uint32_t gone = ~std::uint32_t{0};
    static constexpr std::size_t crowd = 64;  // triangles round a corner that is looked at

    Vec3 at(std::uint32_t v) const {
        const double* p = points_ + 3 * std::size_t{v};
        return {{p[0], p[1], p[2]}};
    }
    static bool has(const Face& t, std::uint32_t v) { return t[0] == v || t[1] == v || t[2] == v; }
    static Vec3 across(const Vec3& a, const Vec3& b, const Vec3& c) { return cross(b - a, c - a); }

    /// Moves v onto the neighbour that changes least, where that is next to nothing: along an edge
    /// between all but parallel planes, not across it.
    bool drop(std::uint32_t v) {
        if (around_[v].empty() || around_[v].size() > crowd) return false;
        double least = never;
        std::uint32_t onto = gone;
        for (const std::uint32_t i : around_[v])
            for (const std::uint32_t w : faces_[i])
                if (const double off = w == v ? never : change(v, w); off < least)
                    least = off, onto = w;
        return onto != gone && (move(v, onto), true);
    }

    /// How far the planes of v's triangles are from those of before [m] if it moves onto w; `never`
    /// where that is beyond the tolerance, a side turns or areas are not filled as they were.
    double change(std::uint32_t v, std::uint32_t w) const {
        double before = 0, after = 0, least = never, most = 0;
        for (const std::uint32_t i : around_[v]) {
            const Face& t = faces_[i];
            const Vec3 was = across(at(t[0]), at(t[1]), at(t[2]));
            before += norm(was);
            if (has(t, w)) {
                least = std::min(least, norm(was));
                continue;
            }
            const auto to = [&](std::uint32_t c) { return at(c == v ? w : c); };
            const Vec3 is = across(to(t[0]), to(t[1]), to(t[2]));
            const double area = norm(is);
            const double off = std::abs(dot(is, at(v) - at(w)));
            if (!(dot(is, was) > 0) || !(off <= tolerance_ * area)) return never;
            most = std::max(most, off / area);
            after += area;
        }
        const bool filled = std::abs(before - after) <= std::min(1e-9 * before, least / 2);
        return least > 1e-9 * before && filled ? most : never;
    }

    void move(std::uint32_t v, std::uint32_t w) {
        for (const std::uint32_t i : around_[v]) {
            Face& t = faces_[i];
            if (has(t, w)) {
                for (const std::uint32_t c : t)
                    if (c != v) std::erase(around_[c], i);
                t[0] = gone;
            } else {
                std::replace(t.begin(), t.end(), v, w);
                around_[w].push_back(i);
            }
        }
        around_[v].clear();
    }

    const double* points_;
    double tolerance_;
    std::vector<Face> faces_;
    std::vector<std::vector<std::uint32_t>> around_;  // each corner's triangles
};

}  // namespace vfplan::mesh
