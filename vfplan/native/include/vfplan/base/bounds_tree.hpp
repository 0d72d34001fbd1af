// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A tree of bounding volumes over a row of items, walked without a stack: each node knows the node
// behind all that hang on it.
#pragma once

#include "vfplan/base/work.hpp"

namespace vfplan::inline v1 {

template <class Bounds>
class BoundsTree {
  public:
    /// Number of items under one leaf.
    static constexpr std::size_t leaf_size = 4;

    /// Builds the tree over the items from first to last - 1. `bounds_of(first, last)` gives their
    /// bounds; `halve(first, last)` may reorder them first, so that each half lies together.
    template <class BoundsOf, class Halve>
    void build(std::size_t first, std::size_t last, BoundsOf&& bounds_of, Halve&& halve) {
        const std::size_t at = nodes_.size();
        nodes_.push_back({bounds_of(first, last), 0, 0, 0});
        if (last - first <= leaf_size) {
            nodes_[at].first = static_cast<std::uint32_t>(first);
            nodes_[at].last = static_cast<std::uint32_t>(last);
        } else {
            halve(first, last);
            const std::size_t middle = first + (last - first) / 2;
            build(first, middle, bounds_of, halve);
            build(middle, last, bounds_of, halve);
        }
        nodes_[at].skip = static_cast<std::uint32_t>(nodes_.size());
    }
    /// The tree over n items in the order that they have, of which `box_of(i)` gives the boxes.
    template <class BoxOf>
    void build(std::size_t n, BoxOf&& box_of) {
        const auto box_around = [&](std::size_t first, std::size_t last) {
            Bounds box;
            for (std::size_t i = first; i < last; ++i) box.include(box_of(i));
            return box;
        };
        build(0, n, box_around, [](std::size_t, std::size_t) {});
    }

    std::size_t size() const noexcept { return nodes_.size(); }
    std::size_t bytes() const noexcept { return nodes_.capacity() * sizeof(Node); }

    /// Calls f(i) for every item under bounds that `is_near(bounds)` says so of. Returns the inner
    /// steps that it took: one for each of the bounds, three for each item.
    template <class IsNear, class F>
    int visit(IsNear&& is_near, F&& f) const noexcept {
        int steps = 0;
        for (std::uint32_t k = 0; k < nodes_.size();) steps += visit_node(k, is_near, f);
        return steps;
    }
    /// The part of a visit that looks at node k, which becomes the next one; it ends at `size()`.
    template <class IsNear, class F>
    int visit_node(std::uint32_t& k, IsNear&& is_near, F&& f) const noexcept {
        const Node& node = nodes_[k];
        if (!is_near(node.bounds)) {
            k = node.skip;
            return 1;
        }
        for (std::uint32_t i = node.first; i < node.last; ++i) f(i);
        ++k;
        return 1 + 3 * static_cast<int>(node.last - node.first);
    }

    /// Calls f(i) for every item under bounds within `reach` of y, and for some others. f may
    /// shrink `reach`. Returns the inner steps that it took.
    template <class V, class F>
    int around(const V& y, const double& reach, F&& f) const noexcept {
        return visit([&](const Bounds& b) noexcept { return b.distance2(y) <= reach * reach; }, f);
    }
    /// The same, the nearer of two halves first; where there is a budget, until it is spent.
    template <class V, class F>
    void visit_nearest(const V& y, const double& reach, F&& f,
                       WorkBudget* budget = nullptr) const noexcept {
        if (!nodes_.empty()) descend(0, y, reach, f, budget);
    }

  private:
    template <class V, class F>
    void descend(std::uint32_t k, const V& y, const double& reach, F&& f,
                 WorkBudget* budget) const noexcept {
        const Node& node = nodes_[k];
        if (budget && budget->is_spent()) return;
        if (budget) budget->spend(2 + 3 * (node.last - node.first));
        for (std::uint32_t i = node.first; i < node.last; ++i) f(i);
        if (node.first < node.last) return;
        std::uint32_t near = k + 1, far = nodes_[k + 1].skip;
        double near2 = nodes_[near].bounds.distance2(y), far2 = nodes_[far].bounds.distance2(y);
        if (far2 < near2) std::swap(near, far), std::swap(near2, far2);
        // What is as near as the last is looked at too, whatever roundings say.
        constexpr double more = 1 + 1e-12;
        if (near2 <= reach * reach * more) descend(near, y, reach, f, budget);
        if (far2 <= reach * reach * more) descend(far, y, reach, f, budget);
    }

    struct Node {
        Bounds bounds;
        std::uint32_t first, last;  // items of a leaf; none of a branch
        std::uint32_t skip;         // the node behind all that hang on this one
    };

    std::vector<Node> nodes_;
};

}  // namespace vfplan::inline v1
