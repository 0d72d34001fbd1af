// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The step nearest to a wished one that keeps to every wall: argmin |v - u| with n_j · v >= lift_j.
#pragma once

#include "vfplan/base/vec.hpp"

namespace vfplan {

/// A surface that holds the proxy: unit normal n, and how far along it the proxy has to go at
/// least.
template <int D>
struct Wall {
    Vec<D> n;
    double lift = 0;  // [m]
};

namespace detail {

template <int D>
bool keeps(const Vec<D>& v, const Wall<D>* walls, int count, double slack) noexcept {
    for (int j = 0; j < count; ++j)
        if (!(dot(walls[j].n, v) >= walls[j].lift - slack)) return false;
    return true;
}

/// Nearest to u on the intersection of k <= 3 walls' planes, by Cramer's rule on their Gram matrix;
/// false where its determinant is `flattest` or less: two of them are nearly parallel.
template <int D>
bool on_planes(const Vec<D>& u, const Wall<D>* const* w, int k, double flattest,
               Vec<D>& v) noexcept {
    double g[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, r[3] = {};
    for (int i = 0; i < k; ++i) {
        r[i] = w[i]->lift - dot(w[i]->n, u);
        for (int j = 0; j < k; ++j) g[i][j] = dot(w[i]->n, w[j]->n);
    }
    const auto determinant = [](const double (&m)[3][3]) noexcept {
        return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
               m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
               m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    };
    const double all = determinant(g);
    if (!(all > flattest)) return false;
    v = u;
    for (int i = 0; i < k; ++i) {
        double m[3][3];
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) m[a][b] = b == i ? r[a] : g[a][b];
        v = v + (determinant(m) / all) * w[i]->n;
    }
    return true;
}

}  // namespace detail

/// The nearest allowed step among all choices of at most D walls; 0 when the walls leave none.
template <int D>
Vec<D> project(const Vec<D>& u, const Wall<D>* walls, int count, double slack,
               double flattest = 1e-9) noexcept {
    if (detail::keeps(u, walls, count, slack)) return u;
    Vec<D> best;
    double least = -1;
    const auto offer = [&](const Wall<D>* const* chosen, int k) noexcept {
        Vec<D> v;
        if (!detail::on_planes(u, chosen, k, flattest, v)) return;
        const Vec<D> off = v - u;
        const double distance = dot(off, off);
        if (least >= 0 && distance >= least) return;
        if (!detail::keeps(v, walls, count, slack)) return;
        best = v;
        least = distance;
    };
    const Wall<D>* w[3];
    for (int i = 0; i < count; ++i) {
        w[0] = &walls[i];
        offer(w, 1);
        for (int j = i + 1; j < count; ++j) {
            w[1] = &walls[j];
            offer(w, 2);
            if constexpr (D == 3)
                for (int k = j + 1; k < count; ++k) {
                    w[2] = &walls[k];
                    offer(w, 3);
                }
        }
    }
    return best;
}

}  // namespace vfplan
