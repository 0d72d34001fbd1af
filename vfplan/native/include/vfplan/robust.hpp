// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The default rule. The proxy never enters a sphere of radius R - band around a point, slides on
// the surfaces that the points sample, is held by every wall of a corner, and lets go.
//
// An iteration: find the surfaces that touch; fit each one's normal; take the step towards the HIP
// that keeps to all of them at height R; go along it until a sphere is met.
#pragma once

#include <utility>

#include "vfplan/entrance.hpp"
#include "vfplan/parameters.hpp"
#include "vfplan/rest.hpp"
#include "vfplan/status.hpp"
#include "vfplan/surfaces.hpp"
#include "vfplan/thinning.hpp"
#include "vfplan/touched.hpp"
#include "vfplan/travel.hpp"
#include "vfplan/tuned.hpp"

namespace vfplan {

template <int D, template <int> class SearchOf>
class RobustRule {
  public:
    using Search = SearchOf<D>;
    static constexpr int dimension = D;

    RobustRule(const Thinned<D>& of, const Parameters& p, const Kernels<D>& kernels)
        : p_(p),
          kernels_(kernels),
          R_(p.R()),
          safe2_((R_ - p.band + of.lent) * (R_ - p.band + of.lent)),
          grain_(std::sqrt(p.band / R_)),
          graze_{R_, R_ - (p.band - of.lent) * (1 - tuned::margin),
                 std::min(tuned::linked * grain_, tuned::most_linked / 2)},
          full_{R_, R_ - (p.band - of.lent) * (1 - tuned::margin), 0},
          surfaces_(kernels, R_, p.band),
          neighbours_(of.cloud, reach(), 0.75 * tuned::brief * R_, 2 * tuned::brief * R_, kernels),
          travel_(kernels, R_),
          entrance_({kernels, R_}, R_),
          handover_(R_),
          touched_(kernels),
          rest_(p.band) {}

    Search& neighbours() noexcept { return neighbours_; }
    void reset() noexcept {
        neighbours_.forget();
        surfaces_.forget();
        entrance_.reset();
        handover_.stop();
        rest_.wake();
    }
    /// As a reset, but a proxy that is inside is led out from where it is.
    void go_on(const Passage<D>* before) noexcept {
        reset();
        entrance_.go_on(before);
    }
    /// A point at p came or went.
    void edited(const Vec<D>& p, bool came) noexcept {
        handover_.forget();
        if (!neighbours_.reaches(p)) return;
        neighbours_.forget();
        surfaces_.forget();
        rest_.wake();
        if (came) entrance_.look_again();
    }

    /// One servo loop.
    Tick<D> operator()(Vec<D>& proxy, const Vec<D>& hip) noexcept {
        const auto clear = [&]() noexcept { return nearest2(proxy, surfaces_.shell()) >= safe2_; };
        if (!entrance_.outside(neighbours_, proxy, hip, clear)) {
            handover_.stop();
            if (entrance_.taking_over()) handover_.begin();
            return entrance_.tick();
        }
        return handover_.active() ? take_over(proxy, hip) : follow(proxy, hip);
    }

  private:
    /// One servo loop of a proxy that is outside.
    Tick<D> follow(Vec<D>& proxy, const Vec<D>& hip) noexcept {
        Tick<D> tick;
        const Vec<D> start = proxy;
        const double distance = norm(hip - proxy);
        now_.most = distance + p_.band * (1 - tuned::margin);
        now_.far = false;
        travel_.begin();
        if (try_straight_path(proxy, hip, distance)) {
            rest_.wake();
        } else {
            const int ticks =
                handover_.planning() ? tuned::patience : 1;  // a planned way counts as a rest
            const Vec<D>& goal = rest_.goal(hip, distance, ticks);
            now_.blocked = false;
            tick.status = limit;
            int i = 0;
            for (; i < p_.max_iterations && tick.status == limit && !now_.far; ++i) {
                if (!advance(proxy, goal) && !now_.far) tick.status = ok;
                if (handover_.full()) break;
            }
            rest_.ends(proxy, tick.status == ok);
            if (rest_.undoes(start, proxy, hip, i)) {
                proxy = start;
                tick.status = ok;
            }
        }
        double near2 = nearest2(proxy, surfaces_.shell());
        if (!(near2 >= safe2_)) {  // cannot happen; if it does, stay where it was safe
            proxy = start;
            near2 = nearest2(proxy, surfaces_.shell());
            tick.status |= limit;
            entrance_.hold(near2 >= safe2_);
        }
        describe(proxy, hip, near2, tick);
        return tick;
    }

    /// One servo loop of a proxy that has come out and is not yet where the rule would have it.
    Tick<D> take_over(Vec<D>& proxy, const Vec<D>& hip) noexcept {
        const Leash<D> leash = entrance_.leash(proxy, hip);
        if (!handover_.leads(hip)) {
            Vec<D> end = proxy;
            handover_.plan(hip);
            const Tick<D> tick = follow(end, hip);
            handover_.planned(!(end == proxy));
            const bool there = handover_.walk(proxy, leash);
            if (there && handover_.fits(tick.status == ok)) {
                handover_.stop();
                proxy = end;
                return tick;
            }
        } else {
            handover_.walk(proxy, leash);
        }
        Tick<D> tick;
        tick.status = inside;
        describe(proxy, hip, nearest2(proxy, surfaces_.shell()), tick);
        return tick;
    }

    /// What the iterations of one tick share.
    struct Iterations {
        double most = 0;       // |proxy - HIP| that this tick may end with
        bool blocked = false;  // the last iteration was stopped below R
        bool far = false;      // the way of this tick is longer than a tick may look at
    };

    /// What is asked of the list of neighbours: a fit's samples, and what a brief sweep may meet.
    double reach() const noexcept {
        return std::max((1.01 + tuned::brief) * R_, surfaces_.reach());  // 1 %: roundings
    }

    /// Where nothing lies on the straight way, the proxy goes with the HIP, whatever it touches.
    bool try_straight_path(Vec<D>& x, const Vec<D>& hip, double distance) noexcept {
        if (!(distance > 0)) return true;
        const Vec<D> u = hip - x;
        update_contacts(x);
        for (int j = 0; j < count(); ++j)
            if (surfaces_.contact(j).r <= R_ && dot(surfaces_.contact(j).nearest, u) < 0)
                return false;
        return straight(x, hip, distance) || distance <= slack();  // there but for a rounding
    }
    /// To the HIP, or, where nothing touches, up to what is met; true where it is there.
    bool straight(Vec<D>& x, const Vec<D>& hip, double distance) noexcept {
        const Vec<D> u = hip - x;
        const double s = travel_(neighbours_, x, (1 / distance) * u, distance, full_, now_.far);
        if (s >= distance) return go(x, hip);
        if (count() == 0) go(x, x + (s / distance) * u);
        return false;
    }
    bool go(Vec<D>& x, const Vec<D>& to) noexcept {
        x = to;
        handover_.pass(x);
        return true;
    }

    /// One iteration; false when the proxy has come to rest.
    bool advance(Vec<D>& x, const Vec<D>& hip) noexcept {
        const Vec<D> u = hip - x;
        const double distance = norm(u);
        if (!(distance > 0)) return false;
        update_contacts(x);
        if (count() == 0) return !straight(x, hip, distance);
        // |proxy - HIP| never grows by more than the band in a tick: a lift has to wait its turn.
        Wall<D> wall = walls()[0];
        const double margin = tuned::margin * p_.band;
        const double most = rest_.is_stalled() ? distance - margin : now_.most;
        wall.lift = std::min(wall.lift, most + dot(wall.n, u));
        // Blocked below R, as in a hollow, where the way ahead rises: up first, on in the next.
        const bool below = count() == 1 && wall.lift > min_advance();
        const bool lifting = std::exchange(now_.blocked, false) && below;
        const bool lifts_next = below && !lifting;
        const Vec<D> v = lifting        ? wall.lift * wall.n
                         : count() == 1 ? surfaces_.slide(u, wall, slack())
                                        : surfaces_.step(u, slack());
        const double length = norm(v);
        if (!(length > min_advance())) return count() > 1 && step_between_points(x, hip);
        const double s = travel_(neighbours_, x, (1 / length) * v, length, graze_, now_.far);
        const Vec<D> y = s < length ? x + (s / length) * v : v == u ? hip : x + v;
        const bool stuck = s < std::min(length, min_advance());
        if (stuck && count() > 1 && lift_then_step(x, hip, v)) return true;
        // Between two walls: descend or stay, for their sampled normals would let it wander.
        const double left = norm(hip - y);
        const double allowed = count() > 1 ? distance : most + margin;
        if (!(left < allowed) || (stuck && !lifts_next)) return step_between_points(x, hip);
        go(x, y);
        rest_.count_lift(left - distance);
        now_.blocked = lifts_next && s < length;
        return !(x == hip);
    }

    /// One iteration between several walls where the step v is stopped at once by the points that
    /// the proxy has sunk among: first up to R above all walls, then on as v asks. False, and
    /// nothing done, unless both bring it nearer. For test_coarse_channel_is_followed_at_speed.
    bool lift_then_step(Vec<D>& x, const Vec<D>& hip, const Vec<D>& v) noexcept {
        const Vec<D> up = project(Vec<D>{}, walls(), count(), slack()), on = v - up;
        if (!(norm(up) > min_advance() && norm(on) > min_advance())) return false;
        const Vec<D> top = moved(x, up), y = moved(top, on);
        if (!(norm(hip - y) < norm(hip - x))) return false;
        go(x, top);
        return go(x, y);
    }
    /// x after the step v, or after as much of it as is free.
    Vec<D> moved(const Vec<D>& x, const Vec<D>& v) noexcept {
        const double length = norm(v);
        const double s = travel_(neighbours_, x, (1 / length) * v, length, graze_, now_.far);
        return s < length ? x + (s / length) * v : x + v;
    }

    /// One iteration past the points that touch, where the fitted surfaces leave no way; false at
    /// rest among them. Never away from the HIP. For test_where_it_rests_there_is_no_way_on.
    bool step_between_points(Vec<D>& x, const Vec<D>& hip) noexcept {
        const Vec<D> u = hip - x;
        const Vec<D> v = touched_(neighbours_, x, u, R_ + min_advance(), slack());
        // A way as flat as the slopes between samples gains nothing: the proxy would wander on it.
        if (!(norm(v) > std::max(min_advance(), grain_ * norm(u)))) return false;
        const Vec<D> y = moved(x, v);
        // Between several walls a gain of the band may be no more than sinking through it.
        const double least = count() > 1 ? tuned::deep * p_.band : 0;
        if (!(norm(y - x) > min_advance() && norm(hip - y) < norm(u) - least)) return false;
        return go(x, y);
    }
    double min_advance() const noexcept { return tuned::min_advance * p_.band; }
    double slack() const noexcept { return tuned::slack * p_.band; }

    int count() const noexcept { return surfaces_.count(); }
    const Wall<D>* walls() const noexcept { return surfaces_.walls(); }
    void update_contacts(const Vec<D>& x) noexcept { surfaces_.update(neighbours_, x); }

    double nearest2(const Vec<D>& x, double reach) noexcept {
        return vfplan::nearest2(neighbours_, kernels_, x, reach);
    }
    void describe(const Vec<D>& x, const Vec<D>& hip, double near2, Tick<D>& tick) noexcept {
        const double touching = R_ + p_.band, near = p_.outer_radius + p_.point_radius;
        if (near2 <= touching * touching || (surfaces_.known_at(x) && count() > 0)) {
            tick.state = State::in_contact;
            update_contacts(x);
            tick.normal = surfaces_.normal(hip - x, min_advance(), slack());
        } else if (near2 < near * near || nearest2(x, near) < near * near) {
            tick.state = State::free_motion;
        }
    }

    Parameters p_;
    Kernels<D> kernels_;
    double R_, safe2_, grain_;  // grain_: g of tuned.hpp
    Obstacles graze_, full_;
    Surfaces<D, Search> surfaces_;
    Search neighbours_;
    Travel<D, Search> travel_;
    Entrance<D, Search> entrance_;
    Handover<D> handover_;
    Touched<D, Search> touched_;
    Rest<D> rest_;
    Iterations now_;
};

}  // namespace vfplan
