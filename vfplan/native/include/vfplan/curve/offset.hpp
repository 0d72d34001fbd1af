// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What lies R from a line, an arc or a joint of two, and where a path of constant curvature meets
// it.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "vfplan/base/vec.hpp"

namespace vfplan::curve {

// Ways of constant curvature in the plane: what a proxy goes along, straight or round.
//
// Where a way from x begins along the unit vector T, with N to the left of it and curvature k, and
// t = tan(k s / 2) / (k / 2) measures how far it has gone (t is the arc length s where k is 0),
//
//     w(t) = (t T + q t² N) / (1 + q² t²),   q = k / 2,
//
// so that a line and a circle, of any curvature, meet the way at the roots of one quadratic.
// Nothing here takes an angle or a centre: a piece may bend as little as it likes.

inline constexpr double never = std::numeric_limits<double>::infinity();

inline Vec2 left(const Vec2& v) noexcept { return {{-v[1], v[0]}}; }

/// a t² + b t + c; what of a function of the place is left after the factor 1 + q² t² > 0.
struct Quadratic {
    double a, b, c;

    Quadratic operator-() const noexcept { return {-a, -b, -c}; }

    /// The t >= 0 at which it falls through 0, or `never`.
    double falls() const noexcept {
        const double square = b * b - 4 * a * c;
        if (!(square >= 0)) return never;
        const double root = std::sqrt(square);
        const double t = b <= 0 ? (root > b ? 2 * c / (root - b) : never) : -(b + root) / (2 * a);
        return t >= 0 ? t : never;
    }
};

struct Way {
    Vec2 x, T, N;
    double q = 0;  ///< half the curvature [1/m], positive to the left

    Way(const Vec2& from, const Vec2& tangent, double half_curvature) noexcept
        : x(from), T(tangent), N(left(tangent)), q(half_curvature) {}

    Vec2 at(double t) const noexcept { return x + (t / (1 + q * q * t * t)) * (T + (q * t) * N); }

    /// The rest of the way, from t on.
    Way from(double t) const noexcept {
        const double turn = q * t, share = 1 / (1 + turn * turn);
        return {at(t), (share * (1 - turn * turn)) * T + (share * 2 * turn) * N, q};
    }
    /// What t is, where `more` is it on the rest of the way from t on.
    double on(double t, double more) const noexcept {
        if (!(more < never)) return never;
        const double share = 1 - q * q * t * more;
        return share > 0 ? (t + more) / share : never;
    }

    /// A quarter of the circle: t measures no more than half of it well.
    double quarter() const noexcept { return q == 0 ? never : 1 / std::abs(q); }

    /// kappa |y - base|² / 2 - n·(y - base) - level along the way, where at its start it is `value`
    /// and its gradient there is m.
    Quadratic along(double value, const Vec2& m, double kappa) const noexcept {
        return {q * (q * value + dot(m, N)) + kappa / 2, dot(m, T), value};
    }

    /// Where the way is nearest to x + u; u·T > 0.
    double nearest(const Vec2& u) const noexcept {
        const double a = 1 - 2 * q * dot(u, N), b = dot(u, T);
        const double root = std::sqrt(a * a + 4 * b * b * q * q);
        return a >= 0 ? 2 * b / (a + root) : (root - a) / (2 * b * q * q);
    }

    /// Where x + u comes into sight from a way round what lies on its side away from the unit
    /// normal n = ± N.
    double in_sight(const Vec2& u, const Vec2& n) const noexcept {
        const double side = dot(n, N), p = dot(u, N);
        const Quadratic hidden{q - q * q * p, -2 * q * dot(u, T), p};
        return side > 0 ? (-hidden).falls() : hidden.falls();
    }
};

// What a proxy of radius R can touch of a curve: the side of a line or of an arc, and the ball
// around a joint. With w = y - base and G(y) = kappa |w|² / 2 - n·w, all three are one:
//
//     line   kappa = 0, n its unit normal:           G is the signed distance
//     arc    kappa > 0, n at base to the centre:     G = d + kappa d² / 2, d > 0 outside
//     joint  kappa = 1, n = 0:                       G = d² / 2
//
// A side forbids low < G < high between the normals at its two ends, a joint G < high everywhere.

/// A normal of the curve: the feature lies where the other side of it does not begin.
struct Border {
    Vec2 at, way;   ///< way: unit, out of the feature; 0 where the feature goes on for ever
    int next = -1;  ///< the feature beyond

    double beyond(const Vec2& y) const noexcept { return dot(y - at, way); }
    double met(const Way& path) const noexcept {
        // Beyond it by a rounding, and on the way out: it is met at once.
        const double now = std::min(beyond(path.x), 0.0);
        return (-path.along(now, way, 0)).falls();
    }
};

struct Contact {
    Vec2 normal;      ///< unit, from the curve to the proxy
    double distance;  ///< [m]
    double bend;      ///< curvature [1/m] of what is as far from the curve, positive round it
};

struct Feature {
    Vec2 base, n;
    double kappa = 0;
    double high = 0, low = -never;         ///< levels of G
    double high_slope = 0, low_slope = 0;  ///< of G across them, dG/dd
    Border border[2];
    Vec2 least, most;  ///< corners of the box around the piece

    bool joint() const noexcept { return n[0] == 0 && n[1] == 0; }
    double G(const Vec2& w) const noexcept { return kappa * dot(w, w) / 2 - dot(n, w); }
    /// Between the feature's borders, or beyond them by no more than `slack` [m].
    bool beside(const Vec2& y, double slack) const noexcept {
        return border[0].beyond(y) <= slack && border[1].beyond(y) <= slack;
    }

    /// Squared distance of y from the box around the piece: a way as long meets it no sooner.
    double box_square(const Vec2& y) const noexcept {
        const double u = std::max({least[0] - y[0], y[0] - most[0], 0.0});
        const double v = std::max({least[1] - y[1], y[1] - most[1], 0.0});
        return u * u + v * v;
    }

    /// Seen from y, which lies beside it and not on it.
    Contact contact(const Vec2& y) const noexcept {
        const Vec2 w = y - base, m = kappa * w - n;
        const double g = G(w), slope = norm(m);
        if (joint()) return {(1 / slope) * w, slope, 1 / slope};
        const double side = g >= 0 ? 1 : -1;
        return {(side / slope) * m, side * 2 * g / (1 + slope), side * kappa / slope};
    }

    /// Distance of y from the piece where y lies beside it, else `never` [m].
    double distance(const Vec2& y) const noexcept {
        const Vec2 w = y - base;
        if (joint()) return norm(w);
        if (!beside(y, 0)) return never;
        return 2 * std::abs(G(w)) / (1 + norm(kappa * w - n));
    }

    /// Whether a step from the centre of a hollow arc as wide as the proxy leads into it anywhere.
    bool closes(const Vec2& step) const noexcept {
        const Vec2 begins = -1.0 * border[0].way;
        const double side = dot(n, left(begins));
        return dot(step, n) < -1e-9 || side * dot(step, left(border[1].way)) < -1e-9;
    }

    /// Where a way that begins in what the feature forbids comes out of it.
    double out(const Way& path) const noexcept {
        const Vec2 w = path.x - base, m = kappa * w - n;
        const double g = G(w);
        double t = (-path.along(g - high, m, kappa)).falls();
        if (joint()) return t;
        if (low > -never) t = std::min(t, path.along(g - low, m, kappa).falls());
        for (const Border& b : border) t = std::min(t, b.met(path));
        return t;
    }
};

/// What roundings may do at the height R.
struct Heights {
    double slack;    ///< [m]; a way that begins at the height has to get past its own start
    double deepest;  ///< [m]; what has sunk so far may not sink by a further `slack`
    double filled;   ///< [m]; a hollow that leaves the proxy less room than that is full
};

/// Where a way that begins beside the feature first goes lower than the feature allows, up to
/// `most`; else `never`. One that begins at the height, or below by what roundings take, is let go
/// on until it is lower by `slack`; `touching` tells that a meeting was such a one.
inline double sinks(const Feature& f, const Way& path, double most, const Heights& h,
                    bool& touching) noexcept {
    const Vec2 w = path.x - f.base, m = f.kappa * w - f.n;
    const double g = f.G(w);
    double first = never;
    if (f.low_slope < f.kappa * h.filled && norm(m) < f.kappa * h.filled) {
        touching = f.closes(path.T);
        return touching ? 0 : never;
    }
    const auto wall = [&](Quadratic down, double slope, bool here) noexcept {
        const bool at_once = here && down.c < h.slack * slope;
        if (at_once) {
            if (down.b >= 0 && down.a >= 0) return;
            if (down.c > -h.deepest * slope)
                down.c = h.slack * slope;
            else if (down.b < 0)
                down.c = 0;
        }
        const double t = down.falls();
        if (!(t <= most && t < first && f.beside(path.at(t), h.slack))) return;
        first = t;
        touching = at_once;
    };
    wall(path.along(g - f.high, m, f.kappa), f.high_slope, g >= 0);
    if (f.low > -never) wall(-path.along(g - f.low, m, f.kappa), f.low_slope, g < 0);
    return first;
}

/// Where a way first goes into what the feature forbids; as `sinks`, from anywhere. A way comes
/// beside the feature across one of its borders; a round one also comes back.
inline double meets(const Feature& f, const Way& path, double most, const Heights& h,
                    bool& touching) noexcept {
    touching = false;
    const bool here = f.beside(path.x, 0);
    double first = here ? sinks(f, path, most, h, touching) : never;
    if (here && path.q == 0) return first;
    for (const Border& b : f.border) {
        const double t = path.along(b.beyond(path.x), b.way, 0).falls();
        if (!(t <= most && t < first && f.beside(path.at(t), h.slack))) continue;
        bool touches = false;
        const double s = path.on(t, sinks(f, path.from(t), most, h, touches));
        if (s <= most && s < first) first = s, touching = touches;
    }
    return first;
}

}  // namespace vfplan::curve
