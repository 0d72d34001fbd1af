// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// How wide a tube around a curve may be before it runs into itself: in a turn that is tighter than
// the tube is wide, or beside another strand. There the curve would not say where in it a tip is.
#pragma once

#include <array>
#include <numbers>

#include "vfplan/path.hpp"

namespace vfplan {

/// Where a tube of some radius runs into itself.
struct Narrow {
    bool found = false;
    bool turn = false;  ///< in a turn of the curve; else beside another strand
    double width = 0;   ///< between the two places [m]: a tube of half of it fits
    std::size_t strand = 0;
    double arc = 0;  ///< along that strand [m]
    Vec3 at;
};

namespace detail {

class Room {
  public:
    Room(const Path& path, double radius) : path_(path), radius_(radius) {}

    /// Turns in which `share` of half a circle's length of the curve spans less than the circle's.
    Narrow turns(double share) const {
        Narrow worst;
        for (std::size_t s = 0; s < path_.strands().size(); ++s) turns(s, share, worst);
        return worst;
    }

    Narrow look() const {
        Narrow worst = turns(1);
        const auto& balls = path_.balls();
        for (std::size_t a = 0; a < balls.size(); ++a)
            for (std::size_t b = a; b < balls.size(); ++b)
                if (norm(balls[a].middle - balls[b].middle) - balls[a].radius - balls[b].radius <
                    2 * radius_)
                    beside(balls[a], balls[b], worst);
        return worst;
    }

  private:
    /// Strands that come nearer than this meet or cross, which a tip on one of them does not feel.
    static constexpr double meet = 1e-6;  // [m]
    /// A circle through points is a polygon or arcs of nearly its radius.
    static constexpr double rounded = 1e-3;

    static void keep(Narrow& worst, const Narrow& one) {
        if (!worst.found || one.width < worst.width) worst = one;
    }
    double half_circle() const { return std::numbers::pi * radius_; }

    void turns(std::size_t strand, double share, Narrow& worst) const {
        const Strand& s = path_.strands()[strand];
        const double reach = share * half_circle();
        const double span = 2 * radius_ * std::sin(0.5 * std::numbers::pi * share);
        if (!s.closed && s.length < reach) return;
        if (s.closed &&
            s.length < 2 * half_circle() * (1 - rounded)) {  // within the tube as a whole
            const Vec3& at = path_[s.first].from;
            return keep(worst, {true, true, s.length / std::numbers::pi, strand, 0, at});
        }
        std::size_t j = s.first;
        double behind = 0;  // a closed curve's length, once j has passed its first point
        for (std::size_t i = s.first; i < s.first + s.count; ++i) {
            const double goal = path_[i].start + reach;
            if (!s.closed && goal > s.length) return;
            while (path_[j].start + path_[j].length + behind < goal) {
                const std::size_t next = path_.beside(s, j, 1);
                if (next == Path::none) break;
                if (next < j) behind += s.length;
                j = next;
            }
            const Vec3 far = path_[j].ahead(goal - behind - path_[j].start);
            const double width = norm(far - path_[i].from);
            if (width >= span * (1 - rounded)) continue;
            const Vec3 at = path_[i].from;
            keep(worst, {true, true, width, strand, path_[i].start, at});
        }
    }

    /// Two strands, or one that comes back: the places where they are nearest to each other.
    void beside(const Path::Ball& a, const Path::Ball& b, Narrow& worst) const {
        for (std::size_t i = a.first; i < a.last; ++i)
            for (std::size_t j = std::max(b.first, i + 1); j < b.last; ++j) {
                const double d = apart(i, j);
                if (!(d < 2 * radius_) || !far_along(i, j) || !least(i, j, d)) continue;
                const double width = crossing(i, j);
                if (width <= meet || width >= 2 * radius_) continue;
                const std::size_t s = strand(i);
                keep(worst, {true, false, width, s, path_[i].start, path_[i].from});
            }
    }
    double apart(std::size_t i, std::size_t j) const { return norm(path_[i].from - path_[j].from); }
    bool far_along(std::size_t i, std::size_t j) const {
        const std::size_t s = strand(i);
        if (s != strand(j)) return true;
        const double way = std::abs(path_[i].start - path_[j].start);
        const Strand& t = path_.strands()[s];
        return (t.closed ? std::min(way, t.length - way) : way) >= half_circle();
    }
    std::size_t strand(std::size_t piece) const {
        std::size_t s = 0;
        while (piece >= path_.strands()[s].first + path_.strands()[s].count) ++s;
        return s;
    }
    /// Whether no neighbour of the one is nearer to the other.
    bool least(std::size_t i, std::size_t j, double d) const {
        for (const int side : {-1, 1}) {
            const std::size_t k = path_.beside(path_.strands()[strand(i)], i, side);
            const std::size_t l = path_.beside(path_.strands()[strand(j)], j, side);
            if (k != Path::none && apart(k, j) < d) return false;
            if (l != Path::none && apart(i, l) < d) return false;
        }
        return true;
    }
    /// Distance of the pieces around two places.
    double crossing(std::size_t i, std::size_t j) const {
        double least = std::numeric_limits<double>::infinity();
        for (const std::size_t k : around(i))
            for (const std::size_t l : around(j))
                if (k != Path::none && l != Path::none)
                    least = std::min(least, between(path_[k], path_[l]));
        return least;
    }
    std::array<std::size_t, 2> around(std::size_t i) const {
        return {i, path_.beside(path_.strands()[strand(i)], i, -1)};
    }
    /// Distance of the chords of two pieces (Ericson, "Real-Time Collision Detection", 5.1.9).
    static double between(const Piece& p, const Piece& q) {
        const Vec3 a = p.to - p.from, b = q.to - q.from, r = p.from - q.from;
        const double aa = dot(a, a), bb = dot(b, b), ab = dot(a, b), ar = dot(a, r), br = dot(b, r);
        const double det = aa * bb - ab * ab;
        double s = det > 1e-12 * aa * bb ? std::clamp((ab * br - ar * bb) / det, 0.0, 1.0) : 0;
        const double t = std::clamp((ab * s + br) / bb, 0.0, 1.0);
        s = std::clamp((ab * t - ar) / aa, 0.0, 1.0);
        return norm(r + s * a - t * b);
    }

    const Path& path_;
    double radius_;
};

}  // namespace detail

/// The narrowest place for a tube of `radius` [m] around the curves; none found: it fits.
inline Narrow narrowest(const Path& path, double radius) {
    return detail::Room(path, radius).look();
}

/// The tightest bend where a quarter of a circle of `radius` [m] does not fit: the tube is wider
/// there than the bend, and a tip in it may cut the corner.
inline Narrow tight_bend(const Path& path, double radius) {
    return detail::Room(path, radius).turns(0.5);
}

/// The widest tube of which `test` (narrowest or tight_bend) finds nothing, to 1 % [m]; at most
/// `radius`, of which it does.
inline double widest(const Path& path, double radius, Narrow (*test)(const Path&, double)) {
    double fits = 0, too_wide = radius;
    while (too_wide - fits > 0.01 * too_wide && too_wide > 1e-9) {
        const double middle = 0.5 * (fits + too_wide);
        (test(path, middle).found ? too_wide : fits) = middle;
    }
    return fits;
}

}  // namespace vfplan
