// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Ways of constant curvature in the plane: what a proxy goes along, straight or round.
//
// Where a way from x begins along the unit vector T, with N to the left of it and curvature k, and
// t = tan(k s / 2) / (k / 2) measures how far it has gone (t is the arc length s where k is 0),
//
//     w(t) = (t T + q t² N) / (1 + q² t²),   q = k / 2,
//
// so that a line and a circle, of any curvature, meet the way at the roots of one quadratic.
// Nothing here takes an angle or a centre: a piece may bend as little as it likes.
#pragma once

#include <cmath>
#include <limits>

#include "vfplan/vec.hpp"

namespace vfplan::curve {

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

}  // namespace vfplan::curve
