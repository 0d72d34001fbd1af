// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A uniform grid over the cloud. Points are stored in the order of their cells, so that the cells
// of one row are one stretch of memory. The table of cells takes O(N) whatever the cloud's extent:
// all cells of the box where they are few, only the occupied ones where the box is mostly empty.
#pragma once

#include <cmath>
#include <numeric>

#include "vfplan/cloud/points.hpp"

namespace vfplan {

template <int D>
class Grid {
  public:
    /// `cell`: side of a cell [m], about a third of the radius that will be asked for. `slots`:
    /// takes where each of the cloud's points is kept.
    Grid(const Cloud<D>& cloud, double cell, std::uint32_t* slots = nullptr) : box_(cloud.box()) {
        double extent = 0;
        for (int k = 0; k < D; ++k) extent = std::max(extent, box_.high.c[k] - box_.low.c[k]);
        cell_ = std::max(cell, extent / most_cells_an_axis);
        double cells = 1;
        for (int k = 0; k < D; ++k) {
            count_[k] = index(box_.high.c[k], k) + 1;
            cells *= static_cast<double>(count_[k]);
        }
        dense_ = cells <= 2.0 * static_cast<double>(cloud.size()) + 64;
        dense_ ? fill_dense(cloud, static_cast<std::size_t>(cells), slots)
               : fill_sparse(cloud, slots);
    }

    const Box<D>& box() const noexcept { return box_; }
    const Cloud<D>& cloud() const noexcept { return cloud_; }
    /// Takes the point kept at `slot` out.
    void clear(std::size_t slot) noexcept { cloud_.clear(slot); }
    double cell() const noexcept { return cell_; }
    std::size_t cells() const noexcept { return start_.size() - 1; }
    std::size_t bytes() const noexcept {
        return cloud_.bytes() + start_.capacity() * sizeof(std::uint32_t) +
               keys_.capacity() * sizeof(std::uint64_t);
    }

    /// Calls f(Span) for stretches that together hold every point within `reach` of x (and more):
    /// all points at once where that is less work than to walk the rows of cells, most of them
    /// empty, that a large `reach` covers. So no call costs more than O(N).
    template <class F>
    void visit(const Vec<D>& x, double reach, F&& f) const noexcept {
        std::int64_t first[D], last[D];
        double rows = 1;
        for (int k = 0; k < D; ++k) {
            if (!range(x, reach, k, first[k], last[k])) return;
            if (k > 0) rows *= static_cast<double>(last[k] - first[k] + 1);
        }
        if (rows * points_a_row > static_cast<double>(cloud_.size()))
            return f(cloud_.span(0, cloud_.size()));
        if constexpr (D == 2) {
            visit_rows(x, reach, 0, f);
        } else {
            for (auto z = first[2]; z <= last[2]; ++z) {
                const double left = reach * reach - square_to_cell(x, z, 2);
                if (left >= 0) visit_rows(x, std::sqrt(left), z, f);
            }
        }
    }

  private:
    static constexpr double most_cells_an_axis = 1 << 20;
    static constexpr double points_a_row = 32;  // about as long to look at as a row to find

    std::int64_t index(double c, int k) const noexcept {
        return static_cast<std::int64_t>(std::floor((c - box_.low.c[k]) / cell_));
    }
    /// Cells of axis k that [x - reach, x + reach] touches; one more each way against rounding.
    bool range(const Vec<D>& x, double reach, int k, std::int64_t& first,
               std::int64_t& last) const noexcept {
        const double most = static_cast<double>(count_[k]);
        const double at = (x.c[k] - box_.low.c[k]) / cell_, around = reach / cell_ + 1e-6;
        if (!(at + around >= 0 && at - around <= most)) return false;  // NaN: nowhere
        first = static_cast<std::int64_t>(std::clamp(std::floor(at - around), 0.0, most - 1));
        last = static_cast<std::int64_t>(std::clamp(std::floor(at + around), 0.0, most - 1));
        return true;
    }
    double square_to_cell(const Vec<D>& x, std::int64_t i, int k) const noexcept {
        const double low = box_.low.c[k] + static_cast<double>(i) * cell_;
        const double high = std::min(low + cell_, box_.high.c[k]), slack = 1e-6 * cell_;
        const double gap = std::max({low - x.c[k], x.c[k] - high, slack}) - slack;
        return gap * gap;
    }

    template <class F>
    void visit_rows(const Vec<D>& x, double reach, std::int64_t z, F&& f) const noexcept {
        std::int64_t first, last, from, to;
        if (!range(x, reach, 1, first, last)) return;
        std::size_t hint = 0;
        for (auto y = first; y <= last; ++y) {
            const double left = reach * reach - square_to_cell(x, y, 1);
            if (left < 0 || !range(x, std::sqrt(left), 0, from, to)) continue;
            const std::uint64_t row = key(0, y, z);
            const auto a = row + static_cast<std::uint64_t>(from);
            const auto b = row + static_cast<std::uint64_t>(to);
            std::size_t i = a, j = b + 1;
            if (!dense_) {
                const auto begin = keys_.begin() + static_cast<std::ptrdiff_t>(hint);
                const auto low = std::lower_bound(begin, keys_.end(), a);
                auto high = low;
                while (high != keys_.end() && *high <= b) ++high;
                i = static_cast<std::size_t>(low - keys_.begin());
                j = static_cast<std::size_t>(high - keys_.begin());
                hint = i;
            }
            if (start_[i] < start_[j]) f(cloud_.span(start_[i], start_[j]));
        }
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

    void fill_dense(const Cloud<D>& from, std::size_t cells, std::uint32_t* slots) {
        const std::size_t n = from.size();
        start_.assign(cells + 1, 0);
        std::vector<std::uint32_t> home(n);
        for (std::size_t i = 0; i < n; ++i) {
            home[i] = static_cast<std::uint32_t>(key(from[i]));
            ++start_[home[i] + 1];
        }
        std::partial_sum(start_.begin(), start_.end(), start_.begin());
        cloud_ = Cloud<D>(n);
        for (std::size_t i = 0; i < n; ++i) {
            const std::uint32_t slot = start_[home[i]]++;
            cloud_.set(slot, from[i]);
            if (slots) slots[i] = slot;
        }
        for (std::size_t c = cells; c > 0; --c) start_[c] = start_[c - 1];
        start_[0] = 0;
    }

    void fill_sparse(const Cloud<D>& from, std::uint32_t* slots) {
        const std::size_t n = from.size();
        std::vector<std::pair<std::uint64_t, std::uint32_t>> order(n);
        for (std::size_t i = 0; i < n; ++i)
            order[i] = {key(from[i]), static_cast<std::uint32_t>(i)};
        std::sort(order.begin(), order.end());
        std::size_t cells = 0;
        for (std::size_t i = 0; i < n; ++i) cells += i == 0 || order[i].first != order[i - 1].first;
        keys_.reserve(cells);
        start_.reserve(cells + 1);
        cloud_ = Cloud<D>(n);
        for (std::size_t i = 0; i < n; ++i) {
            if (i == 0 || order[i].first != order[i - 1].first) {
                keys_.push_back(order[i].first);
                start_.push_back(static_cast<std::uint32_t>(i));
            }
            cloud_.set(i, from[order[i].second]);
            if (slots) slots[order[i].second] = static_cast<std::uint32_t>(i);
        }
        start_.push_back(static_cast<std::uint32_t>(n));
    }

    Box<D> box_;
    Cloud<D> cloud_;
    double cell_ = 0;
    std::int64_t count_[D] = {};
    bool dense_ = true;
    std::vector<std::uint32_t> start_;  // of each cell, and one behind the last
    std::vector<std::uint64_t> keys_;   // of the occupied cells, where not all have an entry
};

// The points around the proxy, gathered once and kept while the proxy stays near enough: within a
// tick and over many ticks.

/// Points near a place, from a Grid or Edited. A neighbourhood too crowded for the list is read
/// from the grid.
template <int D, class SourceOf>
class Gathered {
  public:
    using Source = SourceOf;
    static constexpr std::size_t most = 8192;  // points in the list

    /// `reach`: the largest radius that is asked for often; `skin`: how far x may go meanwhile;
    /// `cell`: side of the grid's cells [m].
    Gathered(const Cloud<D>& cloud, double reach, double skin, double cell,
             const Kernels<D>& kernels)
        : source_(cloud, cell),
          held_(std::clamp<std::size_t>(cloud.size() / 4, 1024, most)),
          radius_(reach + skin),
          kernels_(kernels) {}

    const Source& source() const noexcept { return source_; }
    Source& source() noexcept { return source_; }
    std::size_t bytes() const noexcept { return source_.bytes() + held_.bytes(); }

    /// Calls f(Span) for stretches that together hold every point within `reach` of x (and more).
    template <class F>
    void visit(const Vec<D>& x, double reach, F&& f) noexcept {
        if (reach > radius_) return source_.visit(x, reach, f);
        if (!(norm(x - centre_) + reach <= radius_) || !valid_) gather(x, reach);
        if (crowded_) return source_.visit(x, reach, f);
        f(held_.span(0, count_));
    }

    /// The next answers depend on nothing asked before.
    void forget() noexcept { valid_ = false; }
    /// Whether the list has to do with what lies at p.
    bool reaches(const Vec<D>& p) const noexcept {
        return !valid_ || norm(p - centre_) <= radius_ * (1 + 1e-9);
    }

  private:
    /// Around a place ahead of x, as it went on from the last one: so the list serves longer.
    void gather(const Vec<D>& x, double reach) noexcept {
        const Vec<D> way = x - centre_;
        const double ahead = std::min(norm(way), 0.9 * (radius_ - reach));
        centre_ = valid_ ? x + along(way, ahead) : x;
        valid_ = true;
        crowded_ = false;
        count_ = 0;
        const double reach2 = radius_ * radius_ * (1 + 1e-12);
        source_.visit(centre_, radius_, [&](const Span<D>& span) noexcept {
            if (crowded_ || count_ + span.n > held_.size()) {
                crowded_ = crowded_ || !take_in_parts(span, reach2);
                return;
            }
            count_ += take(span, reach2);
        });
    }
    std::size_t take(const Span<D>& span, double reach2) noexcept {
        double* to[D];
        for (int k = 0; k < D; ++k) to[k] = held_.axis(k) + count_;
        return kernels_.gather(span, centre_, reach2, to);
    }
    /// A stretch that may not fit as a whole, eight points at a time; false when it does not.
    bool take_in_parts(Span<D> span, double reach2) noexcept {
        while (span.n > 0) {
            Span<D> part = span;
            part.n = std::min<std::size_t>(span.n, 8);
            if (count_ + part.n > held_.size()) return false;
            count_ += take(part, reach2);
            for (int k = 0; k < D; ++k) span.c[k] += part.n;
            span.n -= part.n;
        }
        return true;
    }

    Source source_;
    Cloud<D> held_;
    double radius_;
    Kernels<D> kernels_;
    Vec<D> centre_;
    std::size_t count_ = 0;
    bool valid_ = false, crowded_ = false;
};

/// Square of the distance from x to the nearest point within `reach`, or to one further off.
template <class Search, int D>
double nearest2(Search& search, const Kernels<D>& kernels, const Vec<D>& x, double reach) noexcept {
    double least = std::numeric_limits<double>::infinity();
    search.visit(x, reach, [&](const Span<D>& span) noexcept {
        least = std::min(least, kernels.nearest2(span, x));
    });
    return least;
}

template <int D>
using Neighbours = Gathered<D, Grid<D>>;

/// The same calls on a cloud too small to be worth a grid or a list: always all of it.
template <int D>
class AllPoints {
  public:
    AllPoints(const Cloud<D>& cloud, double, double, double, const Kernels<D>&)
        : box_(cloud.box()), cloud_(cloud) {}

    const AllPoints& source() const noexcept { return *this; }
    const Box<D>& box() const noexcept { return box_; }
    std::size_t cells() const noexcept { return 0; }
    std::size_t bytes() const noexcept { return cloud_.bytes(); }
    void forget() noexcept {}
    template <class F>
    void visit(const Vec<D>&, double, F&& f) const noexcept {
        f(cloud_.span(0, cloud_.size()));
    }

  private:
    Box<D> box_;
    Cloud<D> cloud_;
};

// A cloud that loses and gains points between ticks: a grid that is made once, in which a point
// that is gone leaves a lane without one, and a list of what came since, in blocks with a box each.
// What has become much is made anew, off the loop.

template <int D>
class Edited {
  public:
    static constexpr std::size_t block = 64;

    /// Room in the list beside n points.
    static std::size_t room(std::size_t n) noexcept {
        return std::clamp<std::size_t>(n / 16, 1024, 16384);
    }

    Edited(const Cloud<D>& cloud, double cell)
        : slot_(cloud.size()),
          grid_(cloud, cell, slot_.data()),
          box_(grid_.box()),
          list_(room(cloud.size())),
          boxes_(list_.size() / block + 1) {}

    const Box<D>& box() const noexcept { return box_; }
    double cell() const noexcept { return grid_.cell(); }
    std::size_t cells() const noexcept { return grid_.cells(); }
    std::size_t bytes() const noexcept {
        return grid_.bytes() + list_.bytes() + slot_.capacity() * sizeof slot_[0] +
               boxes_.capacity() * sizeof boxes_[0];
    }

    /// Point `id`, counted from the first of the cloud through all that were added.
    Vec<D> remove(std::size_t id) noexcept {
        const std::size_t n = slot_.size();
        const Vec<D> was = id < n ? grid_.cloud()[slot_[id]] : list_[id - n];
        id < n ? grid_.clear(slot_[id]) : list_.clear(id - n);
        return was;
    }
    void add(const Vec<D>& p) noexcept {
        Box<D>& b = boxes_[count_ / block];
        if (count_ % block == 0) b = {p, p};
        b.include(p);
        box_.include(p);
        list_.set(count_++, p);
    }

    template <class F>
    void visit(const Vec<D>& x, double reach, F&& f) const noexcept {
        grid_.visit(x, reach, f);
        for (std::size_t i = 0; i < count_; i += block)
            if (near(boxes_[i / block], x, reach)) f(list_.span(i, std::min(i + block, count_)));
    }

  private:
    static bool near(const Box<D>& b, const Vec<D>& x, double reach) noexcept {
        double square = 0;
        for (int k = 0; k < D; ++k) {
            const double gap = std::max({b.low.c[k] - x.c[k], x.c[k] - b.high.c[k], 0.0});
            square += gap * gap;
        }
        return square <= reach * reach * (1 + 1e-12);
    }

    std::vector<std::uint32_t> slot_;  // where the grid keeps each point
    Grid<D> grid_;
    Box<D> box_;
    Cloud<D> list_;
    std::vector<Box<D>> boxes_;  // of the list's blocks
    std::size_t count_ = 0;
};

template <int D>
using EditedNeighbours = Gathered<D, Edited<D>>;

}  // namespace vfplan
