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
    static constexpr int most = 6, most_leaders = 24;

    /// `shell`: distance up to which a point touches; `apart`: cosine of the angle within which two
    /// directions count as one, `linked`: within which they belong to one surface.
    Contacts(double shell, double apart, double linked) noexcept
        : shell_(shell), apart_(apart), linked_(linked) {}

    void clear() noexcept { leaders_ = count_ = 0; }
    int count() const noexcept { return count_; }
    const Contact<D>& operator[](int i) const noexcept { return contact_[i]; }

    /// A point at `away` = proxy - point.
    void add(const Vec<D>& away) noexcept {
        const double r = norm(away);
        if (!(r > 0)) return;
        const Vec<D> c = (1 / r) * away;
        int best = -1;
        double near = -2;
        for (int i = 0; i < leaders_; ++i) {
            const double cosine = dot(c, leader_[i].first);
            if (cosine > near) near = cosine, best = i;
        }
        if (leaders_ < most_leaders && !(near > apart_)) {
            best = leaders_++;
            leader_[best] = {c, {}, r, c, best};
        }
        Leader& l = leader_[best];
        const double w = shell_ - r;
        l.sum = l.sum + (w * w) * c;
        if (r < l.r) l.r = r, l.nearest = c;
    }

    /// Joins what hangs together.
    void group() noexcept {
        for (int i = 1; i < leaders_; ++i)
            for (int j = 0; j < i; ++j)
                if (dot(leader_[i].first, leader_[j].first) > linked_) join(i, j);
        Contact<D> all[most_leaders];
        int found = 0;
        for (int i = 0; i < leaders_; ++i) {
            if (leader_[i].surface != i) continue;
            Contact<D>& c = all[found++];
            c = {leader_[i].r, leader_[i].nearest, leader_[i].sum};
            for (int j = i + 1; j < leaders_; ++j) {
                if (leader_[j].surface != i) continue;
                c.direction = c.direction + leader_[j].sum;
                if (leader_[j].r < c.r) c.r = leader_[j].r, c.nearest = leader_[j].nearest;
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
    struct Leader {
        Vec<D> first, sum;
        double r = 0;
        Vec<D> nearest;
        int surface = 0;  // number of the first leader of its surface
    };

    void join(int i, int j) noexcept {
        const int a = std::min(leader_[i].surface, leader_[j].surface);
        const int b = std::max(leader_[i].surface, leader_[j].surface);
        for (int k = 0; k < leaders_; ++k)
            if (leader_[k].surface == b) leader_[k].surface = a;
    }

    double shell_, apart_, linked_;
    Leader leader_[most_leaders];
    Contact<D> contact_[most];
    int leaders_ = 0, count_ = 0;
};

}  // namespace vfplan
