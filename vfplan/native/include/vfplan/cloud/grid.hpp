// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A uniform grid over the cloud. Points are stored in the order of their cells, so that the cells
// of one row are one stretch of memory. The table has the occupied cells alone.
#pragma once

#include "vfplan/base/work.hpp"
#include "vfplan/cloud/points.hpp"
#include "vfplan/parameters.hpp"

namespace vfplan::inline v1 {

/// Clouds of this many points or fewer are looked through point by point: a grid measured slower.
inline constexpr std::size_t small_cloud = 64;

// What a tick looks at in a cloud is counted in points, each about a nanosecond on the machine of
// docs/engine.md. Whatever else it does counts as the points that take about as long.
namespace work {
inline constexpr std::size_t iteration = 4000;  // of the robust rule, beside what follows
inline constexpr std::size_t row = 32;          // of cells, walked to find points
inline constexpr std::size_t span = 32;         // of points, looked through by one loop
inline constexpr std::size_t contact = 32;      // a point that touches the proxy
inline constexpr std::size_t fit = 128;         // a plane fitted to such points
inline constexpr int triangle = 12;             // an inner step among triangles
inline constexpr std::size_t choice = 64;       // of planes, tried for a step that keeps to them
// What a tick may do, of the 300,000 that max_tick_time has room for.
inline constexpr std::int64_t motion = 180000;
inline constexpr std::int64_t way_out = 150000;
}  // namespace work

/// What looks at a stretch of points, behind one type: the search for them is compiled once.
template <int D>
class SpanVisitor {
  public:
    template <class F>
    SpanVisitor(const F& f) noexcept
        : f_(&f), call_([](const void* f, const PointSpan<D>& span) noexcept {
              (*static_cast<const F*>(f))(span);
          }) {}
    void operator()(const PointSpan<D>& span) const noexcept { call_(f_, span); }

  private:
    const void* f_;
    void (*call_)(const void*, const PointSpan<D>&) noexcept;
};

/// The points of a cloud, found by place. How it looks is chosen once: point by point; on a grid;
/// or on a grid from which points may be taken away, with a list of those that were added.
template <int D>
class PointIndex {
  public:
    /// Number of points in a block of the list; each block has a box.
    static constexpr std::size_t block = 64;

    /// How many points may be added beside n of them.
    static std::size_t max_added(std::size_t n) noexcept {
        return std::clamp<std::size_t>(n / 16, 1024, 16384);
    }

    /// `cell`: side of the grid's cells [m], about a third of the radius that will be asked for.
    PointIndex(const Cloud<D>& cloud, double cell, Search search)
        : box_(cloud.box()), cells_box_(box_) {
        choose_kernels();
        if (search == Search::automatic && cloud.size() <= small_cloud) search = Search::brute;
        if (search == Search::brute) {
            cloud_ = cloud;
            return;
        }
        if (search == Search::editable) {
            slot_.resize(cloud.size());
            added_ = Cloud<D>(max_added(cloud.size()));
            boxes_.resize(added_.size() / block + 1);
        }
        double extent = 0;
        for (int k = 0; k < D; ++k) extent = std::max(extent, box_.high.c[k] - box_.low.c[k]);
        cell_ = std::max(cell, extent / max_cells_an_axis);
        for (int k = 0; k < D; ++k) count_[k] = index(box_.high.c[k], k) + 1;
        fill(cloud);
    }

    const Box<D>& box() const noexcept { return box_; }
    bool has_grid() const noexcept { return !keys_.empty(); }
    double cell() const noexcept { return cell_; }
    std::size_t cells() const noexcept { return keys_.size(); }
    std::size_t bytes() const noexcept {
        return cloud_.bytes() + added_.bytes() + boxes_.capacity() * sizeof boxes_[0] +
               (start_.capacity() + slot_.capacity()) * sizeof slot_[0] +
               keys_.capacity() * sizeof keys_[0];
    }

    /// Takes point `id` away, counted from the first of the cloud through all that were added;
    /// returns where it was.
    Vec<D> remove(std::size_t id) noexcept {
        const std::size_t n = slot_.size();
        Cloud<D>& from = id < n ? cloud_ : added_;
        const std::size_t slot = id < n ? slot_[id] : id - n;
        const Vec<D> place = from[slot];
        from.clear(slot);
        return place;
    }
    void add(const Vec<D>& p) noexcept {
        boxes_[added_count_ / block].include(p);
        box_.include(p);
        added_.set(added_count_++, p);
    }

    /// Calls f(PointSpan) for stretches that together hold every point within `reach` of x, and
    /// more.
    void visit(const Vec<D>& x, double reach, SpanVisitor<D> f) const noexcept {
        const auto count = [&](const PointSpan<D>& span) noexcept {
            budget_.spend(work::span + span.n);
            f(span);
        };
        if (!has_grid()) return count(cloud_.span(0, cloud_.size()));
        budget_.spend(work::row * visit_cells(x, reach, count));
        for (std::size_t i = 0; i < added_count_; i += block) {
            if (boxes_[i / block].distance2(x) > reach * reach * (1 + 1e-12)) continue;
            count(added_.span(i, std::min(i + block, added_count_)));
        }
    }
    /// What this tick may still do.
    WorkBudget& budget() const noexcept { return budget_; }

  private:
    static constexpr double max_cells_an_axis = 1 << 20;
    static constexpr double points_a_row = 32;  // about as long to look at as a row to find

    /// All points at once where that is less work than to walk the rows of cells, most of them
    /// empty, that a large `reach` covers. So no call costs more than O(N). Returns how many rows
    /// it has walked.
    template <class F>
    std::size_t visit_cells(const Vec<D>& x, double reach, F&& f) const noexcept {
        std::int64_t first[D], last[D];
        double rows = 1;
        for (int k = 0; k < D; ++k) {
            if (!range(x, reach, k, first[k], last[k])) return 0;
            if (k > 0) rows *= static_cast<double>(last[k] - first[k] + 1);
        }
        if (rows * points_a_row > static_cast<double>(cloud_.size())) {
            f(cloud_.span(0, cloud_.size()));
            return 0;
        }
        if constexpr (D == 2) return visit_rows(x, reach, 0, f);
        std::size_t walked = 0;
        for (auto z = first[D - 1]; z <= last[D - 1]; ++z) {
            const double left = reach * reach - square_to_cell(x, z, D - 1);
            if (left >= 0) walked += visit_rows(x, std::sqrt(left), z, f);
        }
        return walked;
    }

    std::int64_t index(double c, int k) const noexcept {
        return static_cast<std::int64_t>(std::floor((c - cells_box_.low.c[k]) / cell_));
    }
    /// Cells of axis k that [x - reach, x + reach] touches; one more each way against rounding.
    bool range(const Vec<D>& x, double reach, int k, std::int64_t& first,
               std::int64_t& last) const noexcept {
        const double cells = static_cast<double>(count_[k]);
        const double at = (x.c[k] - cells_box_.low.c[k]) / cell_, around = reach / cell_ + 1e-6;
        if (!(at + around >= 0 && at - around <= cells)) return false;  // NaN: nowhere
        first = static_cast<std::int64_t>(std::clamp(std::floor(at - around), 0.0, cells - 1));
        last = static_cast<std::int64_t>(std::clamp(std::floor(at + around), 0.0, cells - 1));
        return true;
    }
    double square_to_cell(const Vec<D>& x, std::int64_t i, int k) const noexcept {
        const double low = cells_box_.low.c[k] + static_cast<double>(i) * cell_;
        const double high = std::min(low + cell_, cells_box_.high.c[k]), slack = 1e-6 * cell_;
        const double gap = std::max({low - x.c[k], x.c[k] - high, slack}) - slack;
        return gap * gap;
    }

    template <class F>
    std::size_t visit_rows(const Vec<D>& x, double reach, std::int64_t z, F&& f) const noexcept {
        std::int64_t first, last, from, to;
        if (!range(x, reach, 1, first, last)) return 0;
        auto low = keys_.begin();
        for (auto y = first; y <= last; ++y) {
            const double left = reach * reach - square_to_cell(x, y, 1);
            if (left < 0 || !range(x, std::sqrt(left), 0, from, to)) continue;
            const std::uint64_t row = key(0, y, z);
            const auto a = row + static_cast<std::uint64_t>(from);
            const auto b = row + static_cast<std::uint64_t>(to);
            low = std::lower_bound(low, keys_.end(), a);
            auto high = low;
            while (high != keys_.end() && *high <= b) ++high;
            if (low != high)
                f(cloud_.span(start_[low - keys_.begin()], start_[high - keys_.begin()]));
        }
        return static_cast<std::size_t>(last - first + 1);
    }

    std::uint64_t key(std::int64_t x, std::int64_t y, std::int64_t z) const noexcept {
        return static_cast<std::uint64_t>((z * (D == 3 ? count_[1] : 1) + y) * count_[0] + x);
    }
    std::uint64_t key(const Vec<D>& p) const noexcept {
        std::int64_t i[3] = {};
        for (int k = 0; k < D; ++k)
            i[k] = std::clamp<std::int64_t>(index(p.c[k], k), 0, count_[k] - 1);
        return key(i[0], i[1], i[2]);
    }

    void fill(const Cloud<D>& from) {
        const std::size_t n = from.size();
        std::vector<std::pair<std::uint64_t, std::uint32_t>> order(n);
        for (std::size_t i = 0; i < n; ++i)
            order[i] = {key(from[i]), static_cast<std::uint32_t>(i)};
        std::sort(order.begin(), order.end());
        cloud_ = Cloud<D>(n);
        for (std::size_t i = 0; i < n; ++i) {
            const auto [key, number] = order[i];
            if (keys_.empty() || keys_.back() != key) {
                keys_.push_back(key);
                start_.push_back(static_cast<std::uint32_t>(i));
            }
            cloud_.set(i, from[number]);
            if (!slot_.empty()) slot_[number] = static_cast<std::uint32_t>(i);
        }
        start_.push_back(static_cast<std::uint32_t>(n));
        keys_.shrink_to_fit();
        start_.shrink_to_fit();
    }

    Box<D> box_;        // of all points, with those that were added
    Box<D> cells_box_;  // of the grid
    Cloud<D> cloud_;    // in the order of the cells
    double cell_ = 0;
    std::int64_t count_[D] = {};
    std::vector<std::uint32_t> start_;  // of each cell, and one behind the last
    std::vector<std::uint64_t> keys_;   // of the occupied cells
    std::vector<std::uint32_t> slot_;   // where an editable cloud keeps each point
    Cloud<D> added_;
    std::vector<Box<D>> boxes_;  // of the blocks of added points
    std::size_t added_count_ = 0;
    mutable WorkBudget budget_;
};

/// The points around the proxy, gathered into a list once and kept while the proxy stays near
/// enough, within a tick and over many ticks. A neighbourhood too crowded for the list is read from
/// the index, and so is a cloud without a grid.
template <int D>
class Neighbours {
  public:
    static constexpr std::size_t max_points = 8192;  // in the list

    /// `reach`: the largest radius that is asked for often [m]; `skin`: how far x may go before the
    /// list is gathered anew [m]; `cell`: side of the grid's cells [m].
    Neighbours(const Cloud<D>& cloud, double reach, double skin, double cell, Search search)
        : index_(cloud, cell, search), radius_(reach + skin) {
        if (index_.has_grid())
            list_ = Cloud<D>(std::clamp<std::size_t>(cloud.size() / 4, 1024, max_points));
    }

    const PointIndex<D>& index() const noexcept { return index_; }
    PointIndex<D>& index() noexcept { return index_; }
    std::size_t bytes() const noexcept { return index_.bytes() + list_.bytes(); }

    /// Calls f(PointSpan) for stretches that together hold every point within `reach` of x, and
    /// more.
    void visit(const Vec<D>& x, double reach, SpanVisitor<D> f) noexcept {
        if (!is_list_enough(x, reach)) return index_.visit(x, reach, f);
        index_.budget().spend(work::span + count_);
        f(list_.span(0, count_));
    }

    /// Makes the next answers independent of what was asked before.
    void forget() noexcept { is_gathered_ = false; }
    /// Whether the list may hold what lies at p.
    bool reaches(const Vec<D>& p) const noexcept {
        return !is_gathered_ || norm(p - centre_) <= radius_ * (1 + 1e-9);
    }

  private:
    /// Whether the list holds all that lies within `reach` of x; gathers it anew where it has to.
    bool is_list_enough(const Vec<D>& x, double reach) noexcept {
        if (!index_.has_grid() || reach > radius_) return false;
        if (!(norm(x - centre_) + reach <= radius_) || !is_gathered_) gather(x, reach);
        return !is_crowded_;
    }
    /// Gathers around a place ahead of x, in the direction in which x has moved since the last
    /// time: so the list serves longer.
    void gather(const Vec<D>& x, double reach) noexcept {
        const Vec<D> step = x - centre_;
        const double ahead = std::min(norm(step), 0.9 * (radius_ - reach));
        centre_ = is_gathered_ ? x + along(step, ahead) : x;
        is_gathered_ = true;
        is_crowded_ = false;
        count_ = 0;
        const double reach2 = radius_ * radius_ * (1 + 1e-12);
        index_.visit(centre_, radius_, [&](PointSpan<D> span) noexcept {
            double* to[D];
            while (span.n > 0 && !is_crowded_) {
                // Many at once where they all fit, or else as many as one loop looks at.
                const PointSpan<D> part = span.take(count_ + span.n > list_.size() ? 8 : span.n);
                is_crowded_ = count_ + part.n > list_.size();
                if (is_crowded_) return;
                for (int k = 0; k < D; ++k) to[k] = list_.axis(k) + count_;
                count_ += kernels<D>.gather(part, centre_, reach2, to);
            }
        });
    }

    PointIndex<D> index_;
    Cloud<D> list_;
    double radius_;
    Vec<D> centre_;
    std::size_t count_ = 0;
    bool is_gathered_ = false;
    bool is_crowded_ = false;
};

/// Square of the distance from x to the nearest point within `reach`, or to one further off.
template <class Points, int D>
double nearest2(Points& points, const Vec<D>& x, double reach) noexcept {
    double smallest = infinity;
    points.visit(x, reach, [&](const PointSpan<D>& span) noexcept {
        smallest = std::min(smallest, kernels<D>.nearest2(span, x));
    });
    return smallest;
}

/// Distance from x to the nearest point, or `reach` where that is less [m].
template <int D>
double distance_within(const PointIndex<D>& points, const Vec<D>& x, double reach) noexcept {
    return std::sqrt(std::min(reach * reach, nearest2(points, x, reach)));
}
/// Distance from x to the nearest point [m]. Looks near by first, for that is where most places are
/// asked about.
template <int D>
double distance(const PointIndex<D>& points, const Vec<D>& x) noexcept {
    double reach = points.cell();
    for (int i = 0; i < 3 && reach > 0; ++i, reach *= 2) {
        const double d = distance_within(points, x, reach);
        if (d < reach) return d;
    }
    return distance_within(points, x, infinity);
}

/// Calls f(proxy - point) for every point within `reach` of x, in the order of the spans.
template <class Points, int D, class F>
void visit_within(Points& points, const Vec<D>& x, double reach, F&& f) noexcept {
    points.visit(x, reach, [&](PointSpan<D> span) noexcept {
        std::uint32_t indices[256];
        while (span.n > 0) {
            const PointSpan<D> part = span.take(std::size(indices));
            const std::size_t n = kernels<D>.indices_within(part, x, reach * reach, indices);
            for (std::size_t i = 0; i < n; ++i) f(x - part[indices[i]]);
        }
    });
}

}  // namespace vfplan::inline v1
