// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// How crowded a cloud is, and which of its points can never be felt.
#pragma once

#include <bit>

#include "vfplan/cloud/points.hpp"
#include "vfplan/parameters.hpp"
#include "vfplan/rules/half_spaces.hpp"

namespace vfplan::inline v1 {

// How much lies close together: the largest number of points, or of boxes, around any one place.

/// The largest number of boxes within `reach` of any place, or a few more than that. `box(i)` gives
/// the i-th of n boxes, and `weights`, if given, as how many it counts.
///
/// A grid counts them. Each box, wider by `reach` on all sides, adds its weight at its corners, or
/// takes it away. Sums along one axis after another then give each cell the number of boxes that
/// cover it. The grid has at most `max_cells` cells: their side grows until there are so few.
template <int D, class BoxOf>
double most_within(std::size_t n, const BoxOf& box, double reach, double max_cells,
                   const std::uint32_t* weights = nullptr) {
    Box<D> all;
    for (std::size_t i = 0; i < n; ++i) all.include(box(i));
    double side = reach / 4;
    const auto count = [&](int k) { return std::floor((all.high.c[k] - all.low.c[k]) / side) + 1; };
    const auto cells = [&] {
        double product = 1;
        for (int k = 0; k < D; ++k) product *= count(k);
        return product;
    };
    while (cells() > max_cells) side *= 1.25;
    std::size_t stride[D + 1] = {1};
    double last[D];
    for (int k = 0; k < D; ++k) {
        last[k] = count(k) - 1;
        stride[k + 1] = stride[k] * (static_cast<std::size_t>(last[k]) + 2);
    }
    const auto cell = [&](double place, int k) {
        const double at = std::clamp((place - all.low.c[k]) / side, 0.0, last[k]);
        return static_cast<std::size_t>(at) * stride[k];
    };
    // Unsigned: what falls below 0 on the way comes back.
    std::vector<std::uint32_t> sum(stride[D]);
    for (std::size_t i = 0; i < n; ++i) {
        const Box<D> b = box(i);
        std::size_t ends[D][2];
        for (int k = 0; k < D; ++k) {
            ends[k][0] = cell(b.low.c[k] - reach, k);
            ends[k][1] = cell(b.high.c[k] + reach, k) + stride[k];
        }
        for (int corner = 0; corner < 1 << D; ++corner) {
            std::size_t at = 0;
            std::uint32_t weight = weights ? weights[i] : 1;
            for (int k = 0; k < D; ++k) {
                at += ends[k][corner >> k & 1];
                if (corner >> k & 1) weight = -weight;
            }
            sum[at] += weight;
        }
    }
    for (int k = 0; k < D; ++k)
        for (std::size_t i = stride[k]; i < sum.size(); ++i)
            if (i % stride[k + 1] >= stride[k]) sum[i] += sum[i - stride[k]];
    return *std::max_element(sum.begin(), sum.end());
}

/// The largest number of points of a cloud within `reach` of any place, or a few more than that.
template <int D>
double most_within(const Cloud<D>& cloud, double reach) {
    const auto box = [&](std::size_t i) { return Box<D>{cloud[i], cloud[i]}; };
    const double max_cells = std::min(4194304.0, 8.0 * static_cast<double>(cloud.size()) + 1024);
    return most_within<D>(cloud.size(), box, reach, max_cells);
}
/// The same of boxes.
template <int D>
double most_within(const std::vector<Box<D>>& boxes, double reach,
                   const std::uint32_t* weights = nullptr) {
    const auto box = [&](std::size_t i) { return boxes[i]; };
    const double n = static_cast<double>(boxes.size());
    const double max_cells = 8.0 * n + (D == 3 ? 1048576 : 65536);
    return most_within<D>(boxes.size(), box, reach, max_cells, weights);
}

// In a dense cloud most points can never be felt. Where other points stand around a point p, a
// proxy that stays out of their spheres also stays off p, but for a part of the band.
//
// Take points q_i with shares s_i >= 0 that sum to 1, their centre c = sum s_i q_i, and their
// spread V = sum s_i |q_i - c|^2. Every place x then has sum s_i |x - q_i|^2 = |x - c|^2 + V. So a
// place within a of p lies within sqrt((a + |p - c|)^2 + V) of one of the q_i. Where that is at
// most r, the spheres of radius r around the q_i cover the ball of radius a around p, and p is not
// needed.

template <int D>
class Thinning {
  public:
    /// Keeps so many points of the cloud that a place which is `outer` from all of them is `inner`
    /// from all points of the cloud [m].
    Thinning(const Cloud<D>& cloud, double outer, double inner)
        : cloud_(cloud),
          inner_(inner),
          slack2_((outer * outer - inner * inner) * (1 - 1e-9)),
          cell_(2 * around * std::sqrt(slack2_)),
          low_(cloud.box().low),
          kept_(cloud.size()),
          first_(std::min(std::bit_ceil(cloud.size()), max_heads), end_of_chain) {
        std::vector<std::uint32_t> left(cloud.size());
        for (std::size_t i = 0; i < left.size(); ++i) left[i] = static_cast<std::uint32_t>(i);
        // The points kept first are far apart. Where these do not cover what lies between them,
        // nearer ones follow.
        double apart2 = widest * slack2_;
        for (int level = 0; level < levels && !left.empty(); ++level, apart2 *= finer) {
            for (const std::uint32_t i : left)
                if (is_alone(i, apart2) && (level == 0 || !is_held(i))) keep(i);
            std::erase_if(left, [&](std::uint32_t i) { return kept_[i] || is_held(i); });
            // So that each end of the order comes first once.
            std::reverse(left.begin(), left.end());
        }
        for (const std::uint32_t i : left) keep(i);
    }

    std::size_t size() const noexcept { return points_.size(); }
    /// The points that were kept, in the order of the cloud.
    Cloud<D> kept() const {
        Cloud<D> out(size());
        for (std::size_t i = 0, k = 0; i < cloud_.size(); ++i)
            if (kept_[i]) out.set(k++, cloud_[i]);
        return out;
    }

  private:
    static constexpr std::uint32_t end_of_chain = 0xffffffff;
    static constexpr std::size_t max_heads = 1 << 20;
    static constexpr int max_near = 48;    // points around one that are looked at
    static constexpr int max_chosen = 6;   // of these, that are tried as what covers it
    static constexpr int levels = 24;      // each keeps points nearer together
    static constexpr double around = 1.5;  // how far away they lie, as a multiple of sqrt(slack2)
    static constexpr double widest = 1;    // square of the distance at the first level [slack2]
    static constexpr double finer = 0.5;   // by which that square shrinks from level to level

    /// A kept point near another one, seen from there.
    struct NearPoint {
        double d2;  // square of its distance
        Vec<D> d;
    };

    struct Kept {
        Vec<D> at;
        std::uint32_t next;  // in the chain of its cell
    };
    /// The whole numbers of a cell of the grid that finds kept points.
    using Cell = std::array<std::int64_t, D>;

    /// Where the chain of a cell's points begins. Two cells may share a chain.
    std::size_t head(const Cell& cell) const noexcept {
        constexpr std::uint64_t factor[] = {0x9e3779b97f4a7c15, 0xc2b2ae3d27d4eb4f,
                                            0x165667b19e3779f9};
        std::uint64_t key = 0;
        for (int k = 0; k < D; ++k) key += static_cast<std::uint64_t>(cell[k]) * factor[k];
        return (key ^ key >> 29) * factor[0] >> 40 & (first_.size() - 1);
    }
    Cell cell(const Vec<D>& p, double off) const noexcept {
        Cell c;
        for (int k = 0; k < D; ++k)
            c[k] = static_cast<std::int64_t>((p.c[k] - low_.c[k]) / cell_ + off);
        return c;
    }
    void keep(std::uint32_t i) {
        std::uint32_t& first = first_[head(cell(cloud_[i], 1))];
        points_.push_back({cloud_[i], first});
        first = static_cast<std::uint32_t>(points_.size() - 1);
        kept_[i] = true;
    }
    /// Calls f(NearPoint) for every kept point within half a cell of p, and for some others, until
    /// f returns false; true if it never does.
    template <class F>
    bool visit(const Vec<D>& p, F&& f) const noexcept {
        const Cell low = cell(p, 0.5);
        for (int corner = 0; corner < 1 << D; ++corner) {
            Cell c = low;
            for (int k = 0; k < D; ++k) c[k] += corner >> k & 1;
            for (std::uint32_t j = first_[head(c)]; j != end_of_chain; j = points_[j].next) {
                const Vec<D> d = points_[j].at - p;
                if (!f(NearPoint{dot(d, d), d})) return false;
            }
        }
        return true;
    }
    /// Whether no kept point is nearer to point i than the square root of `apart2`.
    bool is_alone(std::uint32_t i, double apart2) const noexcept {
        return visit(cloud_[i], [&](const NearPoint& q) { return !(q.d2 < apart2); });
    }

    /// Whether kept points cover point i, so that it is not needed.
    ///
    /// A step u of length 1 at most leads from the point to a place that none of the kept points
    /// bars. The search begins with u = 0. As long as some point bars the step, the one that bars
    /// it most is added to those chosen, and u becomes the shortest step that all of these allow.
    /// Where no such step is left, some of the chosen points may cover the point. Where nothing
    /// bars the step, the point can be felt.
    bool is_held(std::uint32_t i) const noexcept {
        NearPoint near[max_near];
        int count = 0;
        visit(cloud_[i], [&](const NearPoint& q) {
            if (q.d2 <= around * around * slack2_) near[count++] = q;
            return count < max_near;
        });
        Vec<D> u;
        ContactPlane<D> plane[max_chosen];
        const NearPoint* chosen[max_chosen];
        for (int n = 0; n < max_chosen; ++n) {
            double most_barred = 0;
            for (int j = 0; j < count; ++j) {
                const double barred = 2 * inner_ * dot(u, near[j].d) - near[j].d2 + slack2_;
                if (barred > most_barred) most_barred = barred, chosen[n] = &near[j];
            }
            if (!(most_barred > 0)) return false;
            const double d = std::sqrt(chosen[n]->d2), edge = slack2_ - chosen[n]->d2;
            if (2 * inner_ * d <= edge) return true;
            plane[n] = {(-1 / d) * chosen[n]->d, edge / (2 * inner_ * d)};
            u = nearest_step(Vec<D>{}, plane, n + 1, 1e-12, 1e-14);
            const double free = dot(u, u);
            if (free == 0 || free > 1) return is_held_by_some(chosen, n + 1, nullptr, 0);
        }
        return false;
    }
    /// Whether some of the first `count` points cover it, together with all n points of `with`.
    bool is_held_by_some(const NearPoint* const* near, int count, const NearPoint** with,
                         int n) const noexcept {
        const NearPoint* all[D + 1];
        std::copy_n(with, n, all);
        for (int j = 0; n <= D && j < count; ++j) {
            all[n] = near[j];
            if (is_held_by(all, n + 1) || is_held_by_some(near, j, all, n + 1)) return true;
        }
        return false;
    }
    /// Whether these n points cover it with the shares that bring their centre nearest to it.
    bool is_held_by(const NearPoint* const* q, int n) const noexcept {
        double a[D][D] = {}, share[D] = {};
        Vec<D> edge[D];
        // The shares solve the normal equations of the edges.
        for (int r = 0; r < n - 1; ++r) {
            edge[r] = q[r + 1]->d - q[0]->d;
            share[r] = -dot(edge[r], q[0]->d);
            for (int c = 0; c <= r; ++c) a[r][c] = dot(edge[r], edge[c]);
        }
        solve_symmetric(a, share, n - 1);
        double first_share = 1;
        for (int r = n - 1; r-- > 0;) {
            if (!(share[r] >= 0)) return false;
            first_share -= share[r];
        }
        Vec<D> centre = first_share * q[0]->d;
        double square = first_share * q[0]->d2;
        for (int r = 0; r < n - 1; ++r) {
            centre = centre + share[r] * q[r + 1]->d;
            square += share[r] * q[r + 1]->d2;
        }
        return first_share >= 0 && 2 * inner_ * norm(centre) + square <= slack2_;
    }

    const Cloud<D>& cloud_;
    double inner_, slack2_;  // slack2_: outer² - inner²
    double cell_;
    Vec<D> low_;
    std::vector<bool> kept_;
    std::vector<Kept> points_;
    std::vector<std::uint32_t> first_;  // of each cell's chain
};

/// The points that rule robust looks at.
template <int D>
struct Thinned {
    Cloud<D> cloud;
    double lent = 0;  // the part of the band that thinning has used [m]
};

/// The cloud without the points that can never be felt.
///
/// It comes back whole where thinning gains nothing: for another rule, for points that are edited,
/// and where at most 2048 points lie within the reach of the rule's list, because these cost no
/// more than the rest of a tick.
template <int D>
Thinned<D> thinned(Cloud<D> cloud, const Parameters& p) {
    constexpr double few = 2048;
    constexpr double share = 0.5;  // of the band, which thinning may use
    const double R = p.R(), list = (1 + tuned::list_margin + 0.75 * tuned::list_margin) * R;
    if (p.rule != Rule::robust || p.search == Search::editable ||
        static_cast<double>(cloud.size()) <= few || most_within(cloud, list) <= few)
        return {std::move(cloud)};
    const Thinning<D> thinning(cloud, R - (1 - share) * p.band, R - p.band);
    if (thinning.size() == cloud.size()) return {std::move(cloud)};
    return {thinning.kept(), share * p.band};
}

}  // namespace vfplan::inline v1
