// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Lines and arcs: as a drawing has them, and as pieces in space.
#pragma once

#include "vfplan/cloud/points.hpp"

namespace vfplan::inline v1 {

// A drawn line is handed to the engine as lines and arcs from vertex to vertex, as DXF has them.
// Two pieces share their vertex, so a stroke has no gap.

/// Lines and arcs from vertex to vertex. A bulge is tan(sweep / 4). It is 0 for a line, and above 0
/// where the arc turns left, seen with the ignored axis pointing to the viewer. An arc is at most a
/// half circle.
struct Stroke {
    std::vector<double> vertices;  ///< x y z of each in turn [m]
    std::vector<double> bulges;    ///< of the piece from each vertex to the next; one each
    bool closed = false;           ///< whether the last piece leads back to the first vertex

    bool operator==(const Stroke&) const = default;
};

/// The strokes of n vertices x y z, each with a bulge and the number of its stroke.
template <class Bulges, class Numbers, class Closed>
std::vector<Stroke> drawn_strokes(const double* xyz, std::size_t n, const Bulges& bulges,
                                  const Numbers& stroke, const Closed& closed, std::size_t count) {
    std::vector<Stroke> all(count);
    for (std::size_t s = 0; s < count; ++s) all[s].closed = closed[s] != 0;
    for (std::size_t i = 0; i < n; ++i) {
        Stroke& own = all.at(static_cast<std::size_t>(stroke[i]));
        own.vertices.insert(own.vertices.end(), xyz + 3 * i, xyz + 3 * i + 3);
        own.bulges.push_back(bulges[i]);
    }
    return all;
}

/// Points nearer than this are one [m]. A direction from one to the other would be rounding.
inline constexpr double shortest_piece = 1e-9;

/// tan(pi / 8), the bulge of a quarter circle.
inline constexpr double quarter_bulge = 0.41421356237309515;

/// Throws std::invalid_argument on strokes that no engine takes.
inline void check(const std::vector<Stroke>& strokes) {
    if (strokes.empty()) reject("a curve needs at least one stroke");
    for (const Stroke& s : strokes) {
        if (s.vertices.empty() || s.vertices.size() % 3 != 0)
            reject("a stroke needs at least one vertex, of three coordinates");
        if (s.bulges.size() != s.vertices.size() / 3) reject("a stroke needs a bulge a vertex");
        check_coordinates(s.vertices.data(), s.bulges.size());
        for (const double bulge : s.bulges)
            if (!(std::abs(bulge) <= 1)) reject("bulges must be from -1 to 1");
    }
}

// A line or an arc in space, and where descent of the distance ends on it.

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

    /// Where descent of |x - c| ends that begins at c on the piece. `side` is -1 at the beginning
    /// of the piece, 1 at its end, and 0 between.
    struct PieceDescent {
        Vec3 at;
        int side;
    };
    PieceDescent descend(const Vec3& x, const Vec3& c) const noexcept {
        if (radius == 0) {
            const double t = dot(x - from, entering);
            if (t <= 0) return {from, -1};
            return t < length ? PieceDescent{from + t * entering, 0} : PieceDescent{to, 1};
        }
        const Vec3 m = centre(), w = x - m;
        const double a = dot(w, entering), b = dot(w, out);
        if (a > 0 && a * cosine - b * sine < 0)
            return {m + (radius / std::sqrt(a * a + b * b)) * (b * out + a * entering), 0};
        return dot(w, tangent(c)) > 0 ? PieceDescent{to, 1} : PieceDescent{from, -1};
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

    /// The point of the piece at about `share` of the way from a to b.
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

/// The arc from p to q that leaves p along t, or, with `enters`, that arrives in q along t.
inline Piece bend(const Vec3& p, const Vec3& q, const Vec3& t, bool enters) noexcept {
    // An arc that turns by less than twice this is a line [rad].
    constexpr double straight_angle = 1e-6;
    Piece s = straight(p, q);
    const double lengthwise = dot(q - p, t);
    const Vec3 aside = (q - p) - lengthwise * t;
    const double off = norm(aside);
    if (off < straight_angle * s.length) return s;
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

/// Adds a line or an arc of a half circle at most, across an axis, in parts that are a quarter
/// circle and `longest` [m] at most. One that is not longer than `shortest` [m] is left out.
inline void cut(const Vec3& a, const Vec3& b, double bulge, const Vec3& axis, double longest,
                std::vector<Piece>& pieces, double shortest = shortest_piece) {
    const double chord = norm(b - a);
    if (!(chord > shortest)) return;
    const Vec3 e = (1 / chord) * (b - a), left = cross(axis, e);
    if (std::abs(bulge) > quarter_bulge || chord > longest) {
        const Vec3 middle = 0.5 * (a + b) - (bulge * chord / 2) * left;
        const double half = bulge / (1 + std::sqrt(1 + bulge * bulge));
        cut(a, middle, half, axis, longest, pieces, shortest);
        cut(middle, b, half, axis, longest, pieces, shortest);
        return;
    }
    const double share = 1 / (1 + bulge * bulge);
    const Vec3 begins = ((1 - bulge * bulge) * share) * e - (2 * bulge * share) * left;
    pieces.push_back(bend(a, b, begins, false));
}

}  // namespace detail

namespace curve {

/// A line or an arc of at most a quarter circle in the plane, from a to b.
struct PlanarPiece {
    Vec2 a, b;
    Vec2 start_tangent, end_tangent;  ///< unit vectors
    double kappa = 0;                 ///< curvature [1/m], positive to the left

    PlanarPiece(const Vec2& from, const Vec2& to, double bulge) noexcept : a(from), b(to) {
        const double chord = norm(b - a);
        const double share = 1 / (1 + bulge * bulge);
        const Vec2 e = (1 / chord) * (b - a);
        const double cosine = (1 - bulge * bulge) * share;
        const double sine = 2 * bulge * share;
        start_tangent = cosine * e - sine * left(e);
        end_tangent = cosine * e + sine * left(e);
        kappa = 2 * sine / chord;
    }
};

/// Halves an arc until it is a quarter circle at most. A piece of no length is left out.
inline void cut_into_quarters(const Vec2& a, const Vec2& b, double bulge,
                              std::vector<PlanarPiece>& pieces) {
    if (a == b) return;
    if (std::abs(bulge) <= quarter_bulge) {
        pieces.emplace_back(a, b, bulge);
        return;
    }
    const Vec2 middle = 0.5 * (a + b) - (bulge / 2) * left(b - a);
    const double half = bulge / (1 + std::sqrt(1 + bulge * bulge));
    cut_into_quarters(a, middle, half, pieces);
    cut_into_quarters(middle, b, half, pieces);
}

}  // namespace curve

}  // namespace vfplan::inline v1
