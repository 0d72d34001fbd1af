// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What lies R from a line, an arc, or a joint of two, and where a path of constant curvature meets
// it. The numbers in brackets are the equations of docs/exact.md.
//
// A path starts at x along the unit vector T, with N to the left of it and curvature k. With
// t = tan(k s / 2) / (k / 2), which is the arc length s where k is 0,
//
//     w(t) = (t T + q t^2 N) / (1 + q^2 t^2),   q = k / 2, (E1)
//
// so that a line and a circle, of any curvature, meet the path at the roots of one quadratic.
// Nothing here takes an angle or a centre: a piece may be as nearly straight as it likes.
//
// What a proxy of radius R can touch of a curve is the side of a line or of an arc, and the ball
// around a joint. With w = y - base and G(y) = kappa |w|^2 / 2 - n . w, all three are one: (E5)
//
//     line   kappa = 0, n its unit normal:           G is the signed distance
//     arc    kappa > 0, n at base to the centre:     G = d + kappa d^2 / 2, d > 0 outside
//     joint  kappa = 1, n = 0:                       G = d^2 / 2
//
// A side forbids lower < G < upper between the normals at its two ends, a joint G < upper
// everywhere.
#pragma once

#include "vfplan/base/vec.hpp"
#include "vfplan/rules/constants.hpp"

namespace vfplan::inline v1::curve {

/// a t^2 + b t + c: what of a function of the place is left after the factor 1 + q^2 t^2 > 0.
struct Quadratic {
    double a, b, c;

    Quadratic operator-() const noexcept { return {-a, -b, -c}; }

    /// The t >= 0 at which it falls through 0, or infinity.
    double first_descent() const noexcept {
        const double square = b * b - 4 * a * c;
        if (!(square >= 0)) return infinity;
        const double root = std::sqrt(square);
        double t = infinity;
        if (b > 0)
            t = -(b + root) / (2 * a);
        else if (root > b)
            t = 2 * c / (root - b);
        return t >= 0 ? t : infinity;
    }
};

/// A line or a part of a circle that starts at x along T.
struct ArcPath {
    Vec2 x, T, N;
    double q = 0;  ///< half the curvature [1/m], positive to the left

    ArcPath(const Vec2& from, const Vec2& tangent, double half_curvature) noexcept
        : x(from), T(tangent), N(left(tangent)), q(half_curvature) {}

    Vec2 at(double t) const noexcept { return x + (t / (1 + q * q * t * t)) * (T + (q * t) * N); }

    /// The rest of the path, from t on.
    ArcPath rest_from(double t) const noexcept {
        const double turn = q * t;
        const double share = 1 / (1 + turn * turn);
        return {at(t), (share * (1 - turn * turn)) * T + (share * 2 * turn) * N, q};
    }
    /// The parameter of the place that is `more` on the rest of the path from t on.
    double parameter_after(double t, double more) const noexcept {
        if (!(more < infinity)) return infinity;
        const double share = 1 - q * q * t * more;
        return share > 0 ? (t + more) / share : infinity;
    }

    /// A quarter of the circle: t measures no more than half of it well.
    double quarter() const noexcept { return q == 0 ? infinity : 1 / std::abs(q); }

    /// G - c along the path, times 1 + q^2 t^2, for a constant c. `value` is G - c at the start of
    /// the path, m the gradient of G there, and kappa that of G. (E5)
    Quadratic quadratic_along(double value, const Vec2& m, double kappa) const noexcept {
        return {q * (q * value + dot(m, N)) + kappa / 2, dot(m, T), value};
    }

    /// Where the path is nearest to x + to_hip; to_hip . T > 0. (E2)
    double nearest(const Vec2& to_hip) const noexcept {
        const double a = 1 - 2 * q * dot(to_hip, N);
        const double b = dot(to_hip, T);
        const double root = std::sqrt(a * a + 4 * b * b * q * q);
        return a >= 0 ? 2 * b / (a + root) : (root - a) / (2 * b * q * q);
    }

    /// Where x + to_hip comes into sight from a path round what lies on its side away from the unit
    /// normal n = +- N. (E3)
    double in_sight(const Vec2& to_hip, const Vec2& n) const noexcept {
        const double side = dot(n, N);
        const double p = dot(to_hip, N);
        const Quadratic hidden{q - q * q * p, -2 * q * dot(to_hip, T), p};
        return side > 0 ? (-hidden).first_descent() : hidden.first_descent();
    }
};

/// The normal at an end of a feature, as a line: the feature lies on the one side of it, the next
/// feature on the other.
struct EndNormal {
    Vec2 at;
    Vec2 outwards;  ///< unit vector out of the feature; 0 where the feature goes on for ever
    int next = -1;  ///< number of the feature beyond; -1 where there is none

    /// How far y lies beyond the end [m].
    double distance_beyond(const Vec2& y) const noexcept { return dot(y - at, outwards); }
    /// Where a path that starts beside the feature passes this end. (E4)
    double passed_at(const ArcPath& path) const noexcept {
        // One that starts beyond it by a rounding, and leads on, passes it at once.
        const double start = std::min(distance_beyond(path.x), 0.0);
        return (-path.quadratic_along(start, outwards, 0)).first_descent();
    }
};

/// How a feature touches the proxy.
struct FeatureContact {
    Vec2 normal;       ///< unit vector from the curve to the proxy
    double distance;   ///< [m]
    double curvature;  ///< of what lies as far from the curve, positive round it [1/m]
};

/// The side of a piece, or a joint.
struct Feature {
    Vec2 base, n;
    double kappa = 0;
    double upper = 0, lower = -infinity;      ///< values of G between which the proxy must not be
    double upper_slope = 0, lower_slope = 0;  ///< dG/dd at these values
    EndNormal ends[2];
    Box<2> box;  ///< around the piece

    bool is_joint() const noexcept { return n[0] == 0 && n[1] == 0; }
    /// G at y, and its gradient there.
    std::pair<double, Vec2> G(const Vec2& y) const noexcept {
        const Vec2 w = y - base;
        return {kappa * dot(w, w) / 2 - dot(n, w), kappa * w - n};
    }
    /// Whether y lies between the normals at the ends, or beyond them by no more than `slack` [m].
    bool faces(const Vec2& y, double slack) const noexcept {
        return ends[0].distance_beyond(y) <= slack && ends[1].distance_beyond(y) <= slack;
    }

    /// The contact with a proxy at y, which the feature faces and which does not lie on it.
    FeatureContact contact(const Vec2& y) const noexcept {
        const auto [g, gradient] = G(y);
        const double slope = norm(gradient);
        if (is_joint()) return {(1 / slope) * gradient, slope, 1 / slope};
        const double side = g >= 0 ? 1 : -1;
        return {(side / slope) * gradient, side * 2 * g / (1 + slope), side * kappa / slope};
    }

    /// Distance of y from the piece where the feature faces y, else infinity [m].
    double distance(const Vec2& y) const noexcept {
        return is_joint() || faces(y, 0) ? contact(y).distance : infinity;
    }

    /// Whether a step from the centre of a hollow arc as wide as the proxy leads into it anywhere.
    bool leads_into_full_hollow(const Vec2& step) const noexcept {
        const Vec2 start_tangent = -1.0 * ends[0].outwards;
        const double side = dot(n, left(start_tangent));
        return dot(step, n) < -tuned::along_sine ||
               side * dot(step, left(ends[1].outwards)) < -tuned::along_sine;
    }

    /// Where a path that starts in what the feature forbids comes out of it.
    double exit_parameter(const ArcPath& path) const noexcept {
        const auto [g, gradient] = G(path.x);
        double t = (-path.quadratic_along(g - upper, gradient, kappa)).first_descent();
        if (is_joint()) return t;
        if (lower > -infinity)
            t = std::min(t, path.quadratic_along(g - lower, gradient, kappa).first_descent());
        for (const EndNormal& end : ends) t = std::min(t, end.passed_at(path));
        return t;
    }
};

/// What roundings may do at the height R [m].
struct RoundingLimits {
    double start_slack;  ///< a path that starts at the height has to get past its own start
    double max_sink;     ///< what has sunk so far may not sink by a further `start_slack`
    double full_hollow;  ///< a hollow that leaves the proxy less room than that is full
};

/// Where a path goes into what a feature forbids.
struct Entry {
    double t = infinity;       ///< the parameter of the place [m]
    bool is_touching = false;  ///< whether the path starts at the height, or by roundings below
};

/// Where a path that the feature faces first descends below what the feature allows, up to
/// `max_t`. One that is touching is let go on until it is lower by `start_slack`. (E5)
inline Entry descends_below(const Feature& f, const ArcPath& path, double max_t,
                            const RoundingLimits& limits) noexcept {
    const auto [g, gradient] = f.G(path.x);
    const bool is_hollow_full = f.lower_slope < f.kappa * limits.full_hollow;
    Entry first;
    if (is_hollow_full && norm(gradient) < f.kappa * limits.full_hollow) {
        if (f.leads_into_full_hollow(path.T)) first = {0, true};
        return first;
    }
    const auto descend = [&](Quadratic height, double slope, bool is_this_side) noexcept {
        const bool starts_there = is_this_side && height.c < limits.start_slack * slope;
        if (starts_there) {
            if (height.b >= 0 && height.a >= 0) return;
            if (height.c > -limits.max_sink * slope)
                height.c = limits.start_slack * slope;
            else if (height.b < 0)
                height.c = 0;
        }
        const double t = height.first_descent();
        if (!(t <= max_t && t < first.t && f.faces(path.at(t), limits.start_slack))) return;
        first = {t, starts_there};
    };
    descend(path.quadratic_along(g - f.upper, gradient, f.kappa), f.upper_slope, g >= 0);
    if (f.lower > -infinity)
        descend(-path.quadratic_along(g - f.lower, gradient, f.kappa), f.lower_slope, g < 0);
    return first;
}

/// Where a path first goes into what the feature forbids; as `descends_below`, from anywhere. A
/// path comes to face the feature across one of its ends; a round one also comes back. (E5)
inline Entry first_entry(const Feature& f, const ArcPath& path, double max_t,
                         const RoundingLimits& limits) noexcept {
    const bool faces_start = f.faces(path.x, 0);
    Entry first;
    if (faces_start) first = descends_below(f, path, max_t, limits);
    if (faces_start && path.q == 0) return first;
    for (const EndNormal& end : f.ends) {
        const double t =
            path.quadratic_along(end.distance_beyond(path.x), end.outwards, 0).first_descent();
        if (!(t <= max_t && t < first.t && f.faces(path.at(t), limits.start_slack))) continue;
        const Entry more = descends_below(f, path.rest_from(t), max_t, limits);
        const double entry = path.parameter_after(t, more.t);
        if (entry <= max_t && entry < first.t) first = {entry, more.is_touching};
    }
    return first;
}

}  // namespace vfplan::inline v1::curve
