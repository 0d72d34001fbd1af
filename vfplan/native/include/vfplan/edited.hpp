// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A cloud that loses and gains points between ticks: a grid that is made once, in which a point
// that is gone leaves a lane without one, and a list of what came since, in blocks with a box each.
// What has become much is made anew, off the loop.
#pragma once

#include "vfplan/neighbours.hpp"

namespace vfplan {

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
