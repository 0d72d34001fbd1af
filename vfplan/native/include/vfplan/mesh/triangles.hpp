// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Triangles in space: the place of each that is nearest to a point, and a tree of discs above them.
#pragma once

#include "vfplan/base/bounds_tree.hpp"
#include "vfplan/base/work.hpp"
#include "vfplan/mesh/surface.hpp"

namespace vfplan::inline v1::mesh {

/// The rows of a triangle's three corners in the surface.
using Face = std::array<std::uint32_t, 3>;

struct Triangle {
    Vec3 a, ab, ac;         ///< a corner, and the sides to the other two
    double aa, bb, cc = 0;  ///< |ab|², |ac|², ab·ac

    Triangle(const Vec3& p, const Vec3& q, const Vec3& r) noexcept
        : a(p), ab(q - p), ac(r - p), aa(dot(ab, ab)), bb(dot(ac, ac)), cc(dot(ab, ac)) {}

    /// The place of the triangle that is nearest to y. A triangle without area consists of its
    /// sides.
    Vec3 nearest(const Vec3& y) const noexcept {
        const Vec3 w = y - a;
        const double p = dot(w, ab), q = dot(w, ac);
        const double s = bb * p - cc * q, t = aa * q - cc * p, area = aa * bb - cc * cc;
        if (s > 0 && t > 0 && s + t < area) return a + (s / area) * ab + (t / area) * ac;
        Vec3 best;
        double nearest2 = infinity;
        const auto side = [&](const Vec3& from, const Vec3& way, double along, double square) {
            const double share = along > 0 ? (along < square ? along / square : 1.0) : 0.0;
            const Vec3 at = from + share * way, off = y - at;
            if (const double d = dot(off, off); d < nearest2) nearest2 = d, best = at;
        };
        side(a, ab, p, aa);
        side(a, ac, q, bb);
        side(a + ab, ac - ab, q - p + aa - cc, aa + bb - 2 * cc);
        return best;
    }
    double distance(const Vec3& y) const noexcept { return norm(y - nearest(y)); }

    /// The largest value of n . x over all places x of the triangle.
    double extent_along(const Vec3& n) const noexcept {
        return dot(a, n) + std::max({dot(ab, n), dot(ac, n), 0.0});
    }
};

/// A cylinder around triangles: flat where they lie side by side, as on a sheet.
struct Disc {
    Vec3 middle, n;   ///< n is the unit vector along its axis
    double wide = 0;  ///< its radius [m]
    double high = 0;  ///< half of its height [m]

    /// The square of the distance from y, 0 inside.
    double distance2(const Vec3& y) const noexcept {
        const Vec3 w = y - middle;
        const double up = dot(w, n), beside = std::sqrt(std::max(dot(w, w) - up * up, 0.0));
        const double over = std::max(std::abs(up) - high, 0.0), off = std::max(beside - wide, 0.0);
        return over * over + off * off;
    }
    Box<3> box() const noexcept {
        Vec3 half;
        for (int k = 0; k < 3; ++k)
            half.c[k] = high * std::abs(n[k]) + wide * std::sqrt(std::max(1 - n[k] * n[k], 0.0));
        return {middle - half, middle + half};
    }
    /// The radius of a ball around it [m].
    double size() const noexcept { return std::sqrt(wide * wide + high * high); }
};

/// The triangles of a surface in the order of a tree, whose bounds are discs.
class Mesh {
  public:
    static constexpr std::uint32_t none = ~std::uint32_t{0};

    explicit Mesh(const Surface& s) : faces_(s.k), corners_(s.n) {
        for (std::size_t i = 0; i < 3 * s.k; ++i)
            faces_[i / 3][i % 3] = static_cast<std::uint32_t>(s.triangles[i]);
        for (std::size_t row = 0; row < s.n; ++row) corners_[row] = point_at(s.points, row);
        tree_.build(
            0, s.k, [this](auto first, auto last) { return disc(first, last); },
            [this](auto first, auto last) { sort_along_longest_side(first, last); });
        triangles_.reserve(s.k);
        for (const auto& [a, b, c] : faces_)
            triangles_.emplace_back(corners_[a], corners_[b], corners_[c]);
    }

    const Triangle& operator[](std::uint32_t i) const noexcept { return triangles_[i]; }
    /// The rows of its corners in the surface.
    const Face& face(std::uint32_t i) const noexcept { return faces_[i]; }
    std::size_t size() const noexcept { return triangles_.size(); }
    const BoundsTree<Disc>& tree() const noexcept { return tree_; }
    std::size_t bytes() const noexcept {
        return triangles_.capacity() * (sizeof(Triangle) + sizeof(Face)) +
               corners_.capacity() * sizeof(Vec3) + tree_.bytes();
    }

    /// The distance of y from the nearest triangle, or `reach` where that is less [m]; 0 where a
    /// budget has no steps left to know it.
    double distance(const Vec3& y, double reach = infinity,
                    WorkBudget* budget = nullptr) const noexcept {
        const auto look = [&](std::uint32_t i) noexcept {
            reach = std::min(reach, triangles_[i].distance(y));
        };
        tree_.visit_nearest(y, reach, look, budget);
        return budget && budget->is_spent() ? 0 : reach;
    }

    /// Goes on counting at a node of the tree, from 0 to its size, how often a closed surface winds
    /// around y: 0 outside, whichever way its triangles are turned. Returns its inner steps.
    int count_turns(const Vec3& y, std::uint32_t& node, int& turns) const noexcept {
        return tree_.visit_node(
            node,
            [&](const Disc& disc) noexcept {
                const Vec3 w = disc.middle - y;
                const double ahead = dot(w, ray) / dot(ray, ray);
                const Vec3 beside = w - std::max(ahead, 0.0) * ray;
                const double reach =
                    (1 + 1e-9) * disc.size() + 1e-14 * (norm(w) + norm(disc.middle));
                return dot(beside, beside) <= reach * reach;
            },
            [&](std::uint32_t i) noexcept { turns += crossing(faces_[i], y); });
    }

  private:
    static constexpr Vec3 ray{{0.4317, 0.5713, 0.6980361}};  // along which no mesh is laid out

    /// 1 or -1 where the ray from y passes through a triangle from its one side or its other, else
    /// 0. Seen along the ray, y is the origin. An edge is looked at in the same way in both
    /// triangles that have it, so that a ray that meets it, or a corner, passes through one of
    /// them.
    int crossing(const Face& face, const Vec3& y) const noexcept {
        Vec3 p[3];
        for (int k = 0; k < 3; ++k) {
            const Vec3 w = corners_[face[k]] - y;
            p[k] = {w[0] - ray[0] / ray[2] * w[2], w[1] - ray[1] / ray[2] * w[2], w[2]};
        }
        // Where the sides cross the plane p[1] = 0, one upwards and one downwards.
        double across[2] = {}, ahead[2] = {};
        for (int k = 0; k < 3; ++k) {
            const Vec3 &from = p[k], &to = p[(k + 1) % 3];
            if ((from[1] > 0) == (to[1] > 0)) continue;
            const bool is_up = to[1] > 0;
            const Vec3 &low = is_up ? from : to, &high = is_up ? to : from;
            across[is_up] = (low[0] * high[1] - high[0] * low[1]) / (high[1] - low[1]);
            ahead[is_up] = (low[2] * high[1] - high[2] * low[1]) / (high[1] - low[1]);
        }
        if ((across[0] > 0) == (across[1] > 0)) return 0;
        const int side = across[1] > 0 ? 1 : -1;
        return side * (ahead[0] * across[1] - ahead[1] * across[0]) > 0 ? side : 0;
    }
    Box<3> box(std::size_t first, std::size_t last) const {
        Box<3> box;
        for (std::size_t i = first; i < last; ++i)
            for (const std::uint32_t row : faces_[i]) box.include(corners_[row]);
        return box;
    }
    /// The disc around triangles. Its axis leads through the middle of their box, along the sum of
    /// their areas' normals.
    Disc disc(std::size_t first, std::size_t last) const {
        Vec3 areas;
        for (std::size_t i = first; i < last; ++i) {
            const auto& [a, b, c] = faces_[i];
            areas = areas + cross(corners_[b] - corners_[a], corners_[c] - corners_[a]);
        }
        const Box<3> around = box(first, last);
        const Vec3 middle = 0.5 * (around.low + around.high), n = along(areas, 1);
        double low = infinity, top = -infinity, wide2 = 0;
        for (std::size_t i = first; i < last; ++i)
            for (const std::uint32_t row : faces_[i]) {
                const Vec3 w = corners_[row] - middle;
                const double up = dot(w, n);
                low = std::min(low, up), top = std::max(top, up);
                wide2 = std::max(wide2, dot(w, w) - up * up);
            }
        constexpr double more = 1 + 1e-9;  // roundings
        return {middle + (low + top) / 2 * n, n, more * std::sqrt(wide2), more * (top - low) / 2};
    }
    /// Sorts triangles by their middles along the longest side of their box, in an order that no
    /// library chooses.
    void sort_along_longest_side(std::size_t first, std::size_t last) {
        const Box<3> around = box(first, last);
        const Vec3 size = around.high - around.low;
        const auto k = std::max_element(size.c, size.c + 3) - size.c;
        const auto middle = [&](const Face& f) {
            return (1.0 / 3) * (corners_[f[0]][k] + corners_[f[1]][k] + corners_[f[2]][k]);
        };
        std::stable_sort(faces_.begin() + static_cast<std::ptrdiff_t>(first),
                         faces_.begin() + static_cast<std::ptrdiff_t>(last),
                         [&](const Face& a, const Face& b) { return middle(a) < middle(b); });
    }

    std::vector<Triangle> triangles_;
    std::vector<Face> faces_;
    std::vector<Vec3> corners_;  // of all faces, by their rows
    BoundsTree<Disc> tree_;
};

/// Whether places lie in the body of which a closed mesh is the skin. It looks as far as a tick's
/// budget lets it, and goes on in the next tick.
class BodySearch {
  public:
    /// `skin`: stays where it is; null where there is no closed mesh.
    explicit BodySearch(const Mesh* skin = nullptr) noexcept : skin_(skin) {}

    /// Nothing while it is not known. What lies within `clear` of y is on the same side as y, so
    /// that the search goes on for a place that moves no further than that from tick to tick.
    /// `step` is what an inner step costs.
    std::optional<bool> is_inside(const Vec3& y, double clear, WorkBudget& budget,
                                  int step = 1) noexcept {
        if (!skin_) return false;
        if (!(norm(y - last_) <= clear_)) {
            at_ = y;
            node_ = 0;
            turns_ = 0;
        }
        last_ = y;
        clear_ = clear;
        while (node_ < skin_->tree().size()) {
            if (budget.is_spent()) return std::nullopt;
            budget.spend(step * skin_->count_turns(at_, node_, turns_));
        }
        return turns_ != 0;
    }

  private:
    const Mesh* skin_;
    Vec3 at_, last_;     // where the search began, and what was asked for last on the same side
    double clear_ = -1;  // around the last; nothing is looked for yet
    std::uint32_t node_ = 0;
    int turns_ = 0;
};

}  // namespace vfplan::inline v1::mesh
