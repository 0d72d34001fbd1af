// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Whether the HIP rests, so that the proxy has to come to rest as well.
//
// On one surface a lift may take the proxy away from the HIP, and the slide that follows may bring
// it back to where it was: round and round among points that no fit explains. So the lifts below
// one place of the HIP are limited. Beyond, the proxy descends or stays, and towards that place: a
// HIP that trembles around it gives no new reason to move. Without it
// test_a_trembling_hip_does_not_keep_it_moving fails.
#pragma once

#include <algorithm>

#include "vfplan/tuned.hpp"
#include "vfplan/vec.hpp"

namespace vfplan {

template <int D>
class Rest {
  public:
    explicit Rest(double band) noexcept : band_(band) {}

    /// Nothing holds the proxy.
    void wake() noexcept { held_ = false; }

    /// A tick begins with the proxy held, `distance` from the HIP h: what the rule is to move it
    /// to, near h. `ticks`: as how many it counts where the HIP is still.
    const Vec<D>& goal(const Vec<D>& h, double distance, int ticks) noexcept {
        if (!held_ || !near(h, place_, 1)) {
            held_ = true;
            place_ = still_at_ = h;
            least_ = distance;
            lifted_ = 0;
            still_ = 0;
        } else if (!near(h, still_at_, tuned::margin)) {
            still_at_ = h;
            still_ = 0;
        } else if (still_ < tuned::patience) {
            still_ = std::min(still_ + ticks, tuned::patience);
            if (still_ == tuned::patience) place_ = h;
        }
        stalled_ = still_ == tuned::patience || lifted_ > tuned::deep * band_;
        return stalled_ ? place_ : h;
    }

    /// Whether each iteration of this tick has to bring the proxy nearer to its goal.
    bool is_stalled() const noexcept { return stalled_; }

    /// An iteration has changed |proxy - goal| by `growth`.
    void count_lift(double growth) noexcept {
        if (growth > tuned::min_advance * band_) lifted_ += growth;
    }

    /// The iterations went to x, to the end or until there were none left: as much as a lift of b.
    void ends(const Vec<D>& x, bool end) noexcept {
        if (!end) lifted_ += band_;
        if (!(lifted_ > 0)) return;
        if (const double left = norm(place_ - x); left < least_ - band_) {  // it gets somewhere
            least_ = left;
            lifted_ = 0;
        }
    }

    /// Whether the tick from `start` to x, the HIP at h, is to be undone: its iterations brought
    /// the proxy hardly nearer to its goal, or it is further from the HIP than any tick may take
    /// it.
    bool undoes(const Vec<D>& start, const Vec<D>& x, const Vec<D>& h,
                int iterations) const noexcept {
        if (!stalled_) return false;
        const double gain = norm(place_ - start) - norm(place_ - x);
        return !(gain > iterations * tuned::min_advance * band_ &&
                 norm(h - x) <= norm(h - start) + band_);
    }

  private:
    bool near(const Vec<D>& a, const Vec<D>& b, double bands) const noexcept {
        const Vec<D> d = a - b;
        return dot(d, d) <= bands * bands * band_ * band_;
    }

    double band_;
    bool held_ = false, stalled_ = false;
    Vec<D> place_;       // of the HIP, where the lifts are counted
    double lifted_ = 0;  // by which they took the proxy away from its goal
    double least_ = 0;   // |proxy - place_| from where they are counted
    Vec<D> still_at_;
    int still_ = 0;  // ticks that the HIP has been at still_at_
};

}  // namespace vfplan
