// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The strands that a guide follows, and where a tube around them runs into itself.
#pragma once

#include <numbers>

#include "vfplan/base/bounds_tree.hpp"
#include "vfplan/curve/pieces.hpp"

namespace vfplan::inline v1 {

// A drawn curve as the hand is to feel it. It goes through its points, in order, by circular arcs
// that meet with one tangent. Where the arcs would leave the straight lines between the points by
// more than `smoothed`, as at a corner or between points far apart, it follows those lines.

/// A curve that never branches. Its pieces stand one after the other.
struct Strand {
    std::size_t first = 0, count = 0;  ///< its pieces
    bool closed = false;
    double length = 0;  ///< [m]
};

/// One curve or several. It is made once; all that asks it afterwards is noexcept and allocates
/// nothing.
class Path {
  public:
    /// How far arcs may lie beside the lines between the points [m]: a hundredth of a tube that is
    /// felt as narrow.
    static constexpr double smoothed = 1e-5;
    static constexpr std::size_t none = std::numeric_limits<std::size_t>::max();

    /// Adds a curve through n points. Throws std::invalid_argument where these make none.
    void add(const std::vector<Vec3>& points, bool closed) {
        std::vector<Vec3> p;
        for (const Vec3& x : points)
            if (p.empty() || norm(x - p.back()) > shortest_piece) p.push_back(x);
        while (closed && p.size() > 1 && !(norm(p.front() - p.back()) > shortest_piece))
            p.pop_back();
        if (p.size() < (closed ? 3 : 2))
            reject("a curve needs 2 points that differ, a closed one 3");
        Strand s{pieces_.size(), 0, closed, 0};
        const std::vector<Vec3> t = tangents(p, closed);
        for (std::size_t i = 0; i + (closed ? 0 : 1) < p.size(); ++i) {
            const std::size_t j = (i + 1) % p.size();
            join(p[i], t[i], p[j], t[j], s.length);
        }
        end(s);
    }

    /// Adds lines and arcs across an axis. They are halved until they are at most `longest` [m],
    /// but into `max_parts` at most. How wide a tube may be is looked for at their ends.
    void add(const Stroke& stroke, const Vec3& axis, double longest) {
        std::vector<Vec3> p(stroke.bulges.size());
        for (std::size_t i = 0; i < p.size(); ++i)
            p[i] = across(point_at(stroke.vertices.data(), i), axis);
        const std::size_t sides = p.size() - (stroke.closed ? 0 : 1);
        double length = 0;
        for (std::size_t i = 0; i < sides; ++i) length += norm(p[(i + 1) % p.size()] - p[i]);
        std::vector<Piece> parts;
        for (std::size_t i = 0; i < sides; ++i)
            detail::cut(p[i], p[(i + 1) % p.size()], stroke.bulges[i], axis,
                        std::max(longest, length / max_parts), parts);
        Strand s{pieces_.size(), 0, stroke.closed, 0};
        for (const Piece& part : parts) push(part, s.length);
        end(s);
    }

    /// Makes the tree that finds near pieces, once all curves are added.
    void finish() {
        tree_.build(pieces_.size(), [this](std::size_t i) {
            const double half = 0.5 * pieces_[i].length;
            const Vec3 middle = pieces_[i].ahead(half);
            return Box<3>{middle - filled<3>(half), middle + filled<3>(half)};
        });
    }

    const std::vector<Strand>& strands() const noexcept { return strands_; }
    const BoundsTree<Box<3>>& tree() const noexcept { return tree_; }
    const Piece& operator[](std::size_t i) const noexcept { return pieces_[i]; }
    std::size_t size() const noexcept { return pieces_.size(); }

    /// The piece after (`side` 1) or before (-1) piece i of a strand; `none` beyond its ends.
    std::size_t next_piece(const Strand& s, std::size_t i, int side) const noexcept {
        const std::size_t last = s.first + s.count - 1;
        if (side > 0 && i < last) return i + 1;
        if (side < 0 && i > s.first) return i - 1;
        if (!s.closed) return none;
        return side > 0 ? s.first : last;
    }

    /// The point of a strand at an arc length from 0 to its length [m].
    Vec3 at(std::size_t strand, double arc) const noexcept {
        const Strand& s = strands_[strand];
        const auto first = pieces_.begin() + std::ptrdiff_t(s.first);
        const auto after =
            std::upper_bound(first, first + std::ptrdiff_t(s.count), arc,
                             [](double a, const Piece& p) noexcept { return a < p.start; });
        const Piece& p = *(after == first ? first : after - 1);
        return p.ahead(std::clamp(arc - p.start, 0.0, p.length));
    }

    /// Diagonal of the box about all curves [m]. No two of their places are further apart.
    double extent() const noexcept {
        Box<3> box;
        for (const Piece& p : pieces_) {
            box.include(p.from);
            box.include(p.to);
        }
        return norm(box.high - box.low);
    }

    /// Strand, piece and point nearest to x, of what a budget lets it look at.
    struct PathPlace {
        std::size_t strand = 0, piece = 0;
        Vec3 at;
        double distance = infinity;
    };
    PathPlace nearest(const Vec3& x, WorkBudget* budget = nullptr) const noexcept {
        PathPlace best;
        const auto look = [&](std::uint32_t i) noexcept {
            const Vec3 c = pieces_[i].nearest(x);
            const double d = norm(x - c);
            // Of places that are as near, the first.
            if (d < best.distance || (d == best.distance && i < best.piece))
                best = {strand_of(i), i, c, d};
        };
        tree_.visit_nearest(x, best.distance, look, budget);
        return best;
    }
    /// The number of the strand that a piece is part of.
    std::size_t strand_of(std::size_t piece) const noexcept {
        std::size_t s = 0;
        while (piece >= strands_[s].first + strands_[s].count) ++s;
        return s;
    }

  private:
    /// Into how many parts one stroke is cut at most.
    static constexpr double max_parts = 1e5;

    void end(Strand& s) {
        s.count = pieces_.size() - s.first;
        if (s.count == 0) reject("a curve needs 2 points that differ, a closed one 3");
        strands_.push_back(s);
    }
    /// The unit tangent at each point, of the circle through it and its neighbours. It is 0 where
    /// the curve turns back on itself.
    static std::vector<Vec3> tangents(const std::vector<Vec3>& p, bool closed) {
        const std::size_t n = p.size();
        std::vector<Vec3> t(n);
        for (std::size_t i = closed ? 0 : 1; i + (closed ? 0 : 1) < n; ++i) {
            const Vec3 to = p[i] - p[(i + n - 1) % n], on = p[(i + 1) % n] - p[i];
            t[i] = vfplan::along((1 / dot(to, to)) * to + (1 / dot(on, on)) * on, 1);
        }
        if (closed) return t;
        // The ends mirror the tangent beside them in the chord, as an arc does.
        const auto mirror = [](const Vec3& chord, const Vec3& beside) {
            return (2 * dot(chord, beside) / dot(chord, chord)) * chord - beside;
        };
        if (n == 2) {
            t[0] = t[1] = vfplan::along(p[1] - p[0], 1);
        } else {
            t[0] = mirror(p[1] - p[0], t[1]);
            t[n - 1] = mirror(p[n - 1] - p[n - 2], t[n - 2]);
        }
        return t;
    }

    /// Joins two points by two arcs of equal tangent lengths (Bolton, "Biarc curves", 1975), or by
    /// a straight line.
    void join(const Vec3& p, const Vec3& t, const Vec3& q, const Vec3& u, double& length) {
        const Vec3 v = q - p;
        const double vv = dot(v, v), ahead = std::min(dot(t, v), dot(u, v));
        if (ahead > 0.5 * std::sqrt(vv)) {  // both tangents within 60 degrees of the chord
            const double a = 2 * (1 - dot(t, u)), b = dot(v, t + u);
            const double d = vv / (b + std::sqrt(b * b + a * vv));
            const Vec3 middle = 0.5 * (p + q + d * (t - u));
            const Piece one = detail::bend(p, middle, t, false);
            const Piece two = detail::bend(middle, q, u, true);
            const Vec3 off = (middle - p) - (dot(middle - p, v) / vv) * v;
            if (norm(off) + std::max(sagitta(one), sagitta(two)) <= smoothed) {
                push(one, length);
                push(two, length);
                return;
            }
        }
        push(detail::straight(p, q), length);
    }
    /// How far an arc lies beside its chord, nearly [m].
    static double sagitta(const Piece& s) noexcept {
        return s.radius == 0 ? 0 : s.length * s.length / (8 * s.radius);
    }
    void push(Piece s, double& length) {
        s.start = length;
        length += s.length;
        pieces_.push_back(s);
    }

    std::vector<Piece> pieces_;
    std::vector<Strand> strands_;
    BoundsTree<Box<3>> tree_;
};

// A tube around a curve may be so wide that it runs into itself, in a turn that is tighter than the
// tube is wide, or beside another strand. A tip there would be near two places of the curve.

/// Where a tube of some radius runs into itself.
struct TubeObstacle {
    bool found = false;
    bool turn = false;  ///< whether it is a turn of the curve, and not another strand
    double width = 0;   ///< between the two places [m]; a tube of half of it fits
    std::size_t strand = 0;
    double arc = 0;  ///< along that strand [m]
    Vec3 at;
};

namespace detail {

inline void keep_narrower(TubeObstacle& worst, const TubeObstacle& one) {
    if (!worst.found || one.width < worst.width) worst = one;
}

/// The tightest turn in which a part of the curve, as long as `share` of a half circle of the
/// tube's radius, spans less than that part of the circle would.
inline TubeObstacle tight_turns(const Path& path, double radius, double share) {
    // Share by which a turn may be too tight: a circle that was given by points is a polygon, or
    // arcs, of nearly its radius.
    constexpr double tolerance = 1e-3;
    const double half_circle = std::numbers::pi * radius;
    const double reach = share * half_circle;
    const double span = 2 * radius * std::sin(0.5 * std::numbers::pi * share);
    TubeObstacle worst;
    for (std::size_t strand = 0; strand < path.strands().size(); ++strand) {
        const Strand& s = path.strands()[strand];
        if (s.closed && s.length < 2 * half_circle * (1 - tolerance)) {
            // The tube is as wide as the whole curve.
            const Vec3& at = path[s.first].from;
            keep_narrower(worst, {true, true, s.length / std::numbers::pi, strand, 0, at});
            continue;
        }
        std::size_t j = s.first;
        double behind = 0;  // length of a closed curve, once j has passed its first point [m]
        for (std::size_t i = s.first; i < s.first + s.count; ++i) {
            const double goal = path[i].start + reach;
            if (!s.closed && goal > s.length) break;
            while (path[j].start + path[j].length + behind < goal) {
                const std::size_t next = path.next_piece(s, j, 1);
                if (next == Path::none) break;
                if (next < j) behind += s.length;
                j = next;
            }
            const Vec3 other_end = path[j].ahead(goal - behind - path[j].start);
            const double width = norm(other_end - path[i].from);
            if (width < span * (1 - tolerance))
                keep_narrower(worst, {true, true, width, strand, path[i].start, path[i].from});
        }
    }
    return worst;
}

/// Distance of the chords of two pieces [m] (Ericson, "Real-Time Collision Detection", 5.1.9).
inline double between(const Piece& p, const Piece& q) {
    const Vec3 a = p.to - p.from, b = q.to - q.from, r = p.from - q.from;
    const double aa = dot(a, a), bb = dot(b, b), ab = dot(a, b), ar = dot(a, r), br = dot(b, r);
    const double det = aa * bb - ab * ab;
    // Chords with a smaller determinant are parallel: one end is as good as any other place.
    constexpr double parallel = 1e-12;
    double s = 0;
    if (det > parallel * aa * bb) s = std::clamp((ab * br - ar * bb) / det, 0.0, 1.0);
    const double t = std::clamp((ab * s + br) / bb, 0.0, 1.0);
    s = std::clamp((ab * t - ar) / aa, 0.0, 1.0);
    return norm(r + s * a - t * b);
}

/// Where two strands, or two parts of one that comes back half a circle further, are nearest to
/// each other at the beginnings of two pieces: their distance [m], else infinity.
inline double gap_between(const Path& path, double radius, std::size_t i, std::size_t j) {
    const auto distance = [&](std::size_t k, std::size_t l) {
        return norm(path[k].from - path[l].from);
    };
    const double d = distance(i, j);
    if (!(d < 2 * radius)) return infinity;
    const Strand& s = path.strands()[path.strand_of(i)];
    const Strand& t = path.strands()[path.strand_of(j)];
    if (&s == &t) {
        double way = std::abs(path[i].start - path[j].start);
        if (s.closed) way = std::min(way, s.length - way);
        if (way < std::numbers::pi * radius) return infinity;
    }
    // No neighbour of the one may be nearer to the other.
    for (const int side : {-1, 1}) {
        const std::size_t k = path.next_piece(s, i, side), l = path.next_piece(t, j, side);
        if (k != Path::none && distance(k, j) < d) return infinity;
        if (l != Path::none && distance(i, l) < d) return infinity;
    }
    double least = infinity;
    for (const std::size_t k : {i, path.next_piece(s, i, -1)})
        for (const std::size_t l : {j, path.next_piece(t, j, -1)})
            if (k != Path::none && l != Path::none)
                least = std::min(least, between(path[k], path[l]));
    return least;
}

}  // namespace detail

/// The narrowest place for a tube of `radius` [m] around the curves. Where none is found, it fits.
inline TubeObstacle narrowest(const Path& path, double radius) {
    // Strands that come nearer than this meet or cross [m], which a tip on one of them does not
    // feel.
    constexpr double crossing_distance = 1e-6;
    TubeObstacle worst = detail::tight_turns(path, radius, 1);
    for (std::size_t i = 0; i < path.size(); ++i) {
        const auto look_at = [&](std::size_t j) {
            if (j <= i) return;
            const double width = detail::gap_between(path, radius, i, j);
            if (width > crossing_distance && width < 2 * radius)
                detail::keep_narrower(
                    worst, {true, false, width, path.strand_of(i), path[i].start, path[i].from});
        };
        path.tree().around(path[i].from, 2 * radius, look_at);
    }
    return worst;
}

/// The tightest bend where a quarter of a circle of `radius` [m] does not fit. The tube is wider
/// there than the bend, and a tip in it may cut the corner.
inline TubeObstacle tight_bend(const Path& path, double radius) {
    return detail::tight_turns(path, radius, 0.5);
}

/// The widest tube of which `test` (narrowest or tight_bend) finds nothing, to 1 % [m]; at most
/// `radius`, of which it does.
inline double widest(const Path& path, double radius, TubeObstacle (*test)(const Path&, double)) {
    constexpr double precision = 0.01;      // of the radius
    constexpr double smallest_tube = 1e-9;  // [m]
    double fits = 0;
    double too_wide = radius;
    while (too_wide - fits > precision * too_wide && too_wide > smallest_tube) {
        const double middle = 0.5 * (fits + too_wide);
        if (test(path, middle).found)
            too_wide = middle;
        else
            fits = middle;
    }
    return fits;
}

}  // namespace vfplan::inline v1
