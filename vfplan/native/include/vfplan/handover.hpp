// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// From the way out of a fixture to the rule: the proxy goes the rule's own way, but each tick only
// as far as the force may change. What is left of the way waits for the next tick. Without it
// test_a_hand_that_leaves_clutter_feels_no_jump fails.
#pragma once

#include "vfplan/force_ramp.hpp"
#include "vfplan/tuned.hpp"

namespace vfplan {

template <int D>
class Handover {
  public:
    static constexpr int most = 64;           // corners of a way
    static constexpr double kept = 1.0 / 64;  // of R: a HIP that goes further needs a new way

    explicit Handover(double radius) noexcept : R_(radius) {}

    bool active() const noexcept { return active_; }
    /// Something of the way is left, and it still leads to the HIP at h.
    bool leads(const Vec<D>& h) const noexcept {
        return next_ < count_ && norm(h - hip_) <= kept * R_;
    }

    void begin() noexcept {
        active_ = true;
        next_ = count_ = unfinished_ = 0;
    }
    void stop() noexcept { active_ = planning_ = false; }
    /// The way may lead into what is new.
    void forget() noexcept { next_ = count_ = 0; }

    /// The rule goes to the HIP at h now, and tells each corner that it passes.
    void plan(const Vec<D>& h) noexcept {
        hip_ = h;
        next_ = count_ = 0;
        planning_ = true;
    }
    bool planning() const noexcept { return planning_; }
    bool full() const noexcept { return planning_ && count_ + 2 > most; }
    void pass(const Vec<D>& x) noexcept {
        if (planning_) corner_[count_++] = x;
    }
    /// The rule has gone; `moved`: to the end of those corners, and not back to where it was.
    void planned(bool moved) noexcept {
        planning_ = false;
        if (!moved) count_ = 0;
    }
    /// The rule's way fits into this tick, to its end or to where the rule ran out of iterations.
    /// True when the rule has taken over: it may never come to an end below a HIP that trembles.
    bool fits(bool end) noexcept { return end || ++unfinished_ == tuned::patience; }

    /// Goes on from x as far as the leash allows; true at the end of the way.
    bool walk(Vec<D>& x, const Leash<D>& leash) noexcept {
        for (; next_ < count_; ++next_) {
            const Vec<D> leg = corner_[next_] - x;
            const double length = norm(leg);
            if (!(length > 0)) continue;
            const double s = leash(x, (1 / length) * leg, length);
            x = s < length ? x + (s / length) * leg : corner_[next_];
            if (s < length) return false;
        }
        return true;
    }

  private:
    double R_;
    bool active_ = false, planning_ = false;
    Vec<D> corner_[most];
    Vec<D> hip_;  // that the way was made for
    int next_ = 0, count_ = 0;
    int unfinished_ = 0;  // ways that fitted and had no end
};

}  // namespace vfplan
