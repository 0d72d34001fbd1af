// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The normal of a sampled surface under the proxy: a quadric fitted to the points around its foot.
//
// A mean of directions, eq. (1), leans towards wherever there are more points: away from a wall or
// a border. A fit does not, whether or not the sampling is even.
#pragma once

#include "vfplan/lanes.hpp"
#include "vfplan/tuned.hpp"

namespace vfplan {

template <int D>
void frame(const Vec<D>& up, Vec<D> (&side)[D - 1]) noexcept {
    if constexpr (D == 2) {
        side[0] = {{-up.c[1], up.c[0]}};
    } else {
        int least = 0;
        for (int k = 1; k < 3; ++k)
            if (std::abs(up.c[k]) < std::abs(up.c[least])) least = k;
        Vec<D> axis;
        axis.c[least] = 1;
        side[0] = along(axis - dot(axis, up) * up, 1);
        side[1] = cross(up, side[0]);
    }
}

/// Turns the slopes of a quadric right under the proxy into those at its foot, where the normal
/// goes through the proxy: m -> (1 + 2 h Q)⁻¹ m for bends Q and height h.
template <int D>
void to_foot(double* x, double h) noexcept {
    constexpr double least = tuned::narrowest;
    if constexpr (D == 2) {
        x[1] /= std::max(1 + 2 * h * x[2], least);
    } else {
        const double a = 1 + 2 * h * x[3], b = 1 + 2 * h * x[4], c = h * x[5];
        const double det = a * b - c * c;
        if (!(a > least && b > least && det > least * least)) return;
        const double s = (b * x[1] - c * x[2]) / det, t = (a * x[2] - c * x[1]) / det;
        x[1] = s;
        x[2] = t;
    }
}

template <int D>
struct Fit {
    Vec<D> n;        ///< unit normal
    double off = 0;  ///< how far the points' centre is from the foot [length unit of the patch]
    /// Second derivatives of the depth below the proxy, ss (tt st): above 0 on a bulge [1 / that].
    double bend[D == 2 ? 1 : 3] = {};
};

/// The quadric through the points behind `m`, over the proxy, in the frame of `p`. Across a
/// direction in which the points do not extend (a curve in space) the normal stays `p.up`.
template <int D>
Fit<D> fit(const Patch<D>& p, const Moments<D>& m) noexcept {
    constexpr int terms = Moments<D>::terms;
    constexpr double flat = 1e-7, bent = 1e-4;  // ridges: slopes only if seen, bends only if needed
    const double weight = m.a[0];
    if (!(weight > 0)) return {p.up};
    double l[terms][terms] = {}, d[terms], x[terms];
    for (int r = 0, n = 0; r < terms; ++r)  // the lower triangle of the normal equations
        for (int c = r; c < terms; ++c, ++n) l[c][r] = m.a[n];
    for (int r = 1; r < terms; ++r)  // st counts half: so the frame's turn does not matter
        l[r][r] += weight * (r < D ? flat : r < 5 ? bent : 0.5 * bent);
    for (int j = 0; j < terms; ++j) {  // L D Lᵀ
        d[j] = l[j][j];
        for (int k = 0; k < j; ++k) d[j] -= l[j][k] * l[j][k] * d[k];
        if (!(d[j] > 0)) return {p.up};
        for (int i = j + 1; i < terms; ++i) {
            for (int k = 0; k < j; ++k) l[i][j] -= l[i][k] * l[j][k] * d[k];
            l[i][j] /= d[j];
        }
    }
    for (int i = 0; i < terms; ++i) {
        x[i] = m.z[i];
        for (int k = 0; k < i; ++k) x[i] -= l[i][k] * x[k];
    }
    for (int i = terms - 1; i >= 0; --i) {
        x[i] /= d[i];
        for (int k = i + 1; k < terms; ++k) x[i] -= l[k][i] * x[k];
    }
    const double h = p.height * p.scale;
    to_foot<D>(x, h);
    Vec<D> n = p.up;
    double off2 = 0;
    for (int k = 0; k < D - 1; ++k) {
        n = n - x[1 + k] * p.side[k];
        const double off = m.a[1 + k] / weight + h * x[1 + k];
        off2 += off * off;
    }
    if constexpr (D == 2) return {along(n, 1), std::sqrt(off2), {2 * x[2]}};
    if constexpr (D == 3) return {along(n, 1), std::sqrt(off2), {2 * x[3], 2 * x[4], x[5]}};
}

/// n where it leans no more than the angle of sine `lean` from the unit vector `axis`; `axis`
/// itself from twice that on, for then the proxy rests on an edge, not on a surface; gradually
/// between.
template <int D>
Vec<D> lean_at_most(const Vec<D>& n, const Vec<D>& axis, double lean) noexcept {
    const double c = dot(n, axis);
    const Vec<D> off = n - c * axis;
    const double sine = norm(off);
    if (c > 0 && sine <= lean) return n;
    if (!(c > 0) || sine >= 2 * lean) return axis;
    const double s = 2 * lean - sine;
    return std::sqrt(1 - s * s) * axis + (s / sine) * off;
}

}  // namespace vfplan
