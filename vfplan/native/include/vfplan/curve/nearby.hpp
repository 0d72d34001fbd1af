// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What of the curve lies near the proxy, and what of it a way meets first: of a list of features
// that serves as long as the proxy stays about where it was gathered.
#pragma once

#include <utility>

#include "vfplan/curve/curve.hpp"

namespace vfplan::curve {

inline constexpr int none = -1;  ///< of a curve's features

/// Where a way first goes lower than a feature allows.
struct Hit {
    double t = never;
    int feature = none;
    bool touching = false;  ///< it began at that height

    bool at_once(const Heights& h) const noexcept { return t < (touching ? 1e4 : 1.0) * h.slack; }
};

class Nearby {
  public:
    static constexpr double skin = 0.2;  // of R: how far the proxy may go with one gathered list

    Nearby(Curve around, double radius, double band)
        : curve_(std::move(around)),
          heights_{1e-3 * band, 0.75 * band, 0.1 * band},
          R_(radius),
          band_(band) {
        list_.reserve(curve_.size());
    }

    const Curve& curve() const noexcept { return curve_; }
    const Heights& heights() const noexcept { return heights_; }
    void forget() noexcept { gathered_ = false; }
    std::size_t bytes() const noexcept { return list_.capacity() * sizeof list_[0]; }

    /// What the way meets first, within `most`; `skip` is none of it. Looked at from near to far.
    Hit sweep(const Way& path, double most, int skip) noexcept {
        for (double reach = skin * R_ / 2;; reach *= 4) {
            const Hit hit = within(path, std::min(reach, most), skip);
            if (hit.feature != none || !(reach < most)) return hit;
        }
    }

    /// Distance from the curve where that is less than about R, else some more [m].
    double distance(const Vec2& x) noexcept {
        gather(x, 0);
        double least = never;
        for (int i : list_) least = std::min(least, curve_[i].distance(x));
        return least;
    }

  private:
    Hit within(const Way& path, double most, int skip) noexcept {
        Hit hit;
        const auto look = [&](int i) noexcept {
            const double reach = R_ + std::min(most, hit.t) + heights_.slack;
            if (i == skip || curve_[i].box_square(path.x) > reach * reach) return;
            bool touching;
            const double t = meets(curve_[i], path, std::min(most, hit.t), heights_, touching);
            if (t < hit.t) hit = {t, i, touching};
        };
        if (gather(path.x, most)) {
            for (int i : list_) look(i);
        } else {
            curve_.visit(
                [&](const Vec2& least, const Vec2& high) noexcept {
                    return passes(path, std::min(most, hit.t), least, high);
                },
                look);
        }
        return hit;
    }
    /// Whether the way up to `most` may come within R of a box.
    bool passes(const Way& path, double most, const Vec2& least, const Vec2& high) const noexcept {
        double from = 0, to = most;
        for (int k = 0; k < 2; ++k) {
            const double low = least.c[k] - R_ - path.x.c[k], top = high.c[k] + R_ - path.x.c[k];
            if (path.q != 0 || path.T.c[k] == 0) {
                const double reach = path.q != 0 ? most : 0;
                if (low > reach || top < -reach) return false;
            } else {
                const double a = low / path.T.c[k], b = top / path.T.c[k];
                from = std::max(from, std::min(a, b));
                to = std::min(to, std::max(a, b));
            }
        }
        return from <= to;
    }

    /// The list of what lies near serves a way of length `most` from x; gathered anew if it has to.
    bool gather(const Vec2& x, double most) noexcept {
        if (gathered_ && norm(x - centre_) + most <= skin * R_) return true;
        if (!(most <= skin * R_ / 2)) return false;
        list_.clear();
        centre_ = x;
        gathered_ = true;
        curve_.around(x, R_ * (1 + skin) + 2 * band_, [&](int i) noexcept { list_.push_back(i); });
        return true;
    }

    Curve curve_;
    Heights heights_;
    double R_, band_;
    std::vector<int> list_;  // features near centre_
    Vec2 centre_;
    bool gathered_ = false;
};

}  // namespace vfplan::curve
