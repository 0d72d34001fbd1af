// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A drawn curve as the hand is to feel it: through its points, in order, by circular arcs that meet
// with one tangent where these stay within `smoothed` of the straight lines between the points, by
// those lines elsewhere (corners, points far apart).
#pragma once

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "vfplan/vec.hpp"

namespace vfplan {

/// A straight line, or an arc of less than half a turn.
struct Piece {
    Vec3 from, to;
    Vec3 entering, leaving;  ///< unit tangents at both, in drawing order
    Vec3 out;                ///< arc: unit vector from its centre to `from`
    double radius = 0;       ///< [m]; 0: straight
    double cosine = 1;       ///< arc: of its turn
    double sine = 0;         ///< arc: of its turn
    double length = 0;       ///< [m]
    double start = 0;        ///< arc length of the curve at `from` [m]

    Vec3 centre() const noexcept { return from - radius * out; }

    /// Where descent of |x - c| ends that begins at c on the piece; `side`: -1 and 1 where that is
    /// the beginning or the end of the piece, 0 where it is between.
    struct Foot {
        Vec3 at;
        int side;
    };
    Foot descend(const Vec3& x, const Vec3& c) const noexcept {
        if (radius == 0) {
            const double t = dot(x - from, entering);
            if (t <= 0) return {from, -1};
            return t < length ? Foot{from + t * entering, 0} : Foot{to, 1};
        }
        const Vec3 m = centre(), w = x - m;
        const double a = dot(w, entering), b = dot(w, out);
        if (a > 0 && a * cosine - b * sine < 0)
            return {m + (radius / std::sqrt(a * a + b * b)) * (b * out + a * entering), 0};
        return dot(w, tangent(c)) > 0 ? Foot{to, 1} : Foot{from, -1};
    }

    /// The point of the piece nearest to x.
    Vec3 nearest(const Vec3& x) const noexcept {
        const Vec3 a = descend(x, from).at, b = radius == 0 ? a : descend(x, to).at;
        const Vec3 u = x - a, v = x - b;
        return dot(u, u) <= dot(v, v) ? a : b;
    }

    /// Unit tangent at c on the piece.
    Vec3 tangent(const Vec3& c) const noexcept {
        if (radius == 0) return entering;
        const Vec3 w = c - centre();
        return along(dot(w, out) * entering - dot(w, entering) * out, 1);
    }

    /// A point between a and b on the piece; near a for a small share.
    Vec3 between(const Vec3& a, const Vec3& b, double share) const noexcept {
        const Vec3 c = a + share * (b - a);
        if (radius == 0) return c;
        const Vec3 m = centre();
        return m + along(c - m, radius);
    }

    /// The point of the piece at arc length t from its beginning [m].
    Vec3 ahead(double t) const noexcept {
        if (radius == 0) return from + t * entering;
        return centre() + radius * (std::cos(t / radius) * out + std::sin(t / radius) * entering);
    }

    /// Arc length of the curve at c on the piece [m].
    double arc(const Vec3& c) const noexcept {
        const double chord = norm(c - from);
        if (radius == 0) return start + std::min(chord, length);
        return start +
               std::min(2 * radius * std::asin(std::min(1.0, 0.5 * chord / radius)), length);
    }
};

namespace detail {

inline Piece straight(const Vec3& p, const Vec3& q) noexcept {
    Piece s;
    s.from = p;
    s.to = q;
    s.length = norm(q - p);
    s.entering = s.leaving = (1 / s.length) * (q - p);
    return s;
}

/// The arc from p to q that leaves p along t (`enters`: that arrives in q along t).
inline Piece bend(const Vec3& p, const Vec3& q, const Vec3& t, bool enters) noexcept {
    Piece s = straight(p, q);
    const double lengthwise = dot(q - p, t);
    const Vec3 aside = (q - p) - lengthwise * t;
    const double off = norm(aside);
    if (off < 1e-6 * s.length) return s;  // turns by less than 2e-6 rad
    s.radius = 0.5 * s.length * s.length / off;
    const Vec3 inwards = (enters ? -1.0 / off : 1.0 / off) * aside;  // towards the centre, at t
    const double half = std::min(1.0, off / s.length);
    s.sine = 2 * half * (lengthwise / s.length);
    s.cosine = 1 - 2 * half * half;
    if (enters) {
        s.leaving = t;
        s.out = -s.cosine * inwards - s.sine * t;
        s.entering = s.cosine * t - s.sine * inwards;
    } else {
        s.entering = t;
        s.out = -1.0 * inwards;
        s.leaving = s.cosine * t + s.sine * inwards;
    }
    s.length = 2 * s.radius * std::asin(half);
    return s;
}

}  // namespace detail

/// A curve that never branches: pieces one after the other.
struct Strand {
    std::size_t first = 0, count = 0;  ///< its pieces
    bool closed = false;
    double length = 0;  ///< [m]
};

/// One curve or several, made once; all that follows is noexcept and allocates nothing.
class Path {
  public:
    /// How far arcs may lie beside the lines between the points [m].
    static constexpr double smoothed = 1e-5;
    /// Points nearer than this to the one before are left out [m].
    static constexpr double shortest = 1e-9;
    static constexpr std::size_t none = std::numeric_limits<std::size_t>::max();

    /// Adds a curve through n points. Throws std::invalid_argument where these make none.
    void add(const std::vector<Vec3>& points, bool closed) {
        std::vector<Vec3> p;
        for (const Vec3& x : points)
            if (p.empty() || norm(x - p.back()) > shortest) p.push_back(x);
        while (closed && p.size() > 1 && !(norm(p.front() - p.back()) > shortest)) p.pop_back();
        if (p.size() < (closed ? 3 : 2))
            reject("a curve needs 2 points that differ, a closed one 3");
        Strand s{pieces_.size(), 0, closed, 0};
        const std::vector<Vec3> t = tangents(p, closed);
        for (std::size_t i = 0; i + (closed ? 0 : 1) < p.size(); ++i) {
            const std::size_t j = (i + 1) % p.size();
            join(p[i], t[i], p[j], t[j], s.length);
        }
        s.count = pieces_.size() - s.first;
        strands_.push_back(s);
        for (std::size_t i = s.first; i < pieces_.size(); i += block) bound(i, s.first + s.count);
    }

    const std::vector<Strand>& strands() const noexcept { return strands_; }
    const Piece& operator[](std::size_t i) const noexcept { return pieces_[i]; }
    std::size_t size() const noexcept { return pieces_.size(); }

    /// The piece after (`side` 1) or before (-1) piece i of a strand; `none` beyond its ends.
    std::size_t beside(const Strand& s, std::size_t i, int side) const noexcept {
        const std::size_t last = s.first + s.count - 1;
        if (side > 0) return i < last ? i + 1 : s.closed ? s.first : none;
        return i > s.first ? i - 1 : s.closed ? last : none;
    }

    /// The point of a strand at an arc length from 0 to its length [m].
    Vec3 at(std::size_t strand, double arc) const noexcept {
        const Strand& s = strands_[strand];
        const auto first = pieces_.begin() + std::ptrdiff_t(s.first);
        const auto after =
            std::upper_bound(first, first + std::ptrdiff_t(s.count), arc,
                             [](double a, const Piece& p) noexcept { return a < p.start; });
        const Piece& p = after == first ? *first : *(after - 1);
        return p.ahead(std::clamp(arc - p.start, 0.0, p.length));
    }

    /// Largest distance between two corners of the box about all curves, at least their own [m].
    double extent() const noexcept {
        Vec3 low = pieces_.front().from, high = low;
        for (const Piece& p : pieces_)
            for (int k = 0; k < 3; ++k) {
                low[k] = std::min({low[k], p.from[k], p.to[k]});
                high[k] = std::max({high[k], p.from[k], p.to[k]});
            }
        return norm(high - low);
    }

    /// Strand, piece and point nearest to x.
    struct Place {
        std::size_t strand = 0, piece = 0;
        Vec3 at;
        double distance = std::numeric_limits<double>::infinity();
    };
    Place nearest(const Vec3& x) const noexcept {
        Place best;
        std::size_t strand = 0;
        for (const Ball& b : balls_) {
            if (norm(x - b.middle) - b.radius >= best.distance) continue;
            for (std::size_t i = b.first; i < b.last; ++i) {
                const Vec3 c = pieces_[i].nearest(x);
                const double d = norm(x - c);
                if (!(d < best.distance)) continue;
                while (i < strands_[strand].first) --strand;
                while (i >= strands_[strand].first + strands_[strand].count) ++strand;
                best = {strand, i, c, d};
            }
        }
        return best;
    }

    /// Pieces in a row that lie within a ball: what is far off is passed over at once.
    struct Ball {
        std::size_t first, last;
        Vec3 middle;
        double radius = 0;
    };
    const std::vector<Ball>& balls() const noexcept { return balls_; }
    std::size_t bytes() const noexcept {
        return pieces_.capacity() * sizeof(Piece) + balls_.capacity() * sizeof(Ball);
    }

  private:
    static constexpr std::size_t block = 16;

    /// Unit tangents at the points: of the circle through each and its neighbours; 0 where the
    /// curve turns back on itself.
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
        t[0] = n > 2 ? mirror(p[1] - p[0], t[1]) : vfplan::along(p[1] - p[0], 1);
        t[n - 1] = n > 2 ? mirror(p[n - 1] - p[n - 2], t[n - 2]) : t[0];
        return t;
    }

    /// Two arcs of equal tangent lengths (Bolton, "Biarc curves", 1975), or one straight line.
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
    static double sagitta(const Piece& s) noexcept {
        return s.radius > 0 ? s.length * s.length / (8 * s.radius) : 0;
    }
    void push(Piece s, double& length) {
        s.start = length;
        length += s.length;
        pieces_.push_back(s);
    }
    void bound(std::size_t first, std::size_t end) {
        Ball b{first, std::min(first + block, end), {}, 0};
        for (std::size_t i = b.first; i < b.last; ++i)
            b.middle = b.middle + (1.0 / double(b.last - b.first)) * pieces_[i].from;
        for (std::size_t i = b.first; i < b.last; ++i)
            b.radius = std::max(b.radius, norm(pieces_[i].from - b.middle) + pieces_[i].length);
        balls_.push_back(b);
    }

    std::vector<Piece> pieces_;
    std::vector<Strand> strands_;
    std::vector<Ball> balls_;
};

}  // namespace vfplan
