// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Triangles in space, and what of them lies near: the place of each that is nearest to a point, and
// a tree of boxes above them.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "vfplan/base/bounds_tree.hpp"
#include "vfplan/cloud/points.hpp"

namespace vfplan::mesh {

// The same surface by fewer triangles. A mesh is refined until points alone hold the proxy back;
// for its triangles those in one plane need not be many.

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
            for (std::size_t v = s.n; v-- > 0;)
                more |= remove_corner(static_cast<std::uint32_t>(v));
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
    static constexpr std::size_t max_triangles_at_corner =
        64;  // triangles round a corner that is looked at

    Vec3 at(std::uint32_t v) const {
        const double* p = points_ + 3 * std::size_t{v};
        return {{p[0], p[1], p[2]}};
    }
    static bool has(const Face& t, std::uint32_t v) { return t[0] == v || t[1] == v || t[2] == v; }
    static Vec3 across(const Vec3& a, const Vec3& b, const Vec3& c) { return cross(b - a, c - a); }

    /// Moves v onto the neighbour that changes least, where that is next to nothing: along an edge
    /// between all but parallel planes, not across it.
    bool remove_corner(std::uint32_t v) {
        if (around_[v].empty() || around_[v].size() > max_triangles_at_corner) return false;
        double least = never;
        std::uint32_t onto = gone;
        for (const std::uint32_t i : around_[v])
            for (const std::uint32_t w : faces_[i])
                if (const double off = w == v ? never : plane_shift(v, w); off < least)
                    least = off, onto = w;
        return onto != gone && (merge_into(v, onto), true);
    }

    /// How far the planes of v's triangles are from those of before [m] if it moves onto w; `never`
    /// where that is beyond the tolerance, a side turns or areas are not filled as they were.
    double plane_shift(std::uint32_t v, std::uint32_t w) const {
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

    void merge_into(std::uint32_t v, std::uint32_t w) {
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

struct Triangle {
    Vec3 a, ab, ac;         ///< a corner, and the sides to the other two
    double aa, bb, cc = 0;  ///< |ab|², |ac|², ab·ac

    Triangle(const Vec3& p, const Vec3& q, const Vec3& r) noexcept
        : a(p), ab(q - p), ac(r - p), aa(dot(ab, ab)), bb(dot(ac, ac)), cc(dot(ab, ac)) {}

    /// The place nearest to y. One of no area is its sides.
    Vec3 nearest(const Vec3& y) const noexcept {
        const Vec3 w = y - a;
        const double p = dot(w, ab), q = dot(w, ac);
        const double s = bb * p - cc * q, t = aa * q - cc * p, area = aa * bb - cc * cc;
        if (s > 0 && t > 0 && s + t < area) return a + (s / area) * ab + (t / area) * ac;
        Vec3 best;
        double least = never;
        const auto side = [&](const Vec3& from, const Vec3& way, double along, double square) {
            const double share = along > 0 ? (along < square ? along / square : 1.0) : 0.0;
            const Vec3 at = from + share * way, off = y - at;
            if (const double d = dot(off, off); d < least) least = d, best = at;
        };
        side(a, ab, p, aa);
        side(a, ac, q, bb);
        side(a + ab, ac - ab, q - p + aa - cc, aa + bb - 2 * cc);
        return best;
    }
    double distance(const Vec3& y) const noexcept { return norm(y - nearest(y)); }

    /// How far it reaches along n.
    double extent_along(const Vec3& n) const noexcept {
        return dot(a, n) + std::max({dot(ab, n), dot(ac, n), 0.0});
    }
};

/// A round box: what lies in it is at most `wide` from the line through its middle along n, and at
/// most `high` from its middle along that.
struct Disc {
    Vec3 middle, n;
    double wide = 0, high = 0;

    double distance2(const Vec3& y) const noexcept {
        const Vec3 w = y - middle;
        const double up = dot(w, n), beside = std::sqrt(std::max(dot(w, w) - up * up, 0.0));
        const double over = std::max(std::abs(up) - high, 0.0), off = std::max(beside - wide, 0.0);
        return over * over + off * off;
    }
    double size() const noexcept { return std::sqrt(wide * wide + high * high); }
};

class Mesh {
  public:
    static constexpr std::uint32_t none = ~std::uint32_t{0};

    /// `tolerance` [m]: how far its places may merge_into where it has more triangles than it
    /// needs.
    Mesh(const Surface& s, double tolerance) {
        std::vector<Item> items;
        Coarse(s, tolerance).each([&](const auto&... corner) { items.emplace_back(corner...); });
        tree_.build(
            0, items.size(),
            [&](std::size_t first, std::size_t last) {
                const Extent e = extent(items, first, last);
                return disc(items, first, last, 0.5 * (e.low + e.high), along(e.up, 1));
            },
            [&](std::size_t first, std::size_t last) {
                sort_along_longest_side(items, first, last);
            });
        triangles_.reserve(items.size());
        faces_.reserve(items.size());
        for (const Item& i : items) {
            triangles_.emplace_back(i.corner[0], i.corner[1], i.corner[2]);
            faces_.push_back(i.rows);
        }
    }

    const Triangle& operator[](std::uint32_t i) const noexcept { return triangles_[i]; }
    /// The rows of its corners in the surface.
    const Coarse::Face& face(std::uint32_t i) const noexcept { return faces_[i]; }
    std::size_t size() const noexcept { return triangles_.size(); }
    std::size_t boxes() const noexcept { return tree_.size(); }
    std::size_t bytes() const noexcept {
        return triangles_.capacity() * (sizeof(Triangle) + sizeof(Coarse::Face)) + tree_.bytes();
    }

    /// Calls f(i) for every triangle in a disc that `is_near(disc)` says so of. Returns the inner
    /// steps that it took: one a disc, three a triangle.
    template <class IsNear, class F>
    int visit(IsNear&& is_near, F&& f) const noexcept {
        return tree_.visit(is_near, f);
    }
    /// ... for every one within `reach` of y, which may shrink, and some more.
    template <class F>
    int around(const Vec3& y, const double& reach, F&& f) const noexcept {
        return visit([&](const Disc& disc) noexcept { return disc.distance2(y) <= reach * reach; },
                     f);
    }

    /// The triangle nearest to y where that is nearer than `least` [m], which it then becomes.
    std::uint32_t nearest(const Vec3& y, double& least, int& steps) const noexcept {
        std::uint32_t found = none;
        steps = around(y, least, [&](std::uint32_t i) noexcept {
            if (const double d = triangles_[i].distance(y); d < least) least = d, found = i;
        });
        return found;
    }

  private:
    struct Item {
        std::array<Vec3, 3> corner;
        Vec3 middle;
        Coarse::Face rows;
        Item(const Vec3& a, const Vec3& b, const Vec3& c, const Coarse::Face& face)
            : corner{a, b, c}, middle((1.0 / 3) * (a + b + c)), rows(face) {}
    };
    /// Around `middle`, but for how high that is.
    static Disc disc(const std::vector<Item>& items, std::size_t first, std::size_t last,
                     const Vec3& middle, const Vec3& n) {
        double low = never, top = -never, wide2 = 0;
        for (std::size_t i = first; i < last; ++i)
            for (const Vec3& p : items[i].corner) {
                const Vec3 w = p - middle;
                const double up = dot(w, n);
                low = std::min(low, up), top = std::max(top, up);
                wide2 = std::max(wide2, dot(w, w) - up * up);
            }
        constexpr double more = 1 + 1e-9;  // roundings
        return {middle + (low + top) / 2 * n, n, more * std::sqrt(wide2), more * (top - low) / 2};
    }
    struct Extent {
        Vec3 low{{never, never, never}}, high{{-never, -never, -never}};
        Vec3 up;  // sum of the areas' normals
    };
    static Extent extent(const std::vector<Item>& items, std::size_t first, std::size_t last) {
        Extent e;
        for (std::size_t i = first; i < last; ++i) {
            const auto& [a, b, c] = items[i].corner;
            e.up = e.up + cross(b - a, c - a);
            for (const Vec3& p : items[i].corner) {
                for (int k = 0; k < 3; ++k) {
                    e.low.c[k] = std::min(e.low.c[k], p.c[k]);
                    e.high.c[k] = std::max(e.high.c[k], p.c[k]);
                }
            }
        }
        return e;
    }
    /// Sorts the items along the longest side of their box, in an order that no library chooses.
    static void sort_along_longest_side(std::vector<Item>& items, std::size_t first,
                                        std::size_t last) {
        const Extent e = extent(items, first, last);
        const Vec3 size = e.high - e.low;
        int k = size[1] > size[0] ? 1 : 0;
        if (size[2] > size[k]) k = 2;
        const auto begin = items.begin();
        std::stable_sort(begin + static_cast<std::ptrdiff_t>(first),
                         begin + static_cast<std::ptrdiff_t>(last),
                         [k](const Item& a, const Item& b) { return a.middle[k] < b.middle[k]; });
    }

    std::vector<Triangle> triangles_;
    std::vector<Coarse::Face> faces_;
    BoundsTree<Disc> tree_;
};

}  // namespace vfplan::mesh
