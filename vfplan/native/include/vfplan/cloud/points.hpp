// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The cloud of points, and the loops over them: eight points at a time, whatever the processor. The
// loops exist once, in kernels.inl,
// and are compiled for the baseline and, on x86-64, for AVX2 and AVX-512. The width is chosen once
// in a program. All widths keep eight partial sums, add them in one order and use only correctly
// rounded operations, so they give the same bits.
#pragma once

#include <cstring>

#include "vfplan/base/vec.hpp"

namespace vfplan::inline v1 {

/// How many float64 the processor's registers are asked to hold.
enum class Width { two = 2, four = 4, eight = 8 };

/// Points stored as one array a coordinate. Seven doubles behind the last may be read.
template <int D>
struct PointSpan {
    const double* c[D] = {};
    std::size_t n = 0;

    /// The first `count` of them, which are then left out.
    PointSpan take(std::size_t count) noexcept {
        PointSpan part = *this;
        part.n = std::min(count, n);
        for (int k = 0; k < D; ++k) c[k] += part.n;
        n -= part.n;
        return part;
    }
    Vec<D> operator[](std::size_t i) const noexcept {
        Vec<D> p;
        for (int k = 0; k < D; ++k) p.c[k] = c[k][i];
        return p;
    }
};

namespace detail {

inline constexpr double far_away = 1e15;  // coordinate of a lane without a point
inline constexpr double lane_numbers[8] = {0, 1, 2, 3, 4, 5, 6, 7};

}  // namespace detail

/// The cloud: one array a coordinate, in an order of the owner's choice, which may be read seven
/// doubles past the end, as PointSpan asks.
template <int D>
class Cloud {
  public:
    Cloud() = default;
    explicit Cloud(std::size_t n) : n_(n) {
        Line line;
        std::fill_n(line.x, 8, detail::far_away);
        for (auto& axis : axes_) axis.assign(n / 8 + 2, line);
    }

    std::size_t size() const noexcept { return n_; }
    void set(std::size_t i, const Vec<D>& p) noexcept {
        for (int k = 0; k < D; ++k) axis(k)[i] = p.c[k];
    }
    /// A lane without a point: no loop sees it.
    void clear(std::size_t i) noexcept { set(i, filled<D>(detail::far_away)); }
    Vec<D> operator[](std::size_t i) const noexcept { return span(i, i + 1)[0]; }
    PointSpan<D> span(std::size_t begin, std::size_t end) const noexcept {
        PointSpan<D> s;
        for (int k = 0; k < D; ++k)
            s.c[k] = reinterpret_cast<const double*>(axes_[k].data()) + begin;
        s.n = end - begin;
        return s;
    }
    double* axis(int k) noexcept { return reinterpret_cast<double*>(axes_[k].data()); }
    std::size_t bytes() const noexcept { return D * sizeof(Line) * axes_[0].capacity(); }

    Box<D> box() const noexcept {
        Box<D> b;
        const PointSpan<D> all = span(0, n_);
        for (int k = 0; k < D; ++k) {
            const auto [low, high] = std::minmax_element(all.c[k], all.c[k] + n_);
            b.low.c[k] = *low;
            b.high.c[k] = *high;
        }
        return b;
    }

  private:
    struct alignas(64) Line {  // as wide as a register: a load lies in one line of the cache
        double x[8];
    };

    std::size_t n_ = 0;
    std::vector<Line> axes_[D];
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

/// What eq. (1) adds up, over how many points, and the nearest distance on the way.
template <int D>
struct NormalSum {
    Vec<D> sum;
    std::size_t count = 0;
    double nearest2 = infinity;
};

/// Sums of the special case 2 of Algorithm 2.
struct Distances {
    double to_proxy = 0, to_hip = 0, count = 0;
};

/// A straight way from `from` along the unit vector `direction`; see Kernels::ray_hit.
template <int D>
struct Ray {
    Vec<D> from, direction;
    double outer2;  ///< R²: a sphere met steeply stops the proxy here
    double inner2;  ///< a sphere grazed stops it only here
    double steep2;  ///< (sine of the angle to the surface · R)² above which a meeting is steep
};

/// Normal equations of a weighted fit of heights: z over [1 s ss] or [1 s t ss tt st], s and t the
/// lateral positions. The upper triangle, row by row.
template <int D>
struct NormalEquations {
    static constexpr int terms = D == 2 ? 3 : 6;
    double a[terms * (terms + 1) / 2] = {}, z[terms] = {};
};

/// Which points count for a fit, and how much; see Kernels::accumulate_fit.
template <int D>
struct FitWindow {
    Vec<D> at, up, side[D - 1];
    double height;   ///< subtracted from z
    double scale;    ///< 1 / length unit of s, t and z
    double inner2;   ///< weight 1 at this squared distance ...
    double outer2;   ///< ... and 0 from this one on
    double cosine2;  ///< points further off `up` do not count
};

/// The loops over points, for one width.
template <int D>
struct Kernels {
    /// Copies the points of `in` within sqrt(reach2) of x to `out`; returns how many. Up to eight
    /// places behind them are written too.
    std::size_t (*gather)(const PointSpan<D>& in, const Vec<D>& x, double reach2,
                          double* const* out);
    /// Smallest squared distance to x.
    double (*nearest2)(const PointSpan<D>& in, const Vec<D>& x);
    /// Eqs. (1) and (2).
    void (*normal)(const PointSpan<D>& in, const Vec<D>& x, double r1, double r3, NormalSum<D>& to);
    /// Eq. (3): smallest root that is not negative over the points within sqrt(reach2).
    double (*first_root_eq3)(const PointSpan<D>& in, const Vec<D>& x, const Vec<D>& way,
                             double reach2, double radius2);
    /// Distances of the points within sqrt(reach2) of x to x and to hip.
    void (*distances)(const PointSpan<D>& in, const Vec<D>& x, const Vec<D>& hip, double reach2,
                      Distances& to);
    /// Eq. (7): largest root over the points within sqrt(entrenched2).
    double (*last_root_eq7)(const PointSpan<D>& in, const Vec<D>& x, const Vec<D>& n,
                            double entrenched2, double radius2);
    /// How far a ray gets before it meets a sphere; infinity when it meets none.
    double (*ray_hit)(const PointSpan<D>& in, const Ray<D>& ray);
    /// Numbers of the points within sqrt(reach2); returns how many there are.
    std::size_t (*indices_within)(const PointSpan<D>& in, const Vec<D>& x, double reach2,
                                  std::uint32_t* to);
    void (*accumulate_fit)(const PointSpan<D>& in, const FitWindow<D>& patch,
                           NormalEquations<D>& to);
};

/// The widest the processor at hand can run.
VFPLAN_ONCE Width widest() noexcept;
/// The loops in use.
template <int D>
inline Kernels<D> kernels{};
/// Takes the widest loops, where there are none yet; who makes an index of points calls it.
VFPLAN_ONCE void choose_kernels() noexcept;
/// For tests, before any tick: takes the loops of another width for all engines of the program, or
/// the widest where the processor lacks it. Who calls it sets `widest()` again.
VFPLAN_ONCE void use_width(Width width) noexcept;

}  // namespace vfplan::inline v1

#if !defined(VFPLAN_COMPILED) || defined(VFPLAN_COMPILING)
#include "vfplan/cloud/widths.inl"
#endif
