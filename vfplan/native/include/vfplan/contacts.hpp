// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The points that touch the proxy, sorted into surfaces. Points whose directions hang together
// belong to one surface, however it curves; a corner's walls do not hang together.
#pragma once

#include <algorithm>

#include "vfplan/vec.hpp"

namespace vfplan {

/// One surface that touches the proxy.
template <int D>
struct Contact {
    double r = 0;      ///< distance of its nearest point
    Vec<D> nearest;    ///< unit vector from that point to the proxy
    Vec<D> direction;  ///< unit mean of such vectors, the nearer the heavier
};

template <int D>
class Contacts {
  public:
    static constexpr int most = 6;        // surfaces
    static constexpr int most_kept = 24;  // directions; further points join one of them

    /// `shell`: distance up to which a point touches; `linked`: cosine of the angle within which
    /// two directions belong to one surface.
    Contacts(double shell, double linked) noexcept : shell_(shell), linked_(linked) {}

    void clear() noexcept { kept_ = count_ = 0; }
    int count() const noexcept { return count_; }
    const Contact<D>& operator[](int i) const noexcept { return contact_[i]; }

    /// A point at `away` = proxy - point. Up to `most_kept` of them, their order does not matter.
    void add(const Vec<D>& away) noexcept {
        const double r = norm(away);
        if (!(r > 0)) return;
        const Vec<D> c = (1 / r) * away;
        const double w = shell_ - r;
        if (kept_ < most_kept) {
            direction_[kept_] = c;
            part_[kept_++] = {r, c, (w * w) * c};
        } else {
            include(part_[like(c)], {r, c, (w * w) * c});
        }
    }

    /// Joins what hangs together, however far round it goes.
    void group() noexcept {
        Contact<D> all[most_kept];
        int next[most_kept], left = kept_, found = 0;
        for (int i = 0; i < left; ++i) next[i] = i;
        while (left > 0) {
            int chain[most_kept], links = 1;
            chain[0] = next[--left];
            Contact<D>& c = all[found++] = part_[chain[0]];
            for (int i = 0; i < links && left > 0; ++i)
                for (int j = left - 1; j >= 0; --j) {
                    if (!(dot(direction_[chain[i]], direction_[next[j]]) > linked_)) continue;
                    include(c, part_[chain[links++] = next[j]]);
                    next[j] = next[--left];
                }
            const double length = norm(c.direction);
            c.direction = length > 0 ? (1 / length) * c.direction : c.nearest;
        }
        count_ = std::min(found, most);
        std::partial_sort(all, all + count_, all + found,
                          [](const auto& a, const auto& b) { return a.r < b.r; });
        std::copy(all, all + count_, contact_);
    }

  private:
    static void include(Contact<D>& whole, const Contact<D>& part) noexcept {
        whole.direction = whole.direction + part.direction;
        if (part.r < whole.r) whole.r = part.r, whole.nearest = part.nearest;
    }
    /// A kept direction of the surface that c belongs to, or else the nearest.
    int like(const Vec<D>& c) const noexcept {
        int best = 0;
        double near = -2;
        for (int i = 0; i < kept_ && !(near > linked_); ++i) {
            const double cosine = dot(c, direction_[i]);
            if (cosine > near) near = cosine, best = i;
        }
        return best;
    }

    double shell_, linked_;
    Vec<D> direction_[most_kept];
    Contact<D> part_[most_kept];  // its direction: a sum, not of unit length
    Contact<D> contact_[most];
    int kept_ = 0, count_ = 0;
};

}  // namespace vfplan
