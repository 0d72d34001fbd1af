// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The cloud: one array a coordinate, in an order of the owner's choice, and the box around it.
#pragma once

#include "vfplan/cloud/kernels.hpp"

namespace vfplan::inline v1 {

/// Points in arrays that may be read seven doubles past the end, as PointSpan asks.
template <int D>
class Cloud {
  public:
    static constexpr std::size_t spare = 8;

    Cloud() = default;
    explicit Cloud(std::size_t n) : n_(n) {
        for (auto& axis : axes_) axis.assign(n + spare, detail::far_away);
    }

    std::size_t size() const noexcept { return n_; }
    void set(std::size_t i, const Vec<D>& p) noexcept {
        for (int k = 0; k < D; ++k) axes_[k][i] = p.c[k];
    }
    /// A lane without a point: no loop sees it.
    void clear(std::size_t i) noexcept { set(i, filled<D>(detail::far_away)); }
    Vec<D> operator[](std::size_t i) const noexcept { return span(i, i + 1)[0]; }
    PointSpan<D> span(std::size_t begin, std::size_t end) const noexcept {
        PointSpan<D> s;
        for (int k = 0; k < D; ++k) s.c[k] = axes_[k].data() + begin;
        s.n = end - begin;
        return s;
    }
    double* axis(int k) noexcept { return axes_[k].data(); }
    std::size_t bytes() const noexcept { return D * sizeof(double) * axes_[0].capacity(); }

    Box<D> box() const noexcept {
        Box<D> b;
        for (int k = 0; k < D; ++k) {
            const auto [low, high] = std::minmax_element(axes_[k].data(), axes_[k].data() + n_);
            b.low.c[k] = *low;
            b.high.c[k] = *high;
        }
        return b;
    }

  private:
    std::size_t n_ = 0;
    std::vector<double> axes_[D];
};

/// Throws std::invalid_argument for a coordinate that is not finite or beyond 1e6 m, with its
/// value.
inline void check_coordinates(const double* xyz, std::size_t n) {
    for (std::size_t i = 0; i < 3 * n; ++i)
        if (!(std::abs(xyz[i]) <= largest_coordinate))
            reject("point " + std::to_string(i / 3) + " has the coordinate " + shown(xyz[i]) +
                   " m. Give finite coordinates of at most 1e6 m.");
}

/// The cloud of n points of three coordinates each, as seen in `space`. Throws
/// std::invalid_argument on an empty cloud, more than 2^32 - 2 points, or a coordinate that is not
/// finite or beyond 1e6 m.
template <class S>
Cloud<S::dimension> make_cloud(const S& space, const double* xyz, std::size_t n) {
    if (n == 0) reject("the cloud has no point. Give at least one.");
    if (n >= std::numeric_limits<std::uint32_t>::max())
        reject("the cloud has " + std::to_string(n) + " points. Give at most 2^32 - 2.");
    check_coordinates(xyz, n);
    Cloud<S::dimension> cloud(n);
    for (std::size_t i = 0; i < n; ++i) cloud.set(i, space.project(point_at(xyz, i)));
    return cloud;
}

}  // namespace vfplan::inline v1
