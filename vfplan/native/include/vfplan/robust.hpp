// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The default rule. The proxy never enters a sphere of radius R - band around a point, slides on
// the surfaces that the points sample, is held by every wall of a corner, and lets go.
//
// An iteration: find the surfaces that touch; fit each one's normal; take the step towards the HIP
// that keeps to all of them at height R; go along it until a sphere is met.
#pragma once

#include <utility>

#include "vfplan/cone.hpp"
#include "vfplan/contacts.hpp"
#include "vfplan/escape.hpp"
#include "vfplan/paper.hpp"
#include "vfplan/surface.hpp"
#include "vfplan/touched.hpp"
#include "vfplan/travel.hpp"
#include "vfplan/tuned.hpp"

namespace vfplan {

template <int D, template <int> class SearchOf>
class RobustRule {
  public:
    using Search = SearchOf<D>;
    static constexpr int dimension = D;

    RobustRule(const Cloud<D>& cloud, const Parameters& p, const Kernels<D>& kernels)
        : p_(p),
          kernels_(kernels),
          R_(p.R()),
          safe2_((R_ - p.band) * (R_ - p.band)),
          shell_(R_ + tuned::deep * p.band),
          grain_(std::sqrt(p.band / R_)),
          window_(std::min(tuned::window * spacing(), tuned::widest_window) * R_),
          lean_(std::min(tuned::lean * std::sqrt(2.0) * grain_, tuned::most_lean)),
          soft_{R_, R_ - p.band * (1 - tuned::margin),
                std::min(tuned::steep * grain_, tuned::most_steep)},
          hard_{R_, R_ - p.band * (1 - tuned::margin), 0},
          neighbours_(cloud, reach(), tuned::skin * R_, tuned::cell * R_, kernels),
          travel_(kernels, R_),
          escape_(kernels, R_),
          touched_(kernels),
          contacts_(shell_, std::cos(std::min(tuned::linked * grain_, tuned::most_linked))) {}

    Search& neighbours() noexcept { return neighbours_; }
    void reset() noexcept {
        neighbours_.forget();
        escape_.stop();
        known_ = false;
        held_ = false;
        count_ = 0;
        still_ = 0;
    }

    /// One servo loop.
    Tick<D> operator()(Vec<D>& proxy, const Vec<D>& hip) noexcept {
        Tick<D> tick;
        if (!held_ && !enter(proxy, hip, tick)) return tick;
        const Vec<D> start = proxy;
        most_ = norm(hip - proxy) + p_.band * (1 - tuned::margin);
        far_ = false;
        if (set_free(proxy, hip)) {
            still_ = 0;
        } else {
            blocked_ = false;
            tick.status = limit;
            for (int i = 0; i < p_.max_iterations && tick.status == limit && !far_; ++i)
                if (!advance(proxy, hip) && !far_) tick.status = ok;
            settle(proxy, start, hip);
        }
        double near2 = nearest2(proxy, shell_);
        if (!(near2 >= safe2_)) {  // cannot happen; if it does, stay where it was safe
            proxy = start;
            near2 = nearest2(proxy, shell_);
            tick.status |= limit;
            held_ = near2 >= safe2_;  // else it is taken out, from the next tick on
        }
        describe(proxy, near2, tick);
        return tick;
    }

  private:
    /// Of the cloud whose dimples are as deep as the band, in R.
    double spacing() const noexcept { return (D == 2 ? std::sqrt(8.0) : 2.0) * grain_; }
    /// What is asked of the list of neighbours: a fit's samples, and what a brief sweep may meet.
    double reach() const noexcept {
        return std::max((1.01 + tuned::brief) * R_,  // 1 % against rounding
                        std::sqrt(shell_ * shell_ + window_ * window_));
    }

    /// Makes sure that the proxy is outside, as the guarantee needs; false while it is on its way
    /// out.
    bool enter(Vec<D>& proxy, const Vec<D>& hip, Tick<D>& tick) noexcept {
        if (!escape_.active()) {
            if (nearest2(proxy, shell_) >= safe2_) return held_ = true;
            escape_.begin(neighbours_, hip);
        }
        held_ = escape_.step(neighbours_, hip, proxy);
        tick.state = State::entrenched;
        tick.normal = escape_.way();
        tick.status = inside;
        return false;
    }

    /// Below a HIP that has not moved for a while only a gain counts, so the proxy comes to rest.
    void settle(Vec<D>& x, const Vec<D>& start, const Vec<D>& hip) noexcept {
        still_ = hip == last_hip_ ? std::min(still_ + 1, tuned::patience) : 0;
        last_hip_ = hip;
        if (still_ == tuned::patience && !(norm(hip - x) < norm(hip - start) - rest())) x = start;
    }

    /// Where nothing lies on the straight way, the proxy goes with the HIP, whatever it touches.
    bool set_free(Vec<D>& x, const Vec<D>& hip) noexcept {
        const Vec<D> u = hip - x;
        const double distance = norm(u);
        if (!(distance > 0)) return true;
        look(x);
        for (int j = 0; j < count_; ++j)
            if (contacts_[j].r <= R_ && dot(contacts_[j].nearest, u) < 0) return false;
        const double s = travel_(neighbours_, x, (1 / distance) * u, distance, hard_, far_);
        x = s >= distance ? hip : count_ == 0 ? x + (s / distance) * u : x;
        return s >= distance;
    }

    /// One iteration; false when the proxy has come to rest.
    bool advance(Vec<D>& x, const Vec<D>& hip) noexcept {
        const Vec<D> u = hip - x;
        const double distance = norm(u);
        if (!(distance > 0)) return false;
        look(x);
        if (count_ == 0) {
            const double s = travel_(neighbours_, x, (1 / distance) * u, distance, hard_, far_);
            if (s >= distance) {
                x = hip;
                return false;
            }
            x = x + (s / distance) * u;
            return true;
        }
        // |proxy - HIP| never grows by more than the band in a tick: a lift has to wait.
        if (count_ == 1) wall_[0].t = std::min(wall_[0].t, most_ + dot(wall_[0].n, u));
        // Blocked below R, as in a hollow, where the way ahead rises: up first, on in the next.
        const bool lift = std::exchange(blocked_, false) && count_ == 1 && wall_[0].t > rest();
        const Vec<D> v = lift ? wall_[0].t * wall_[0].n : project(u, wall_, count_, slack());
        const double length = norm(v);
        if (!lift) push_ = v - u;
        if (!(length > rest())) return count_ > 1 && squeeze(x, hip);
        const double s = travel_(neighbours_, x, (1 / length) * v, length, soft_, far_);
        const Vec<D> y = s < length ? x + (s / length) * v : v == u ? hip : x + v;
        const bool stuck = s < std::min(length, rest());
        if (stuck && count_ > 1 && rise(x, hip, v)) return true;
        // Where two walls hold it: descend or stay. Their sampled normals alone would let it
        // wander.
        if (!(norm(hip - y) < (count_ > 1 ? distance : most_ + tuned::margin * p_.band)))
            return squeeze(x, hip);
        if (stuck && !(!lift && count_ == 1 && wall_[0].t > rest())) return squeeze(x, hip);
        x = y;
        blocked_ = !lift && s < length && count_ == 1 && wall_[0].t > rest();
        return !(x == hip);
    }

    /// One iteration between several walls where the step v is stopped at once by the points that
    /// the proxy has sunk among: first up to R above all walls, then on as v asks. False, and
    /// nothing done, unless both together bring the proxy nearer to the HIP.
    bool rise(Vec<D>& x, const Vec<D>& hip, const Vec<D>& v) noexcept {
        const Vec<D> up = project(Vec<D>{}, wall_, count_, slack()), on = v - up;
        if (!(norm(up) > rest() && norm(on) > rest())) return false;
        const Vec<D> y = moved(moved(x, up), on);
        if (!(norm(hip - y) < norm(hip - x))) return false;
        x = y;
        return true;
    }
    /// x after the step v, or after as much of it as is free.
    Vec<D> moved(const Vec<D>& x, const Vec<D>& v) noexcept {
        const double length = norm(v);
        const double s = travel_(neighbours_, x, (1 / length) * v, length, soft_, far_);
        return s < length ? x + (s / length) * v : x + v;
    }

    /// One iteration past the points that touch, where the fitted surfaces leave no way; false when
    /// the proxy is at rest among them. Always nearer to the HIP, so it cannot go round in circles.
    bool squeeze(Vec<D>& x, const Vec<D>& hip) noexcept {
        const Vec<D> u = hip - x;
        const Vec<D> v = touched_(neighbours_, x, u, R_ + rest(), slack());
        const double length = norm(v);
        // A way as flat as the slopes between samples gains nothing: the proxy would wander on it.
        if (!(length > std::max(rest(), grain_ * norm(u)))) return false;
        const Vec<D> y = moved(x, v);
        // Between several walls a gain of the band may be no more than sinking through it.
        const double least = count_ > 1 ? tuned::deep * p_.band : 0;
        if (!(norm(y - x) > rest() && norm(hip - y) < norm(u) - least)) return false;
        x = y;
        return true;
    }
    double rest() const noexcept { return tuned::rest * p_.band; }
    double slack() const noexcept { return tuned::slack * p_.band; }

    /// The surfaces that touch the proxy at x, and how far each one asks it to move.
    void look(const Vec<D>& x) noexcept {
        if (known_ && x == looked_at_) return;
        known_ = true;
        looked_at_ = x;
        contacts_.clear();
        neighbours_.visit(x, shell_, [&](const Span<D>& s) noexcept {
            std::uint32_t which[room];
            const std::size_t n = kernels_.within(s, x, shell_ * shell_, which, room);
            for (std::size_t i = 0; i < std::min(n, room); ++i) touch(s, which[i], x);
            if (n > room)  // a crowd of points: go through all of them
                for (std::size_t i = which[room - 1] + 1; i < s.n; ++i) touch(s, i, x);
        });
        contacts_.group();
        count_ = contacts_.count();
        for (int j = 0; j < count_; ++j) wall_[j] = wall(x, contacts_[j]);
    }
    void touch(const Span<D>& s, std::size_t i, const Vec<D>& x) noexcept {
        Vec<D> away = x;
        for (int k = 0; k < D; ++k) away.c[k] -= s.c[k][i];
        if (dot(away, away) <= shell_ * shell_) contacts_.add(away);
    }

    /// The normal of one surface, and the height that is missing to R above its nearest point.
    Wall<D> wall(const Vec<D>& x, const Contact<D>& c) noexcept {
        Patch<D> patch;
        patch.at = x;
        patch.up = c.direction;
        frame(patch.up, patch.side);
        patch.height = c.r;
        patch.scale = 1 / window_;
        patch.least2 = c.r * c.r;
        patch.most2 = patch.least2 + window_ * window_;
        patch.cosine2 = R_ * R_ / (R_ * R_ + 2 * window_ * window_);
        Moments<D> m;
        neighbours_.visit(x, std::sqrt(patch.most2),
                          [&](const Span<D>& s) noexcept { kernels_.patch(s, patch, m); });
        Wall<D> w;
        const Fit<D> f = fit(patch, m);
        // Points on one side of the foot only: the surface ends here, and the proxy turns round its
        // rim.
        const double whole = std::clamp(
            (tuned::one_sided - f.off) / (tuned::one_sided - tuned::surrounded), 0.0, 1.0);
        w.n = lean_at_most(f.n, c.direction, whole * lean_);
        const double deep = tuned::deep * p_.band;
        w.t = std::clamp(R_ - c.r * dot(c.nearest, w.n), -deep, deep);
        return w;
    }

    double nearest2(const Vec<D>& x, double reach) noexcept {
        double least = std::numeric_limits<double>::infinity();
        neighbours_.visit(x, reach, [&](const Span<D>& s) noexcept {
            least = std::min(least, kernels_.nearest2(s, x));
        });
        return least;
    }

    void describe(const Vec<D>& x, double near2, Tick<D>& tick) noexcept {
        const double touching = R_ + p_.band, near = p_.outer_radius + p_.point_radius;
        if (near2 <= touching * touching || (known_ && x == looked_at_ && count_ > 0)) {
            tick.state = State::in_contact;
            look(x);
            if (count_ == 1) tick.normal = wall_[0].n;
            if (count_ > 1) {
                Vec<D> n = push_;
                if (!(norm(n) > rest())) {
                    n = {};
                    for (int j = 0; j < count_; ++j) n = n + wall_[j].n;
                }
                tick.normal = along(n, 1);
            }
        } else if (near2 < near * near || nearest2(x, near) < near * near) {
            tick.state = State::free_motion;
        }
    }

    static constexpr std::size_t room = 256;

    Parameters p_;
    Kernels<D> kernels_;
    double R_, safe2_, shell_;
    double grain_;   // g of tuned.hpp
    double window_;  // lateral radius of the fit [m]
    double lean_;    // sine of the angle that a normal leans from the contact's on a surface
    Obstacles soft_, hard_;
    Search neighbours_;
    Travel<D, Search> travel_;
    Escape<D, Search> escape_;
    Touched<D, Search> touched_;
    Contacts<D> contacts_;
    Wall<D> wall_[Contacts<D>::most];
    int count_ = 0;
    Vec<D> looked_at_, push_, last_hip_;
    int still_ = 0;         // ticks that the HIP has not moved
    double most_ = 0;       // |proxy - HIP| that this tick may end with
    bool known_ = false;    // wall_ belongs to looked_at_
    bool blocked_ = false;  // the last iteration was stopped below R
    bool far_ = false;      // the way of this tick is longer than a tick may look at
    bool held_ = false;     // outside the fixture since the last reset
};

}  // namespace vfplan
