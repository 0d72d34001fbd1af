// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The default rule. The proxy never enters a sphere of radius R - band around a point, slides on
// the surfaces that the points sample, is held by every wall of a corner, and lets go. The numbers
// in brackets are the equations of docs/robust.md.
//
// A tick first tries the straight path to the HIP. Where something is in the way, it iterates. Each
// iteration finds the surfaces that TOUCH the proxy, chooses the STEP towards the HIP that keeps to
// all of them, SWEEPS along it until the sphere of a point is met, and ACCEPTS what brings the
// proxy nearer, or on one surface a bounded lift. GuardedRule (rules/rule.hpp) then checks where
// the proxy has come to.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "vfplan/base/vec.hpp"
#include "vfplan/cloud/density.hpp"
#include "vfplan/cloud/grid.hpp"
#include "vfplan/parameters.hpp"
#include "vfplan/rules/constants.hpp"
#include "vfplan/rules/contacts.hpp"
#include "vfplan/rules/half_spaces.hpp"
#include "vfplan/rules/rule.hpp"

namespace vfplan {

/// What stops a sweep: spheres of radius `outer` that are met steeply, and spheres of radius
/// `inner` that are grazed. (R5)
struct SweepRadii {
    double outer, inner;  ///< [m]
    double steep;  ///< sine of the angle between path and sphere above which a meeting is steep
};

struct SweepResult {
    double length;                 ///< of the free part of the path [m]
    bool is_out_of_parts = false;  ///< the path is longer than a tick may look at
};

/// How far the proxy gets along a straight path before it meets the sphere of a point. It is exact
/// whatever the length, so that no HIP is fast enough to pass a wall. (R5)
template <int D>
class Sweep {
  public:
    /// A long path is looked at in parts of length R; this many of all paths of a tick.
    static constexpr int max_parts = 128;

    Sweep(const Kernels<D>& kernels, double radius) noexcept : kernels_(kernels), R_(radius) {}

    void begin_tick() noexcept { parts_left_ = max_parts; }

    /// How much of the path of this length from x along the unit vector `direction` is free.
    SweepResult operator()(Neighbours<D>& neighbours, const Vec<D>& x, const Vec<D>& direction,
                           double length, const SweepRadii& radii) noexcept {
        const double steep = radii.steep * radii.outer;
        Ray<D> ray{x, direction, radii.outer * radii.outer, radii.inner * radii.inner,
                   steep * steep};
        if (length <= R_) return {std::min(length, first_hit(neighbours, ray, length))};
        double from, to;
        if (!neighbours.index().box().clip(x, direction, length, R_, from, to)) return {length};
        while (parts_left_ > 0) {
            const double part = std::min(R_, to - from);
            if (part <= 0) return {length};
            ray.from = x + from * direction;
            const double hit = first_hit(neighbours, ray, part);
            if (hit < part) return {std::min(length, from + hit)};
            from += R_;
            --parts_left_;
        }
        return {std::min(length, from), true};
    }

  private:
    /// The list around the proxy serves a short path; the points beside a long one are looked up
    /// around its middle.
    double first_hit(Neighbours<D>& neighbours, const Ray<D>& ray, double length) const noexcept {
        double hit = std::numeric_limits<double>::infinity();
        const auto include = [&](const PointSpan<D>& points) noexcept {
            hit = std::min(hit, kernels_.ray_hit(points, ray));
        };
        if (length <= tuned::list_margin * R_) {
            neighbours.visit(ray.from, R_ + length, include);
        } else {
            const Vec<D> middle = ray.from + 0.5 * length * ray.direction;
            neighbours.index().visit(middle, R_ + 0.5 * length, include);
        }
        // The path ends a little before the sphere, so that the sphere is met again in the next
        // sweep and not, by a rounding, entered.
        return std::max(0.0, hit - tuned::stop_before * R_);
    }

    Kernels<D> kernels_;
    double R_;
    int parts_left_ = max_parts;
};

/// How the rule moves a proxy that is outside.
template <int D>
class RobustMotion {
  public:
    static constexpr int dimension = D;
    /// A proxy at rest may move on under a HIP that stays where it is, until it is stalled, so a
    /// tick with an unmoved HIP is computed again.
    static constexpr bool rest_is_final = false;

    RobustMotion(const Thinned<D>& thinned, const Parameters& p, const Kernels<D>& kernels)
        : p_(p),
          kernels_(kernels),
          R_(p.R()),
          safe2_((R_ - p.band + thinned.lent) * (R_ - p.band + thinned.lent)),
          g_(std::sqrt(p.band / R_)),
          sliding_radii_{
              R_, inner_radius(thinned, p),
              std::min(tuned::same_surface_angle * g_, tuned::max_same_surface_angle / 2)},
          free_radii_{R_, inner_radius(thinned, p), 0},
          surfaces_(kernels, R_, p.band),
          neighbours_(thinned.cloud, list_reach(), 0.75 * tuned::list_margin * R_,
                      2 * tuned::list_margin * R_, p.search, kernels),
          sweep_(kernels, R_) {}

    Neighbours<D>& neighbours() noexcept { return neighbours_; }
    InsideCloud<D> inside() const noexcept { return {neighbours_.index(), kernels_, R_}; }
    void begin_tick() noexcept {}
    void release() noexcept {}
    void reset() noexcept { forget(); }
    /// What is known of the surroundings may be wrong by now.
    void forget() noexcept {
        neighbours_.forget();
        surfaces_.forget();
    }
    int iterations() const noexcept { return iterations_; }

    /// Asked before a motion, as `is_outside` is after one. Among points both are one test.
    bool is_clear(const Vec<D>& proxy) noexcept { return is_outside(proxy); }
    /// Whether no point is nearer than R - b, or than R - b + lent in a thinned cloud. (R6) Keeps
    /// the distance that it measures for `contact`.
    bool is_outside(const Vec<D>& proxy) noexcept {
        nearest2_ = nearest2(proxy, surfaces_.touch_radius());
        return nearest2_ >= safe2_;
    }

    /// Towards the HIP: straight, or by iterations until the proxy has arrived, rests, or has none
    /// left.
    MotionEnd move(Vec<D>& proxy, const Vec<D>& hip, StallTest<D>& stall,
                   PlannedPath<D>& path) noexcept {
        const double distance = norm(hip - proxy);
        // |proxy - HIP| never grows by more than the band in a tick: a longer lift is refused and
        // tried again in the next tick.
        distance_limit_ = distance + p_.band * (1 - tuned::gain_margin);
        is_path_too_long_ = false;
        iterations_ = 0;
        sweep_.begin_tick();
        if (try_straight_path(proxy, hip, distance, path)) {
            stall.release();
            return MotionEnd::rests;
        }

        // A path that is planned whole in one tick counts as 32 ticks of rest. PlannedPath stands
        // in rules/start_inside.hpp.
        const int ticks = path.is_recording() ? tuned::ticks_to_stall : 1;
        const Vec<D>& goal = stall.goal(hip, distance, ticks);
        lift_first_ = false;
        for (; iterations_ < p_.max_iterations && !is_path_too_long_; ++iterations_) {
            const Iteration done = iterate(proxy, goal, stall, path);
            if (done == Iteration::rests && !is_path_too_long_) {
                // The iteration that fills the path is counted neither here nor at the break below.
                if (!path.is_full()) ++iterations_;
                return MotionEnd::rests;
            }
            if (path.is_full()) break;
        }
        return MotionEnd::limit;
    }

    /// Which state the proxy is in, and where the surfaces push it.
    RuleAnswer<D> contact(const Vec<D>& proxy, const Vec<D>& hip) noexcept {
        RuleAnswer<D> answer;
        const double contact = R_ + p_.band;
        const double neighbourhood = p_.outer_radius + p_.point_radius;
        const bool is_known_to_touch = surfaces_.is_known_at(proxy) && surfaces_.count() > 0;
        if (nearest2_ <= contact * contact || is_known_to_touch) {
            answer.state = State::in_contact;
            surfaces_.update(neighbours_, proxy);
            charge_plane_choices(surfaces_.count());
            answer.normal = surfaces_.normal(hip - proxy, min_step(), plane_slack());
        } else if (nearest2_ < neighbourhood * neighbourhood ||
                   nearest2(proxy, neighbourhood) < neighbourhood * neighbourhood) {
            answer.state = State::free_motion;
        }
        return answer;
    }

  private:
    enum class Iteration { moved, rests };

    /// Where nothing lies on the straight path, the proxy goes with the HIP, whatever it touches.
    bool try_straight_path(Vec<D>& proxy, const Vec<D>& hip, double distance,
                           PlannedPath<D>& path) noexcept {
        if (!(distance > 0)) return true;
        const Vec<D> to_hip = hip - proxy;
        surfaces_.update(neighbours_, proxy);
        for (int j = 0; j < surfaces_.count(); ++j) {
            const SurfaceContact<D>& contact = surfaces_.contact(j);
            if (contact.distance <= R_ && dot(contact.nearest, to_hip) < 0) return false;
        }
        if (move_straight(proxy, hip, distance, path)) return true;
        return distance <= plane_slack();  // as near as rounding allows
    }

    /// Straight to the goal where nothing is in the way; true then. Where something is, a proxy
    /// that nothing touches moves up to it, and one that a surface touches stays.
    bool move_straight(Vec<D>& proxy, const Vec<D>& goal, double distance,
                       PlannedPath<D>& path) noexcept {
        const Vec<D> to_goal = goal - proxy;
        const double free = sweep(proxy, (1 / distance) * to_goal, distance, free_radii_);
        if (free >= distance) {
            move_to(proxy, goal, path);
            return true;
        }
        if (surfaces_.count() == 0) move_to(proxy, proxy + (free / distance) * to_goal, path);
        return false;
    }

    /// The plane of the one surface that touches, with the lift that this iteration may take.
    ///
    /// A slide takes its lift along. Where its sweep is stopped, as in a hollow, the next iteration
    /// lifts only. The one after that slides again, so that a lift that is stopped is not repeated.
    struct OneSurface {
        ContactPlane<D> plane;
        bool lift_now = false;   ///< this iteration lifts only
        bool lift_next = false;  ///< the next one does, should this sweep be stopped
    };
    /// `lift_limit`: the lift may not take the proxy further from the goal than this [m].
    OneSurface one_surface(const Vec<D>& to_goal, double lift_limit,
                           bool is_lift_due) const noexcept {
        OneSurface one;
        one.plane = surfaces_.planes()[0];
        one.plane.lift = std::min(one.plane.lift, lift_limit + dot(one.plane.normal, to_goal));
        const bool has_lift = one.plane.lift > min_step();
        one.lift_now = is_lift_due && has_lift;
        one.lift_next = has_lift && !one.lift_now;
        return one;
    }

    Iteration iterate(Vec<D>& proxy, const Vec<D>& goal, StallTest<D>& stall,
                      PlannedPath<D>& path) noexcept {
        const Vec<D> to_goal = goal - proxy;
        const double distance = norm(to_goal);
        if (!(distance > 0)) return Iteration::rests;

        // Touch: groups of points within R + 2 b, and for each group the plane of a quadric fitted
        // to it. (R1, R2)
        surfaces_.update(neighbours_, proxy);
        const int surfaces = surfaces_.count();
        if (surfaces == 0) {
            const bool arrived = move_straight(proxy, goal, distance, path);
            return arrived ? Iteration::rests : Iteration::moved;
        }

        // How far from the goal a lift may take the proxy, and where a sweep may end. A stalled
        // proxy has to come nearer, any other one stays within what the tick allows.
        double lift_limit = distance_limit_;
        if (stall.is_stalled()) lift_limit = distance - gain_margin();
        double accept_limit = lift_limit + gain_margin();
        if (surfaces > 1) accept_limit = distance;

        // Step: the one nearest to the goal that keeps every plane at height R. (R3, R4)
        const bool is_lift_due = lift_first_;
        lift_first_ = false;
        OneSurface one;
        Vec<D> step;
        if (surfaces > 1) {
            charge_plane_choices(surfaces);
            step = surfaces_.step(to_goal, plane_slack());
        } else {
            one = one_surface(to_goal, lift_limit, is_lift_due);
            if (one.lift_now)
                step = one.plane.lift * one.plane.normal;
            else
                step = surfaces_.slide(to_goal, one.plane, plane_slack());
        }
        const double length = norm(step);
        if (!(length > min_step())) {
            // One plane leaves no step where the proxy is nearest to the goal. Several may leave
            // none although there is a way between their points.
            if (surfaces == 1) return Iteration::rests;
            return step_between_points(proxy, goal, path);
        }

        // Sweep: as much of the step as lies outside of the sphere of every point. (R5)
        const double free = sweep(proxy, (1 / length) * step, length, sliding_radii_);
        Vec<D> next;
        if (free < length) {
            next = proxy + (free / length) * step;
        } else if (step == to_goal) {
            next = goal;  // No plane has changed the step, so the proxy arrives to the bit.
        } else {
            next = proxy + step;
        }
        const bool is_stuck = free < min_step();
        if (is_stuck && surfaces > 1 && lift_then_step(proxy, goal, step, path))
            return Iteration::moved;

        // Accept: between several surfaces only a gain, for their fitted normals would let the
        // proxy wander; on one surface a lift may take it away by the band at most. (R6)
        // What is refused, or stopped at once by points that its planes leave free, is tried past
        // these points.
        const double left = norm(goal - next);
        if (!(left < accept_limit) || (is_stuck && !one.lift_next))
            return step_between_points(proxy, goal, path);
        move_to(proxy, next, path);
        stall.count_lift(left - distance);
        lift_first_ = one.lift_next && free < length;
        return proxy == goal ? Iteration::rests : Iteration::moved;
    }

    /// Between several surfaces, where the step is stopped at once by the points that the proxy has
    /// sunk among: first up to R above all planes, then on as the step asks. False, and nothing
    /// done, unless the two together bring the proxy nearer. A proxy that is led askew through a
    /// coarsely sampled channel needs it (test_coarse_channel_is_followed_at_speed).
    bool lift_then_step(Vec<D>& proxy, const Vec<D>& goal, const Vec<D>& step,
                        PlannedPath<D>& path) noexcept {
        charge_plane_choices(surfaces_.count());
        const Vec<D> up =
            nearest_step(Vec<D>{}, surfaces_.planes(), surfaces_.count(), plane_slack());
        const Vec<D> rest = step - up;
        if (!(norm(up) > min_step() && norm(rest) > min_step())) return false;
        const Vec<D> top = swept(proxy, up);
        const Vec<D> next = swept(top, rest);
        if (!(norm(goal - next) < norm(goal - proxy))) return false;
        move_to(proxy, top, path);
        move_to(proxy, next, path);
        return true;
    }

    /// Past the points that touch, where the planes leave no way: the step of the god-object
    /// method, which runs into none of these points. It is never away from the goal. Without it a
    /// proxy would rest where there is still a way on between the points
    /// (test_where_it_rests_there_is_no_way_on). (R4)
    Iteration step_between_points(Vec<D>& proxy, const Vec<D>& goal,
                                  PlannedPath<D>& path) noexcept {
        const Vec<D> to_goal = goal - proxy;
        const Vec<D> step = step_past_points(proxy, to_goal);
        // A step as flat as the slopes between samples gains nothing: the proxy would wander on it.
        if (!(norm(step) > std::max(min_step(), g_ * norm(to_goal)))) return Iteration::rests;
        const Vec<D> next = swept(proxy, step);
        // Between several surfaces a gain of two bands may be no more than sinking through them.
        double least_gain = 0;
        if (surfaces_.count() > 1) least_gain = sinking_depth();
        const bool moves = norm(next - proxy) > min_step();
        if (!(moves && norm(goal - next) < norm(to_goal) - least_gain)) return Iteration::rests;
        move_to(proxy, next, path);
        return Iteration::moved;
    }
    /// argmin |v - to_goal| subject to (x - p) . v >= 0 for the points p that touch x, by a little
    /// more than 0, so that a rounding does not stop the step at once. The points that v runs into
    /// most steeply are taken one after the other, until there is none.
    Vec<D> step_past_points(const Vec<D>& x, const Vec<D>& to_goal) noexcept {
        constexpr int max_points = 8;
        ContactPlane<D> planes[max_points];
        const double slack = plane_slack();
        Vec<D> step = to_goal;
        for (int count = 0; count < max_points; ++count) {
            double most_negative = 0;
            const auto include = [&](const Vec<D>& away) noexcept {
                const double r = norm(away);
                const double approach = dot(away, step);
                if (!(r > 0 && approach < most_negative * r)) return;
                most_negative = approach / r;
                planes[count] = {(1 / r) * away, slack};
            };
            visit_within(neighbours_, kernels_, x, R_ + min_step(), include);
            if (most_negative == 0) break;
            charge_plane_choices(count + 1);
            step = nearest_step(to_goal, planes, count + 1, 0.5 * slack);
            if (!(norm(step) > slack)) break;
        }
        return step;
    }

    /// Adds what a search for the step that keeps to so many planes costs.
    void charge_plane_choices(int planes) noexcept {
        neighbours_.index().work().choices += static_cast<std::size_t>(plane_choices<D>(planes));
    }
    double sweep(const Vec<D>& x, const Vec<D>& direction, double length,
                 const SweepRadii& radii) noexcept {
        const SweepResult result = sweep_(neighbours_, x, direction, length, radii);
        is_path_too_long_ = is_path_too_long_ || result.is_out_of_parts;
        return result.length;
    }
    /// x after the step, or after as much of it as is free.
    Vec<D> swept(const Vec<D>& x, const Vec<D>& step) noexcept {
        const double length = norm(step);
        const double free = sweep(x, (1 / length) * step, length, sliding_radii_);
        return free < length ? x + (free / length) * step : x + step;
    }
    void move_to(Vec<D>& proxy, const Vec<D>& next, PlannedPath<D>& path) noexcept {
        proxy = next;
        path.record(proxy);
    }

    /// What is asked of the list of neighbours: the samples of a fit, and what a short sweep may
    /// meet [m].
    double list_reach() const noexcept {
        // 1 % more, for roundings.
        return std::max((1.01 + tuned::list_margin) * R_, surfaces_.reach());
    }
    double nearest2(const Vec<D>& x, double reach) noexcept {
        return vfplan::nearest2(neighbours_, kernels_, x, reach);
    }
    /// Radius of the spheres that a sweep may graze but not enter: R - b, a margin above it, and
    /// what thinning the cloud has taken of the band. [m]
    static double inner_radius(const Thinned<D>& thinned, const Parameters& p) noexcept {
        return p.R() - (p.band - thinned.lent) * (1 - tuned::gain_margin);
    }
    double min_step() const noexcept { return tuned::min_step * p_.band; }
    double gain_margin() const noexcept { return tuned::gain_margin * p_.band; }
    /// How much nearer to the goal sinking between the points of a surface brings the proxy [m].
    double sinking_depth() const noexcept { return tuned::max_lift_bands * p_.band; }
    double plane_slack() const noexcept { return tuned::plane_slack * p_.band; }

    Parameters p_;
    Kernels<D> kernels_;
    double R_;
    double safe2_;  // (R - b + lent)^2; lent: what thinning the cloud has taken of the band
    double g_;      // sqrt(b / R), the slope between samples (docs/robust.md)
    SweepRadii sliding_radii_, free_radii_;
    ContactSurfaces<D> surfaces_;
    Neighbours<D> neighbours_;
    Sweep<D> sweep_;
    double distance_limit_ = 0;      // |proxy - HIP| that this tick may end with [m]
    double nearest2_ = 0;            // to the nearest point, where the proxy was checked last [m^2]
    int iterations_ = 0;             // of this tick
    bool lift_first_ = false;        // the next iteration lifts only, if it has a lift
    bool is_path_too_long_ = false;  // the path of this tick is longer than a tick may look at
};

template <int D>
class RobustRule : public GuardedRule<RobustMotion<D>, StallTest<D>> {
    using Guarded = GuardedRule<RobustMotion<D>, StallTest<D>>;

  public:
    RobustRule(const Thinned<D>& thinned, const Parameters& p, const Kernels<D>& kernels)
        : Guarded(p.R(), p.band, thinned, p, kernels) {}

    Neighbours<D>& neighbours() noexcept { return this->motion().neighbours(); }
    /// Time that the work of all ticks so far takes [s], on the machine of docs/engine.md.
    double work_time() noexcept {
        WorkCosts costs;
        if (D == 2) {
            costs.row = 20e-9;
            costs.span = 40e-9;
            costs.point = 0.5e-9;
            costs.contact = 13e-9;
            costs.fit = 70e-9;
            costs.choice = 60e-9;
        } else {
            costs.row = 30e-9;
            costs.span = 20e-9;
            costs.point = 1e-9;
            costs.contact = 50e-9;
            costs.fit = 150e-9;
            costs.choice = 35e-9;
        }
        return costs.time_of(neighbours().index().work());
    }
    /// A point at p came or went.
    void point_changed(const Vec<D>& p, bool came) noexcept {
        this->drop_plan();
        if (!neighbours().reaches(p)) return;
        this->motion().forget();
        this->surroundings_changed(came);
    }
};

}  // namespace vfplan
