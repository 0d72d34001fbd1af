// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The default rule, for a cloud of points. The hand moves the HIP (haptic interface point), which
// is where the tool is, and the proxy follows it as far as the cloud lets it. The force on the hand
// is that of a spring from the HIP to the proxy. The numbers in brackets, as (R3), are the
// equations of docs/robust.md.
//
//     x, h   proxy and HIP [m]; u = h - x leads from the proxy to the HIP
//     R      distance from a point at which the proxy rests on it: contact radius + point radius
//     b      the band [m]: the proxy may sink to R - b from a point, never further
//     g      sqrt(b / R): about the slope that points have against each other on a flat sheet whose
//            dimples, between the points, are as deep as the band
//     D      3 in space; 2 where the fixture ignores an axis, along which all is projected
//     lift   of a plane: how far the proxy has to go along the plane's normal to stand R above the
//            nearest point of its surface [m]; below 0 where it stands higher and may sink (R2)
//
// A tick first tries the straight path to the HIP. Where something is in the way, it iterates. Each
// iteration has four parts:
//
//     touch    finds the surfaces within R + 2 b of the proxy, and a plane for each (R1, R2)
//     step     chooses the step nearest to u that goes along each plane by its lift (R3, R4)
//     sweep    goes along the step until it meets the sphere around a point (R5)
//     accept   keeps the new place if it is nearer to the HIP. A lift from one surface may take the
//              proxy away from the HIP, by the band at most (R6)
//
// A tick ends at the HIP, at rest where no step is left, or out of iterations or work. GuardedRule
// (rules/rule.hpp) begins it with a proxy that is outside, and undoes it where it would end inside.
// StallTest, in the same file, gives the goal of each tick. That is the HIP itself, unless the
// proxy is *stalled*: the HIP rests, and lifts and slides would move the proxy to and fro for ever.
// Then the goal is the anchor, a place within b of the HIP that stays where it is, and each
// iteration has to bring the proxy nearer to it (R7).
#pragma once

#include "vfplan/cloud/density.hpp"
#include "vfplan/rules/contacts.hpp"
#include "vfplan/rules/rule.hpp"

namespace vfplan::inline v1 {

/// How the rule moves a proxy that is outside: the four parts of an iteration stand in `iterate`.
///
/// `Thinned` is the cloud without points that can never be felt. Leaving them out lets the proxy
/// sink a little deeper, and `lent` is how much of the band that takes [m] (cloud/density.hpp).
/// `Neighbours` keeps a list of the points around the proxy (cloud/grid.hpp), and `Kernels` has the
/// loops over points (cloud/points.hpp). `PlannedPath` records the corners of the way when a way
/// out of a start inside has just ended, and records nothing otherwise (rules/start_inside.hpp).
template <int D>
class RobustMotion {
  public:
    static constexpr int dimension = D;
    /// A proxy that a tick left at rest may move on in the next tick although the HIP has not
    /// moved, until it is stalled. So a tick with an unmoved HIP is computed again.
    static constexpr bool rest_is_final = false;
    /// A path longer than R is looked at in parts of length R. All long paths of a tick together
    /// have this many parts.
    static constexpr int max_parts = 128;

    RobustMotion(const Thinned<D>& thinned, const Parameters& p)
        : p_(p),
          R_(p.R()),
          safe2_((R_ - p.band + thinned.lent) * (R_ - p.band + thinned.lent)),
          g_(std::sqrt(p.band / R_)),
          surfaces_(R_, p.band),
          // The three lengths are how far the list of points reaches, how far the proxy may go
          // before it is gathered anew, and the side of a cell of the grid [m].
          neighbours_(thinned.cloud, list_reach(), 0.75 * tuned::list_margin * R_,
                      2 * tuned::list_margin * R_, p.search) {
        const double inner = R_ - (p.band - thinned.lent) * (1 - tuned::gain_margin);
        const double steep =
            std::min(tuned::same_surface_angle * g_, tuned::max_same_surface_angle / 2) * R_;
        sliding_ = {{}, {}, R_ * R_, inner * inner, steep * steep};
        free_ = {{}, {}, R_ * R_, inner * inner, 0};
    }

    Neighbours<D>& neighbours() noexcept { return neighbours_; }
    void set_skin(const mesh::Mesh* skin) noexcept { body_ = mesh::BodySearch(skin); }
    /// GuardedRule asks every motion for the next three. This one has nothing to do when the proxy
    /// is put elsewhere: what it keeps, it keeps with the place it was found for.
    void begin_tick() noexcept { budget().begin(work::way_out); }
    void release() noexcept {}
    void reset() noexcept { forget(); }
    /// A point came or went near the proxy: what is known of its surroundings is found anew.
    void forget() noexcept {
        neighbours_.forget();
        surfaces_.forget();
    }
    /// Of the last motion.
    int iterations() const noexcept { return iterations_; }
    bool is_spent() noexcept { return budget().is_spent(); }

    /// Whether no point is nearer than R - b, or than R - b + lent in a thinned cloud (R6). The
    /// distance that it measures is kept for `contact`.
    bool is_outside(const Vec<D>& proxy, bool = false) noexcept {
        nearest2_ = nearest2(neighbours_, proxy, surfaces_.touch_radius());
        return nearest2_ >= safe2_;
    }

    /// Moves the proxy towards the HIP: straight, or by iterations until it has arrived, rests, or
    /// the tick has none left.
    MotionEnd move(Vec<D>& proxy, const Vec<D>& hip, StallTest<D>& stall,
                   PlannedPath<D>& path) noexcept {
        const double distance = norm(hip - proxy);
        // |proxy - HIP| never grows by more than the band in a tick, less a margin for roundings. A
        // longer lift is refused, and tried again in the next tick.
        distance_limit_ = distance + p_.band * (1 - tuned::gain_margin);
        is_sweep_cut_short_ = false;
        iterations_ = 0;
        parts_left_ = max_parts;
        budget().begin(work::motion);
        if (try_straight_path(proxy, hip, distance, path)) {
            stall.release();
            return MotionEnd::rests;
        }

        // A tick that records its path plans the whole way at once. With a HIP that does not move
        // it counts as the 32 ticks that stall the proxy, so that the way comes to an end.
        const int ticks = path.is_recording() ? tuned::ticks_to_stall : 1;
        const Vec<D>& goal = stall.goal(hip, distance, ticks);
        is_lift_due_ = false;
        while (iterations_ < p_.max_iterations && !is_sweep_cut_short_) {
            if (iterations_ > 0 && budget().is_spent()) break;
            budget().spend(work::iteration);
            const bool rests = !iterate(proxy, goal, stall, path);
            // The iteration that fills the recorded path is not counted.
            if (!path.is_full()) ++iterations_;
            if (rests && !is_sweep_cut_short_) return MotionEnd::rests;
            if (path.is_full()) break;
        }
        return MotionEnd::limit;
    }

    /// Which state the proxy is in, and the direction in which the surfaces push it. GuardedRule
    /// has asked `is_outside` for the same place just before.
    RuleAnswer<D> contact(const Vec<D>& proxy, const Vec<D>& hip) noexcept {
        RuleAnswer<D> answer;
        const double contact_distance = R_ + p_.band;
        // Up to this distance of a point the state is `free_motion`, beyond it `no_neighbour`.
        const double neighbourhood = p_.outer_radius + p_.point_radius;
        const bool is_known_to_touch = surfaces_.is_known_at(proxy) && surfaces_.count() > 0;
        if (nearest2_ <= contact_distance * contact_distance || is_known_to_touch) {
            answer.state = State::in_contact;
            surfaces_.update(neighbours_, proxy);
            charge_plane_choices(surfaces_.count());
            answer.normal = surfaces_.normal(hip - proxy, min_step(), plane_slack());
        } else if (nearest2_ < neighbourhood * neighbourhood ||
                   nearest2(neighbours_, proxy, neighbourhood) < neighbourhood * neighbourhood) {
            answer.state = State::free_motion;
        }
        return answer;
    }

    // What WayOut asks: a start may be inside of the balls of radius R around the points, and of
    // the body of whose skin they are samples, if it is known.

    /// From the nearest point within R to x; 0 where there is none but at x itself.
    Vec<D> from_nearest(const Vec<D>& x) noexcept {
        double best2 = infinity;
        Vec<D> best;
        const double reach = R_ * (1 + tuned::reach_margin);
        neighbours_.index().visit(x, reach, [&](const PointSpan<D>& span) noexcept {
            if (!(kernels<D>.nearest2(span, x) < best2)) return;
            for (std::size_t i = 0; i < span.n; ++i) {
                const Vec<D> away = x - span[i];
                const double d2 = dot(away, away);
                if (d2 < best2 && d2 > 0) {
                    best2 = d2;
                    best = away;
                }
            }
        });
        return best;
    }
    /// Distance from y along the unit vector `direction` out of all balls that y is in; -infinity
    /// where it is in none, and 0 where this tick may look no further. (W1)
    double exit_distance(const Vec<D>& y, const Vec<D>& direction) noexcept {
        if (budget().is_spent()) return 0;
        const double inside2 = R_ * R_ * (1 - tuned::inside_margin);
        double distance = -infinity;
        neighbours_.index().visit(y, R_, [&](const PointSpan<D>& span) noexcept {
            distance =
                std::max(distance, kernels<D>.last_root_eq7(span, y, direction, inside2, R_ * R_));
        });
        return distance;
    }
    /// Whether y lies in the body; nothing where this tick may look no further. No point is nearer
    /// to y than `clear`, but the skin between the points may be.
    std::optional<bool> is_in_body(const Vec<D>& y, double clear) noexcept {
        if constexpr (D == 3) return body_.is_inside(y, clear / 64, budget(), work::triangle);
        return false;
    }

  private:
    /// Where nothing lies on the straight path, the proxy goes with the HIP, whatever it touches.
    /// True where it has arrived. Where the HIP lies behind a point at R or less, no path is tried.
    bool try_straight_path(Vec<D>& proxy, const Vec<D>& hip, double distance,
                           PlannedPath<D>& path) noexcept {
        if (!(distance > 0)) return true;
        const Vec<D> to_hip = hip - proxy;
        surfaces_.update(neighbours_, proxy);
        for (int j = 0; j < surfaces_.count(); ++j) {
            const SurfaceContact<D>& surface = surfaces_.contact(j);
            const bool is_behind = dot(surface.nearest_direction, to_hip) < 0;
            if (surface.nearest_distance <= R_ && is_behind) return false;
        }
        if (move_straight(proxy, hip, distance, path)) return true;
        return distance <= plane_slack();  // as near as rounding allows
    }

    /// Moves straight to the goal where nothing is in the way; true then. Where something is, a
    /// proxy that nothing touches moves up to it, and any proxy where the tick has no work left.
    /// One that a surface touches stays where it is, for its iterations slide it along the surface.
    bool move_straight(Vec<D>& proxy, const Vec<D>& goal, double distance,
                       PlannedPath<D>& path) noexcept {
        const Vec<D> to_goal = goal - proxy;
        const double free = sweep(proxy, (1 / distance) * to_goal, distance, free_);
        if (free >= distance) {
            move_to(proxy, goal, path);
            return true;
        }
        if (surfaces_.count() == 0 || budget().is_spent())
            move_to(proxy, proxy + (free / distance) * to_goal, path);
        return false;
    }

    /// One iteration. `goal` is the HIP, or the anchor of the stall test once the proxy is stalled.
    /// False at the goal, or where nothing leads nearer to it.
    bool iterate(Vec<D>& proxy, const Vec<D>& goal, StallTest<D>& stall,
                 PlannedPath<D>& path) noexcept {
        const Vec<D> to_goal = goal - proxy;
        const double distance = norm(to_goal);
        if (!(distance > 0)) return false;

        // Touch: the points within R + 2 b are sorted into surfaces, and a quadric fitted to each
        // surface gives its plane. What is known at this place already is not computed again. (R1,
        // R2)
        surfaces_.update(neighbours_, proxy);
        const int surfaces = surfaces_.count();
        if (surfaces == 0) return !move_straight(proxy, goal, distance, path);

        // How far from the goal a lift may take the proxy, and how near to the goal the iteration
        // has to end. A stalled proxy has to come nearer, and so has one between several surfaces,
        // for their fitted planes would let it wander. Any other stays within `distance_limit_`,
        // which was measured from the HIP and holds here because the goal of a proxy that is not
        // stalled is the HIP. A lift keeps a margin to what is accepted, so that no rounding
        // makes it too long. (R6)
        const double lift_limit = stall.is_stalled() ? distance - gain_margin() : distance_limit_;
        const double accept_limit = surfaces > 1 ? distance : lift_limit + gain_margin();

        // Step: the one nearest to the goal that goes along each normal by the plane's lift. On one
        // surface a slide takes the lift along. After a slide that was stopped, as in a hollow, one
        // iteration only lifts, and the one after that slides again: so a lift that is stopped too
        // is not repeated. (R3, R4)
        const bool is_lift_due = is_lift_due_;
        is_lift_due_ = false;
        bool has_lift = false;    // there is one surface, and its plane asks for a lift
        bool lifts_only = false;  // this iteration does not slide
        Vec<D> step;
        if (surfaces > 1) {
            charge_plane_choices(surfaces);
            step = surfaces_.step(to_goal, plane_slack());
        } else {
            ContactPlane<D> plane = surfaces_.planes()[0];
            // A lift may take the proxy no further than `lift_limit` from the goal: along the
            // normal n, a lift l takes it at least l - n . u away, where u is `to_goal`.
            plane.lift = std::min(plane.lift, lift_limit + dot(plane.normal, to_goal));
            has_lift = plane.lift > min_step();
            lifts_only = is_lift_due && has_lift;
            step = lifts_only ? plane.lift * plane.normal
                              : surfaces_.slide(to_goal, plane, plane_slack());
        }
        const double length = norm(step);
        if (!(length > min_step())) {
            // One plane leaves no step where the proxy is as near to the goal as the plane lets it.
            // Several may leave none although there is a way between their points.
            if (surfaces == 1) return false;
            return move_between_points(proxy, goal, path);
        }

        // Sweep: as much of the step as lies outside of the sphere of every point. (R5)
        const double free = sweep(proxy, (1 / length) * step, length, sliding_);
        const bool is_stopped = free < length;
        const bool is_stopped_at_once = free < min_step();
        // Where no plane has changed the step, the proxy arrives to the bit.
        Vec<D> next = step == to_goal ? goal : proxy + step;
        if (is_stopped) next = proxy + (free / length) * step;
        if (is_stopped_at_once && surfaces > 1 && lift_then_move(proxy, goal, step, path))
            return true;

        // Accept: the place is near enough to the goal, and the sweep was not stopped at once. A
        // slide that was stopped at once is accepted too if the plane asks for a lift, because the
        // next iteration then lifts the proxy over what has stopped it. Where nothing is accepted,
        // the proxy is moved past the points that touch it instead. (R6)
        const bool is_lifted_next = is_stopped && has_lift && !lifts_only;
        const double distance_after = norm(goal - next);
        if (!(distance_after < accept_limit) || (is_stopped_at_once && !is_lifted_next))
            return move_between_points(proxy, goal, path);
        move_to(proxy, next, path);
        stall.count_lift(distance_after - distance);
        is_lift_due_ = is_lifted_next;
        return !(proxy == goal);
    }

    /// Between several surfaces, where the proxy has sunk below R among points and these stop its
    /// step at once: first the shortest way up to R above all planes, then what is left of the
    /// step. False, and nothing done, unless the two together bring the proxy nearer to the goal. A
    /// proxy that is led askew through a coarsely sampled channel needs it
    /// (test_channels_are_followed_wherever_their_samples_lie).
    bool lift_then_move(Vec<D>& proxy, const Vec<D>& goal, const Vec<D>& step,
                        PlannedPath<D>& path) noexcept {
        charge_plane_choices(surfaces_.count());
        const Vec<D> up =
            nearest_step(Vec<D>{}, surfaces_.planes(), surfaces_.count(), plane_slack());
        const Vec<D> remainder = step - up;
        if (!(norm(up) > min_step() && norm(remainder) > min_step())) return false;
        const Vec<D> top = swept(proxy, up);
        const Vec<D> next = swept(top, remainder);
        if (!(norm(goal - next) < norm(goal - proxy))) return false;
        move_to(proxy, top, path);
        move_to(proxy, next, path);
        return true;
    }

    /// Moves past the points that touch, where the planes leave no way: by the step of the
    /// god-object method, which runs into none of these points and never leads away from the goal.
    /// Without it a proxy would rest where there is still a way on between the points
    /// (test_where_it_rests_there_is_no_way_on). (R4)
    bool move_between_points(Vec<D>& proxy, const Vec<D>& goal, PlannedPath<D>& path) noexcept {
        const Vec<D> to_goal = goal - proxy;
        const Vec<D> step = god_object_step(proxy, to_goal);
        // Where the step is shorter than g |u|, the HIP pulls straight into the surface but for the
        // slopes between its points. The proxy would wander among these.
        if (!(norm(step) > std::max(min_step(), g_ * norm(to_goal)))) return false;
        const Vec<D> next = swept(proxy, step);
        // Between several surfaces a gain of two bands may be no more than sinking between their
        // points.
        const double least_gain = surfaces_.count() > 1 ? tuned::max_lift_bands * p_.band : 0;
        const bool moves = norm(next - proxy) > min_step();
        if (!(moves && norm(goal - next) < norm(to_goal) - least_gain)) return false;
        move_to(proxy, next, path);
        return true;
    }
    /// The step v nearest to `to_goal` with (x - p) . v >= 0 for every point p at R from x, or
    /// nearer (R4). The point that v runs into most steeply becomes a plane that v has to keep to,
    /// and v is chosen anew, until v runs into no point or there are as many planes as there may
    /// be. Each plane asks for a lift of one slack, which v may miss by half: so v leads a little
    /// out of the points, and a rounding does not stop it at once.
    Vec<D> god_object_step(const Vec<D>& x, const Vec<D>& to_goal) noexcept {
        constexpr int max_points = 8;
        ContactPlane<D> planes[max_points];
        const double slack = plane_slack();
        Vec<D> step = to_goal;
        for (int count = 0; count < max_points; ++count) {
            double steepest = 0;  // cosine between v and the way out of the point, 0 or less
            const auto include = [&](const Vec<D>& away) noexcept {
                const double r = norm(away);
                const double approach = dot(away, step);
                if (!(r > 0 && approach < steepest * r)) return;
                steepest = approach / r;
                planes[count] = {(1 / r) * away, slack};
            };
            visit_within(neighbours_, x, R_ + min_step(), include);
            if (steepest == 0 || budget().is_spent()) break;
            charge_plane_choices(count + 1);
            step = nearest_step(to_goal, planes, count + 1, 0.5 * slack);
            if (!(norm(step) > slack)) break;
        }
        return step;
    }

    WorkBudget& budget() noexcept { return neighbours_.index().budget(); }
    /// Counts what a search for the step that keeps to so many planes costs.
    void charge_plane_choices(int planes) noexcept {
        budget().spend(work::choice * static_cast<std::size_t>(plane_choices<D>(planes)));
    }
    /// How much of the path of this length from x along the unit vector `direction` is free [m]. It
    /// is exact whatever the length, so that no HIP is fast enough to pass a wall. (R5)
    double sweep(const Vec<D>& x, const Vec<D>& direction, double length, Ray<D> ray) noexcept {
        ray.from = x;
        ray.direction = direction;
        if (length <= R_) return std::min(length, first_hit(ray, length));
        // Only what lies within R of the cloud's box can meet anything: from `from` to `to`.
        double from, to;
        if (!neighbours_.index().box().clip(x, direction, length, R_, from, to)) return length;
        // At least one part, that a long path through a crowd comes to an end.
        for (bool goes_on = true; goes_on && parts_left_ > 0;) {
            const double part = std::min(R_, to - from);
            if (part <= 0) return length;
            ray.from = x + from * direction;
            const double hit = first_hit(ray, part);
            if (hit < part) return std::min(length, from + hit);
            from += R_;
            --parts_left_;
            goes_on = !budget().is_spent();
        }
        is_sweep_cut_short_ = true;
        return std::min(length, from);
    }
    /// How far the ray gets before it meets a sphere; infinity where it meets none within `length`.
    /// A short path looks through the list of points around the proxy, which is at hand. A long one
    /// looks up the points around its middle.
    double first_hit(const Ray<D>& ray, double length) noexcept {
        double hit = infinity;
        const auto include = [&](const PointSpan<D>& points) noexcept {
            hit = std::min(hit, kernels<D>.ray_hit(points, ray));
        };
        if (length <= tuned::list_margin * R_) {
            neighbours_.visit(ray.from, R_ + length, include);
        } else {
            const Vec<D> middle = ray.from + 0.5 * length * ray.direction;
            neighbours_.index().visit(middle, R_ + 0.5 * length, include);
        }
        // The path ends a little before the sphere, so that the sphere is met again in the next
        // sweep and not, by a rounding, entered.
        return std::max(0.0, hit - tuned::stop_before * R_);
    }
    /// Where x comes to by the step, or by as much of it as is free.
    Vec<D> swept(const Vec<D>& x, const Vec<D>& step) noexcept {
        const double length = norm(step);
        const double free = sweep(x, (1 / length) * step, length, sliding_);
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
    // Three lengths [m], of which rules/constants.hpp gives the reasons: a step shorter than the
    // first is none, a gain has to exceed the second, and a step may miss a plane by the third.
    double min_step() const noexcept { return tuned::min_step * p_.band; }
    double gain_margin() const noexcept { return tuned::gain_margin * p_.band; }
    double plane_slack() const noexcept { return tuned::plane_slack * p_.band; }

    Parameters p_;
    double R_;
    double safe2_;  // (R - b + lent)^2, the squared distance from every point that is outside [m^2]
    double g_;      // sqrt(b / R)
    // The spheres around points that stop a proxy. One that slides is stopped by what it meets
    // steeply, and grazes the rest: down to R - b, and above it a margin and what thinning the
    // cloud has used of the band. One that is free is stopped at R by everything. (R5)
    Ray<D> sliding_, free_;
    ContactSurfaces<D> surfaces_;
    Neighbours<D> neighbours_;
    mesh::BodySearch body_;
    double distance_limit_ = 0;  // |proxy - HIP| with which this tick may end at most [m]
    double nearest2_ = 0;        // of the place that is_outside was asked for last [m^2]
    int iterations_ = 0;         // of this tick
    int parts_left_ = 0;         // of long paths, in this tick
    bool is_lift_due_ = false;   // the next iteration only lifts, if its plane asks for a lift
    bool is_sweep_cut_short_ = false;  // this tick has looked at as much of paths as it may
};

/// The rule `robust`: its motion, and around it the guarantees of GuardedRule.
template <int D>
using RobustRule = GuardedRule<RobustMotion<D>>;

}  // namespace vfplan::inline v1
