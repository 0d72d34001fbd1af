// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The normal of a sampled surface under the proxy: a plane fitted to the points around its foot.
//
// A mean of directions, eq. (1), leans towards wherever there are more points: away from a wall or
// a border. A plane does not, whether or not the sampling is even.
#pragma once

#include "vfplan/lanes.hpp"

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

/// Unit normal of the plane through the points behind `m`, taken in the frame of `p`. Across a
/// direction in which the points do not extend (a curve in space) it stays as it is.
template <int D>
Vec<D> plane_normal(const Patch<D>& p, const Moments<D>& m) noexcept {
    constexpr double ridge = 1e-3;
    if (!(m.w > 0)) return p.up;
    double a[D - 1], ss[D - 1];
    for (int k = 0; k < D - 1; ++k) {
        a[k] = m.sz[k] - m.s[k] * m.z / m.w;
        ss[k] = m.ss[k] - m.s[k] * m.s[k] / m.w;
    }
    Vec<D> n = p.up;
    if constexpr (D == 2) {
        if (ss[0] > 0) n = n - (a[0] / (ss[0] * (1 + ridge))) * p.side[0];
    } else {
        const double st = m.ss[2] - m.s[0] * m.s[1] / m.w, r = ridge * (ss[0] + ss[1]);
        const double g = ss[0] + r, h = ss[1] + r, det = g * h - st * st;
        if (det > 0)
            n = n - ((a[0] * h - a[1] * st) / det) * p.side[0] -
                ((a[1] * g - a[0] * st) / det) * p.side[1];
    }
    return along(n, 1);
}

/// n, turned towards the unit vector `axis` where it is off by more than the angle of `cosine`.
template <int D>
Vec<D> within_cone(const Vec<D>& n, const Vec<D>& axis, double cosine) noexcept {
    const double c = dot(n, axis);
    if (c >= cosine) return n;
    const Vec<D> off = n - c * axis;
    const double length = norm(off);
    if (!(length > 1e-9)) return axis;
    return cosine * axis + (std::sqrt(1 - cosine * cosine) / length) * off;
}

}  // namespace vfplan
