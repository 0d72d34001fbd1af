// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The default rule. The proxy never enters a sphere of radius R - band around a point, slides on
// the surfaces that the points sample, is held by every wall of a corner, and lets go.
//
// An iteration: find the surfaces that touch; fit each one's normal; take the step towards the HIP
// that keeps to all of them at height R; go along it until a sphere is met.
#pragma once

#include <algorithm>
#include <utility>

#include "vfplan/base/half_spaces.hpp"
#include "vfplan/base/vec.hpp"
#include "vfplan/cloud/density.hpp"
#include "vfplan/cloud/grid.hpp"
#include "vfplan/parameters.hpp"
#include "vfplan/rules/constants.hpp"
#include "vfplan/rules/contacts.hpp"
#include "vfplan/rules/start_inside.hpp"

namespace vfplan {

// Whether the HIP rests, so that the proxy has to come to rest as well.
//
// On one surface a lift may take the proxy away from the HIP, and the slide that follows may bring
// it back to where it was: round and round among points that no fit explains. So the lifts below
// one place of the HIP are limited. Beyond, the proxy descends or stays, and towards that place: a
// HIP that trembles around it gives no new reason to move. Without it
// test_a_trembling_hip_does_not_keep_it_moving fails.

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

// How far the proxy can go along a straight way: the whole way, not a step of it.

/// What stops the proxy: spheres of radius `outer` met steeply, of radius `inner` met at a graze.
struct Obstacles {
    double outer, inner;
    double steep;  ///< sine of the angle between way and sphere above which a meeting is steep
};

template <int D, class Search>
class Travel {
  public:
    static constexpr int most_stretches = 128;  // of all ways of a tick, each as long as R

    Travel(const Kernels<D>& kernels, double radius) noexcept : kernels_(kernels), R_(radius) {}

    /// A tick begins.
    void begin() noexcept { left_ = most_stretches; }

    /// Length of the part of [0, length] from x along the unit vector `way` that is free. `limit`
    /// is set when the way has more stretches than a tick may look at; the answer is then what was
    /// seen.
    double operator()(Search& search, const Vec<D>& x, const Vec<D>& way, double length,
                      const Obstacles& o, bool& limit) noexcept {
        const double steep = o.steep * o.outer;
        Ray<D> ray{x, way, o.outer * o.outer, o.inner * o.inner, steep * steep};
        if (length <= stretch()) return std::min(length, first(search, ray, length));
        double a, b;
        if (!search.source().box().clip(x, way, length, R_, a, b)) return length;
        for (; left_ > 0; --left_, a += stretch()) {
            const double most = std::min(stretch(), b - a);
            if (most <= 0) return length;
            ray.from = x + a * way;
            const double s = first(search, ray, most);
            if (s < most) return std::min(length, a + s);
        }
        limit = true;
        return std::min(length, a);
    }

  private:
    double stretch() const noexcept { return R_; }

    double first(Search& search, const Ray<D>& ray, double length) const noexcept {
        double s = std::numeric_limits<double>::infinity();
        // Short ways lie in the list around the proxy; long ones are asked around their middle.
        const bool brief = length <= tuned::brief * R_;
        const Vec<D> around = brief ? ray.from : ray.from + 0.5 * length * ray.way;
        const double reach = R_ + (brief ? length : 0.5 * length);
        const auto look = [&](const Span<D>& span) noexcept {
            s = std::min(s, kernels_.meet(span, ray));
        };
        if (brief)
            search.visit(around, reach, look);
        else
            search.source().visit(around, reach, look);
        // A hair before the sphere, so that it is met again and not, by a rounding, entered.
        return std::max(0.0, s - tuned::hair * R_);
    }

    Kernels<D> kernels_;
    double R_;
    int left_ = most_stretches;
};

// Where fitted surfaces leave no way, the points themselves decide: the step nearest to a wished
// one that runs into none of the points that touch the proxy, the god-object's own.

template <int D, class Search>
class Touched {
  public:
    static constexpr int most = 8;  // points that may bend the step

    explicit Touched(const Kernels<D>& kernels) noexcept : kernels_(kernels) {}

    /// argmin |v - u| with (x - p) · v >= 0 for the points p within `reach` of x, by a hair more
    /// than 0, so that rounding does not stop it at once. The points that v runs into most steeply
    /// are taken one after the other, until there is none.
    Vec<D> operator()(Search& search, const Vec<D>& x, const Vec<D>& u, double reach,
                      double slack) const noexcept {
        Wall<D> wall[most];
        Vec<D> v = u;
        for (int count = 0; count < most; ++count) {
            double into = 0;
            visit(search, x, reach, [&](const Vec<D>& away) noexcept {
                const double r = norm(away), a = dot(away, v);
                if (r > 0 && a < into * r) into = a / r, wall[count] = {(1 / r) * away, slack};
            });
            if (into == 0) break;
            v = project(u, wall, count + 1, 0.5 * slack);
            if (!(norm(v) > slack)) break;
        }
        return v;
    }

  private:
    template <class F>
    void visit(Search& search, const Vec<D>& x, double reach, F&& f) const noexcept {
        search.visit(x, reach, [&](const Span<D>& s) noexcept {
            std::uint32_t which[room];
            const std::size_t n = kernels_.within(s, x, reach * reach, which, room);
            for (std::size_t i = 0; i < std::min(n, room); ++i) f(x - s[which[i]]);
            if (n <= room) return;
            for (std::size_t i = which[room - 1] + 1; i < s.n; ++i) {  // a crowd of points
                const Vec<D> w = x - s[i];
                if (dot(w, w) <= reach * reach) f(w);
            }
        });
    }

    static constexpr std::size_t room = 256;
    Kernels<D> kernels_;
};

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
    double R_, safe2_, grain_;  // grain_: g of constants.hpp
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
