// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Vectors of two or three coordinates. Two are enough where the fixture ignores an axis.
#pragma once

#include <cmath>

#include "vfplan/portable.hpp"

namespace vfplan {

template <int D>
struct Vec {
    static_assert(D == 2 || D == 3);
    double c[D] = {};

    // A template, so that an index of any integer type is taken as it is.
    template <class Index>
    double& operator[](Index i) noexcept {
        return c[i];
    }
    template <class Index>
    double operator[](Index i) const noexcept {
        return c[i];
    }
};

using Vec2 = Vec<2>;
using Vec3 = Vec<3>;

template <int D>
Vec<D> operator+(const Vec<D>& a, const Vec<D>& b) noexcept {
    Vec<D> r;
    for (int k = 0; k < D; ++k) r.c[k] = a.c[k] + b.c[k];
    return r;
}
template <int D>
Vec<D> operator-(const Vec<D>& a, const Vec<D>& b) noexcept {
    Vec<D> r;
    for (int k = 0; k < D; ++k) r.c[k] = a.c[k] - b.c[k];
    return r;
}
template <int D>
Vec<D> operator*(double s, const Vec<D>& a) noexcept {
    Vec<D> r;
    for (int k = 0; k < D; ++k) r.c[k] = s * a.c[k];
    return r;
}
template <int D>
bool operator==(const Vec<D>& a, const Vec<D>& b) noexcept {
    for (int k = 0; k < D; ++k)
        if (a.c[k] != b.c[k]) return false;
    return true;
}
template <int D>
double dot(const Vec<D>& a, const Vec<D>& b) noexcept {
    double sum = a.c[0] * b.c[0];
    for (int k = 1; k < D; ++k) sum += a.c[k] * b.c[k];
    return sum;
}
template <int D>
double norm(const Vec<D>& a) noexcept {
    return std::sqrt(dot(a, a));
}
inline Vec3 cross(const Vec3& a, const Vec3& b) noexcept {
    return {{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]}};
}
/// d v / |v|; 0 when v is 0.
template <int D>
Vec<D> along(const Vec<D>& v, double d) noexcept {
    const double length = norm(v);
    return length > 0 ? (d / length) * v : Vec<D>{};
}

}  // namespace vfplan
