// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A scripted hand: a soft spring pulls the tip towards a goal that comes from outside, follows the
// drawn curve point by point, so that the tip would run on the line, and leaves again.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>

#include "arm.hpp"

namespace controller {

class Hand {
  public:
    /// `xyz`: the fixture's points [m] in drawing order; `seconds`: how long the way takes.
    Hand(std::span<const double> xyz, double clearance, const std::optional<Vec3>& ignore_axis,
         double seconds)
        : xyz_(xyz), seconds_(seconds) {
        vfplan::Box<3> box;
        for (std::size_t i = 0; i < count(); ++i) box.include(point(i));
        outside_ = point(0) + (clearance + norm(box.high - box.low)) * across(ignore_axis);
    }

    [[nodiscard]] Vec3 start() const { return outside_; }

    /// The pull on the tip at time t [s]; at most what a hand does.
    [[nodiscard]] Vec3 force(const Tip& tip, double t) const {
        Vec3 pull = goal(t) - tip.position;
        for (int k = 0; k < 3; ++k) pull[k] = spring * pull[k] - damper * tip.velocity[k];
        const double strength = norm(pull);
        return strength > strongest ? (strongest / strength) * pull : pull;
    }

  private:
    static constexpr double spring = 400.0;    // [N/m]
    static constexpr double damper = 10.0;     // [N s/m]
    static constexpr double strongest = 15.0;  // [N]

    [[nodiscard]] std::size_t count() const { return xyz_.size() / 3; }
    [[nodiscard]] Vec3 point(std::size_t i) const { return vfplan::point_at(xyz_.data(), i); }
    /// A direction that leads out: along an ignored axis the fixture has no outside.
    static Vec3 across(const std::optional<Vec3>& axis) {
        if (!axis) return Vec3{{0, 0, 1}};
        Vec3 side[2];
        tangent_frame(*axis, side);
        return side[0];
    }
    [[nodiscard]] Vec3 goal(double t) const {
        const double share = t / seconds_;
        if (share < 0.2) return blend(outside_, point(0), share / 0.2);
        if (share >= 0.8) return blend(point(count() - 1), outside_, (share - 0.8) / 0.2);
        const double along = (share - 0.2) / 0.6 * static_cast<double>(count() - 1);
        const auto i = std::min(static_cast<std::size_t>(along), count() - 1);
        return blend(point(i), point(std::min(i + 1, count() - 1)), along - std::floor(along));
    }
    static Vec3 blend(const Vec3& a, const Vec3& b, double share) {
        return a + std::clamp(share, 0.0, 1.0) * (b - a);
    }

    std::span<const double> xyz_;
    double seconds_;
    Vec3 outside_{};
};

}  // namespace controller
