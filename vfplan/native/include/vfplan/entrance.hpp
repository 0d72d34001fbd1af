// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Whether the proxy is outside, as the rules `robust` and `exact` need it, and how it comes there:
// led out of what it starts in; then the rule takes over, each tick as far as the force may change.
#pragma once

#include "vfplan/escape.hpp"

namespace vfplan {

template <int D, class Search, class Around = Balls<D>>
class Entrance {
  public:
    Entrance(const Around& around, double radius) noexcept : escape_(around, radius) {}

    void reset() noexcept {
        escape_.stop();
        held_ = taking_over_ = stays_ = false;
    }
    /// After a reset: a proxy that is inside is led out from where it is.
    void go_on(const Passage<D>* before) noexcept {
        stays_ = true;
        escape_.keep_to(before);
    }

    /// Makes sure that the proxy is outside; false while it is on its way out. `clear`: whether one
    /// of which nothing is known is outside.
    template <class Clear>
    bool outside(Search& search, Vec<D>& proxy, const Vec<D>& hip, Clear&& clear) noexcept {
        if (held_) return true;
        if (!escape_.active()) {
            if (clear()) return escape_.stop(), held_ = true;
            anchor_ = proxy;
            escape_.begin(search, stays_ ? proxy : hip);
        }
        held_ = escape_.step(search, stays_ ? anchor_ : hip, proxy);
        taking_over_ = held_ && !(proxy == hip);
        if (held_) {
            escape_.meets(hip);
            stays_ = false;
        }
        unfinished_ = 0;
        return false;
    }
    /// What a tick on the way out tells.
    Tick<D> tick() const noexcept {
        Tick<D> tick;
        tick.state = State::entrenched;
        tick.normal = escape_.way();
        tick.status = escape_.status();
        return tick;
    }

    bool taking_over() const noexcept { return taking_over_; }
    Leash<D> leash(const Vec<D>& x, const Vec<D>& h) noexcept { return escape_.leash(x, h); }
    /// The rule has gone as far as the leash, or until it had no steps left; whether it still has
    /// to take over.
    bool goes_on(bool leashed, bool limited) noexcept {
        return taking_over_ = leashed || (limited && ++unfinished_ < most_unfinished);
    }
    /// Whether the proxy is outside yet; else it is taken out from the next tick on.
    void hold(bool outside) noexcept { held_ = outside; }
    /// Something has come near: from the next tick on a proxy that is inside of it is led out.
    void look_again() noexcept { stays_ = std::exchange(held_, false) || stays_; }

  private:
    static constexpr int most_unfinished = 32;

    Escape<D, Search, Around> escape_;
    Vec<D> anchor_;  // where a way out began on which the proxy stays
    int unfinished_ = 0;
    bool held_ = false, taking_over_ = false;
    bool stays_ = false;  // on the way out the proxy does not go with the HIP
};

}  // namespace vfplan
