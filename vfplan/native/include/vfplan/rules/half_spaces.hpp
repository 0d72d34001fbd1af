// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The step nearest to a wished one that keeps to every plane: argmin |v - u| subject to
// n_j . v >= lift_j.
#pragma once

#include "vfplan/base/vec.hpp"

namespace vfplan::inline v1 {

/// What a surface offers the proxy: a unit normal, and how far along it the proxy has to go at
/// least.
template <int D>
struct ContactPlane {
    Vec<D> normal;
    double lift = 0;  ///< [m]; below 0 where the proxy may sink
};

namespace detail {

template <int D>
bool keeps_to(const Vec<D>& v, const ContactPlane<D>* planes, int count, double slack) noexcept {
    for (int j = 0; j < count; ++j)
        if (!(dot(planes[j].normal, v) >= planes[j].lift - slack)) return false;
    return true;
}

inline double determinant(const double (&m)[3][3]) noexcept {
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
           m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

/// The place nearest to u on k <= 3 planes at once, by Cramer's rule on the Gram matrix of their
/// normals. False where its determinant is `flattest` or less: two normals are nearly parallel.
template <int D>
bool on_planes(const Vec<D>& u, const ContactPlane<D>* const* planes, int k, double flattest,
               Vec<D>& v) noexcept {
    double gram[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    double missing[3] = {};
    for (int i = 0; i < k; ++i) {
        missing[i] = planes[i]->lift - dot(planes[i]->normal, u);
        for (int j = 0; j < k; ++j) gram[i][j] = dot(planes[i]->normal, planes[j]->normal);
    }
    const double all = determinant(gram);
    if (!(all > flattest)) return false;
    v = u;
    for (int i = 0; i < k; ++i) {
        double replaced[3][3];
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) replaced[a][b] = b == i ? missing[a] : gram[a][b];
        v = v + (determinant(replaced) / all) * planes[i]->normal;
    }
    return true;
}

}  // namespace detail

/// How many choices of at most D planes `nearest_step` tries of `count` planes, which is what it
/// costs.
template <int D>
constexpr int plane_choices(int count) noexcept {
    const int pairs = count * (count - 1) / 2;
    const int triples = D == 3 ? pairs * (count - 2) / 3 : 0;
    return count + pairs + triples;
}

/// The nearest step among all choices of at most D planes that it may lie on; 0 when the planes
/// leave none. `slack`: by how much a step may miss a plane through rounding [m].
template <int D>
Vec<D> nearest_step(const Vec<D>& u, const ContactPlane<D>* planes, int count, double slack,
                    double flattest = 1e-9) noexcept {
    if (detail::keeps_to(u, planes, count, slack)) return u;
    Vec<D> best;
    double best_square = -1;
    const auto try_planes = [&](const ContactPlane<D>* const* chosen, int k) noexcept {
        Vec<D> v;
        if (!detail::on_planes(u, chosen, k, flattest, v)) return;
        const Vec<D> change = v - u;
        const double square = dot(change, change);
        if (best_square >= 0 && square >= best_square) return;
        if (!detail::keeps_to(v, planes, count, slack)) return;
        best = v;
        best_square = square;
    };
    const ContactPlane<D>* chosen[3];
    for (int i = 0; i < count; ++i) {
        chosen[0] = &planes[i];
        try_planes(chosen, 1);
        for (int j = i + 1; j < count; ++j) {
            chosen[1] = &planes[j];
            try_planes(chosen, 2);
            if constexpr (D == 3) {
                for (int k = j + 1; k < count; ++k) {
                    chosen[2] = &planes[k];
                    try_planes(chosen, 3);
                }
            }
        }
    }
    return best;
}

}  // namespace vfplan::inline v1
