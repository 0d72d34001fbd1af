// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A start inside the fixture: the way out, and how slowly the force may change on it and after it.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include "vfplan/base/vec.hpp"
#include "vfplan/cloud/grid.hpp"
#include "vfplan/parameters.hpp"
#include "vfplan/rules/constants.hpp"

namespace vfplan {

// How fast the force may grow or turn after a start inside, an exchange or an edit: the way out
// keeps to it, and so does the handover until the rule has taken over.

/// Of R, a tick: how fast the force may change besides following the HIP.
inline constexpr double ramp = 1.0 / 256;

/// A ball that holds the proxy for one tick. Its middle is where the proxy would be had it gone
/// with the HIP, its radius what K times it may add to the force, or turn it by.
template <int D>
struct Leash {
    Vec<D> middle;
    double radius;

    /// The part of [0, length] from x, in the ball, along the unit vector `way` that stays in it.
    double operator()(const Vec<D>& x, const Vec<D>& way, double length) const noexcept {
        const Vec<D> w = x - middle;
        const double b = dot(w, way), c = dot(w, w) - radius * radius;
        return std::clamp(std::sqrt(std::max(0.0, b * b - c)) - b, 0.0, length);
    }
};

// From the way out of a fixture to the rule: the proxy goes the rule's own way, but each tick only
// as far as the force may change. What is left of the way waits for the next tick. Without it
// test_a_hand_that_leaves_clutter_feels_no_jump fails.

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

// A start inside the fixture: the proxy is taken out along the shortest way found, slowly, so that
// the force ramps; it follows the HIP meanwhile. Outside, the rule takes over as slowly.

/// The free space before an exchange. A way out leads to the proxy's own side if the proxy could
/// have gone it before, and comes out with the fixture, in the direction -out, where it was.
template <int D>
class Passage {
  public:
    virtual bool free(const Vec<D>& d, double length, const Vec<D>& out) const noexcept = 0;

  protected:
    ~Passage() = default;
};

/// What a start may be inside of: the balls of radius R around the points of a cloud.
template <int D>
class Balls {
  public:
    static constexpr double never = std::numeric_limits<double>::infinity();

    Balls(const Kernels<D>& kernels, double radius) noexcept : kernels_(kernels), R_(radius) {}

    /// From the nearest point within R to x; 0 where there is none but at x itself.
    template <class Search>
    Vec<D> from_nearest(Search& search, const Vec<D>& x) const noexcept {
        double least = never;
        Vec<D> away;
        search.source().visit(x, R_ * (1 + 1e-6), [&](const Span<D>& s) noexcept {
            if (!(kernels_.nearest2(s, x) < least)) return;
            for (std::size_t i = 0; i < s.n; ++i) {
                const Vec<D> w = x - s[i];
                const double d2 = dot(w, w);
                if (d2 < least && d2 > 0) least = d2, away = w;
            }
        });
        return away;
    }
    /// Distance from y along d out of all balls that y is in; -infinity in none.
    template <class Search>
    double out(Search& search, const Vec<D>& y, const Vec<D>& d) const noexcept {
        const double inside2 = R_ * R_ * (1 - 1e-9);
        double s = -never;
        search.source().visit(y, R_, [&](const Span<D>& span) noexcept {
            s = std::max(s, kernels_.out(span, y, d, inside2, R_ * R_));
        });
        return s;
    }

  private:
    Kernels<D> kernels_;
    double R_;
};

template <int D, class Search, class Around = Balls<D>>
class Escape {
  public:
    static constexpr int most_hops = 48;             // from sphere to sphere along the way, a tick
    static constexpr int most_hops_to_choose = 128;  // along all ways together, a tick
    static constexpr int most_ticks_to_choose = 1024;

    Escape(const Around& around, double radius) noexcept : around_(around), R_(radius) {}

    bool active() const noexcept { return active_; }
    const Vec<D>& way() const noexcept { return way_; }
    void stop() noexcept {
        active_ = crossed_ = false;
        passage_ = nullptr;
    }
    /// The next way out is one that keeps to this, where there is one.
    void keep_to(const Passage<D>* passage) noexcept { passage_ = passage; }
    /// `inside`, and whether no way out on the proxy's own side was found.
    std::uint8_t status() const noexcept { return crossed_ ? inside | crossed : inside; }

    /// The HIP is at h, and the proxy inside: look for the way out, from the next step on.
    void begin(Search& search, const Vec<D>& h) noexcept {
        active_ = true;
        out_ = 0;
        last_ = start_ = h;
        way_ = Vec<D>{};
        way_.c[D - 1] = 1;
        way_ = nearest_ = from_nearest(search, h);
        best_ = never;
        for (double& t : reached_) t = 0;
        ticks_to_choose_ = most_ticks_to_choose;
        crossed_ = false;
    }

    /// One tick; true when the proxy has reached the free space.
    bool step(Search& search, const Vec<D>& h, Vec<D>& proxy) noexcept {
        bool out = false;
        if (ticks_to_choose_ > 0 && !choose(search)) {  // no force before there is a way
            --ticks_to_choose_;
            out = hop(search, h, way_) == free;
        } else {
            ticks_to_choose_ = 0;
            passage_ = nullptr;
            out = go(search, h);
        }
        last_ = h;
        proxy = h + out_ * way_;
        active_ = !out;
        return out;
    }

    /// The HIP is at h, wherever the way out began.
    void meets(const Vec<D>& h) noexcept { last_ = h; }

    /// Where the proxy, now at x, may go while the rule takes over: the HIP has come to h.
    Leash<D> leash(const Vec<D>& x, const Vec<D>& h) noexcept {
        const Vec<D> moved = h - std::exchange(last_, h);
        return {x + moved, ramp * R_ + norm(moved)};
    }

  private:
    static constexpr int ring = D == 3 ? 27 : 9;
    static constexpr double never = std::numeric_limits<double>::infinity();
    static constexpr double free = -never;

    Vec<D> from_nearest(Search& search, const Vec<D>& x) noexcept {
        const Vec<D> away = around_.from_nearest(search, x);
        const double r = norm(away);
        return r > 0 ? (1 / r) * away : way_;
    }

    /// From the nearest point, its opposite, and the neighbours of a cube.
    Vec<D> candidate(int i) const noexcept {
        if (i < 2) return (i == 0 ? 1.0 : -1.0) * nearest_;
        Vec<D> d;
        for (int k = 0, rest = i - 2; k < D; ++k, rest /= 3) d.c[k] = rest % 3 - 1;
        return norm(d) > 0 ? along(d, 1) : nearest_;
    }

    /// All ways are followed hop by hop, in turn, so that none uses up the hops of a tick; false
    /// while the shortest one is not known.
    bool choose(Search& search) noexcept {
        int hops = most_hops_to_choose;
        for (bool open = true; open;) {
            open = false;
            for (int i = 0; i < ring + 2; ++i) {
                if (!(reached_[i] < best_)) continue;
                if (hops-- == 0) return false;
                open = true;
                const Vec<D> d = candidate(i);
                const double s = hop(search, start_ + reached_[i] * d, d);
                if (s == free)
                    best_ = reached_[i], way_ = d, chosen_ = i;
                else
                    reached_[i] += s;
            }
        }
        if (!own(search, way_, best_)) return refuse();
        for (int i = 0; i < 2; ++i) {
            const Vec<D> d = from_nearest(search, start_ + best_ * way_);
            const double t = exit(search, start_, d, best_);
            if (t < best_ && own(search, d, t)) best_ = t, way_ = d;
        }
        return true;
    }
    bool own(Search& search, const Vec<D>& d, double length) noexcept {
        return !passage_ || passage_->free(d, length, from_nearest(search, start_ + length * d));
    }
    /// The shortest way leads to the other side: the next one, or of all, where none is left.
    bool refuse() noexcept {
        reached_[chosen_] = best_ = never;
        for (double t : reached_)
            if (t < never) return false;
        for (double& t : reached_) t = 0;
        passage_ = nullptr;
        crossed_ = true;
        return false;
    }

    /// One tick along the way; true when that ends outside.
    bool go(Search& search, const Vec<D>& h) noexcept {
        const double behind = exit(search, h, way_, out_);
        if (behind < out_) {  // as when the HIP has come through to the other side
            out_ = std::max(behind, out_ - ramp * R_);
        } else {
            const double most = ramp * R_ + std::max(0.0, -dot(h - last_, way_));
            const double ahead = exit(search, h + out_ * way_, way_, most);
            out_ += std::min(ahead, most);
            if (ahead < most) return true;
        }
        return hop(search, h + out_ * way_, way_) == free;
    }

    /// Distance from h along d to the free space; infinity beyond `most` or out of hops.
    double exit(Search& search, const Vec<D>& h, const Vec<D>& d, double most) noexcept {
        double t = 0;
        for (int i = 0; i < most_hops && t < most; ++i) {
            const double s = hop(search, h + t * d, d);
            if (s == free) return t;
            t += s;
        }
        return never;
    }

    /// Distance from y along d out of all that y is in; `free` where it is in nothing.
    double hop(Search& search, const Vec<D>& y, const Vec<D>& d) noexcept {
        const double s = around_.out(search, y, d);
        return s == free ? s : s + 1e-12 * R_;
    }

    Around around_;
    double R_;
    bool active_ = false;
    Vec<D> way_, last_;
    double out_ = 0;  // from the HIP to the proxy, along the way
    Vec<D> start_, nearest_;
    double reached_[ring + 2] = {};  // along each candidate, from the start
    double best_ = never;
    int chosen_ = 0;  // of the candidates
    const Passage<D>* passage_ = nullptr;
    bool crossed_ = false;
    int ticks_to_choose_ = 0;
};

// Whether the proxy is outside, as the rules `robust` and `exact` need it, and how it comes there:
// led out of what it starts in; then the rule takes over, each tick as far as the force may change.

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
