// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What a rule is, and the guarantees that the rules `robust` and `exact` give, once for all of
// them. What differs between these rules is a motion; what is promised stands around it here. The
// numbers in brackets are the equations of docs/robust.md, and docs/rules.md lists the guarantees.
#pragma once

#include "vfplan/rules/start_inside.hpp"

namespace vfplan::inline v1 {

/// How a motion ended.
enum class MotionEnd {
    rests,       ///< at the HIP, or where nothing leads nearer to it
    settled,     ///< the same, and already checked against the geometry
    force_ball,  ///< at the edge of the ball that holds the proxy while the rule takes over
    limit        ///< out of iterations; the motion goes on in the next tick
};

/// Tells when the HIP rests, so that the proxy has to come to rest as well. (R7)
///
/// On one surface a lift may take the proxy away from the HIP, and the slide that follows may bring
/// it back to where it was, for ever. So the lifts are summed up while the HIP stays within a band
/// of an anchor. Above two bands, or after 32 ticks in which the HIP has not moved by a thousandth
/// of a band, the proxy is stalled: it then only moves nearer to the anchor. A HIP that trembles
/// around the anchor gives no new reason to move. Without it
/// test_a_trembling_hip_does_not_keep_it_moving fails.
template <int D>
class StallTest {
  public:
    explicit StallTest(double band) noexcept : band_(band) {}

    /// Nothing holds the proxy.
    void release() noexcept {
        has_anchor_ = false;
        is_stalled_ = false;
    }

    /// A tick begins with the proxy held, `distance` from the HIP. Returns what the motion is to
    /// move it to, which lies within a band of the HIP.
    /// @param ticks  how many ticks this one counts as while the HIP does not move
    const Vec<D>& goal(const Vec<D>& hip, double distance, int ticks) noexcept {
        if (!has_anchor_ || !is_within(hip, anchor_, 1)) {
            set_anchor(hip, distance);
        } else if (!is_within(hip, rest_position_, tuned::gain_margin)) {
            rest_position_ = hip;
            ticks_at_rest_ = 0;
        } else if (ticks_at_rest_ < tuned::ticks_to_stall) {
            ticks_at_rest_ = std::min(ticks_at_rest_ + ticks, tuned::ticks_to_stall);
            if (ticks_at_rest_ == tuned::ticks_to_stall) anchor_ = hip;
        }
        const bool hip_rests = ticks_at_rest_ == tuned::ticks_to_stall;
        const bool lifted_too_much = lift_sum_ > tuned::max_lift_bands * band_;
        is_stalled_ = hip_rests || lifted_too_much;
        return is_stalled_ ? anchor_ : hip;
    }

    /// Whether each iteration of this tick has to bring the proxy nearer to its goal.
    bool is_stalled() const noexcept { return is_stalled_; }

    /// An iteration has changed |proxy - goal| by `growth` [m].
    void count_lift(double growth) noexcept {
        if (growth > tuned::min_step * band_) lift_sum_ += growth;
    }

    /// The iterations of a tick went to x. Where there were none left, that counts as much as a
    /// lift of a band.
    void end_of_iterations(const Vec<D>& x, bool came_to_end) noexcept {
        if (!came_to_end) lift_sum_ += band_;
        if (!(lift_sum_ > 0)) return;
        const double distance = norm(anchor_ - x);
        if (distance < least_distance_ - band_) {  // the proxy gets somewhere
            least_distance_ = distance;
            lift_sum_ = 0;
        }
    }

    /// Whether the tick from `start` to x is to be undone: its iterations brought a stalled proxy
    /// hardly nearer to its goal, or it is further from the HIP than any tick may take it.
    bool must_undo(const Vec<D>& start, const Vec<D>& x, const Vec<D>& hip,
                   int iterations) const noexcept {
        if (!is_stalled_) return false;
        const double gain = norm(anchor_ - start) - norm(anchor_ - x);
        const bool gains = gain > iterations * tuned::min_step * band_;
        return !(gains && norm(hip - x) <= norm(hip - start) + band_);
    }

  private:
    void set_anchor(const Vec<D>& hip, double distance) noexcept {
        has_anchor_ = true;
        anchor_ = rest_position_ = hip;
        least_distance_ = distance;
        lift_sum_ = 0;
        ticks_at_rest_ = 0;
    }
    bool is_within(const Vec<D>& a, const Vec<D>& b, double bands) const noexcept {
        const Vec<D> d = a - b;
        return dot(d, d) <= bands * bands * band_ * band_;
    }

    double band_;
    bool has_anchor_ = false;
    bool is_stalled_ = false;
    Vec<D> anchor_;              // of the HIP, where the lifts are summed up
    double lift_sum_ = 0;        // by which they took the proxy away from its goal [m]
    double least_distance_ = 0;  // |proxy - anchor| from where they are summed up [m]
    Vec<D> rest_position_;
    int ticks_at_rest_ = 0;  // in which the HIP has been at rest_position_
};

/// The guarantees: the proxy is outside or on its way out, it rests where the HIP rests, and a tick
/// that would end inside is undone.
///
/// A motion M moves a proxy that is outside: towards the HIP, never through anything. It has
///
///     begin_tick, release, reset      before a tick; the proxy is put elsewhere; all is forgotten
///     move(proxy, hip, stall, path)   how a MotionEnd says that it ended
///     iterations                      of the last motion
///     is_spent                        whether this tick may look no further
///     is_overdrawn                    where a tick may look at its end only once: whether it is so
///     is_outside(proxy, before)       of a proxy not known to be outside before a motion, or after
///     contact(proxy, hip)             what it touches, as a RuleAnswer
///     from_nearest, exit_distance, is_in_body   what a way out asks (WayOut)
///     move_within(ball, proxy, hip)   where a path has no corners to record: no further than to
///                                     the edge of the ball
///     settle(start, proxy, hip, rests)  where it goes on straight once it rests
template <class M>
class GuardedRule {
  public:
    static constexpr int D = M::dimension;

    /// `of_motion`: what the motion is made of.
    template <class... OfMotion>
    GuardedRule(double radius, double band, double pace, OfMotion&&... of_motion)
        : motion_(std::forward<OfMotion>(of_motion)...),
          stall_(band),
          way_out_(radius, tuned::force_ramp * radius * pace),
          path_(radius) {}

    void reset() noexcept {
        motion_.reset();
        stall_.release();
        way_out_.stop();
        path_.clear();
        is_outside_ = is_handing_over_ = keeps_place_ = rests_ = false;
    }
    /// As a reset, but a proxy that is inside is led out from where it is.
    void continue_from(FreeBefore<D>* free_before) noexcept {
        reset();
        keeps_place_ = true;
        way_out_.keep_to(free_before);
    }

    /// Where a proxy at x is led to that was inside after an exchange, else x; nothing while that
    /// is not known.
    std::optional<Vec<D>> end_of_way(const Vec<D>& x) const noexcept {
        return keeps_place_ ? way_out_.end(x) : x;
    }

    /// One servo tick.
    RuleAnswer<D> step(Vec<D>& proxy, const Vec<D>& hip) noexcept {
        motion_.begin_tick();
        if (!is_outside_ && !way_out_.is_active() && motion_.is_outside(proxy, true)) {
            way_out_.stop();
            is_outside_ = true;
        }
        if (!is_outside_) return lead_out(proxy, hip);
        if (M::rest_is_final && rests_ && hip == last_hip_) return last_;
        last_hip_ = hip;
        return is_handing_over_ ? hand_over(proxy, hip) : follow(proxy, hip);
    }

    M& motion() noexcept { return motion_; }

    /// Something came or went, where the proxy is or elsewhere: what was planned may lead into it.
    void surroundings_changed(bool is_near, bool something_came) noexcept {
        path_.drop();
        if (!is_near) return;
        motion_.forget();
        stall_.release();
        if (!something_came) return;
        // From the next tick on a proxy that is inside is led out from where it is.
        if (is_outside_) keeps_place_ = true;
        is_outside_ = false;
    }

  private:
    /// One tick of a proxy that is inside.
    RuleAnswer<D> lead_out(Vec<D>& proxy, const Vec<D>& hip) noexcept {
        if (!way_out_.is_active()) {
            anchor_ = proxy;
            way_out_.begin(motion_, keeps_place_ ? proxy : hip);
        }
        is_outside_ = way_out_.step(motion_, keeps_place_ ? anchor_ : hip, proxy);
        is_handing_over_ = is_outside_ && !(proxy == hip);
        if (is_outside_) {
            way_out_.set_hip(hip);
            keeps_place_ = false;
        }
        motion_.release();
        path_.clear();
        rests_ = false;
        return {way_out_.direction(), State::entrenched, way_out_.status()};
    }

    /// One tick of a proxy that is outside.
    RuleAnswer<D> follow(Vec<D>& proxy, const Vec<D>& hip) noexcept {
        const Vec<D> start = proxy;
        MotionEnd end = motion_.move(proxy, hip, stall_, path_);
        stall_.end_of_iterations(proxy, end != MotionEnd::limit);
        if (stall_.must_undo(start, proxy, hip, motion_.iterations())) {
            proxy = start;
            path_.drop();
            end = MotionEnd::rests;
        }
        if constexpr (requires { motion_.is_overdrawn(); })
            // A plan that took most of a tick is looked at on the way, and not where it ends.
            if (path_.is_recording() && motion_.is_overdrawn())
                return {{}, State::entrenched, Status::limit};
        return finish(start, proxy, hip, end, Status::ok);
    }

    /// One tick of a proxy that has come out and is not yet where the rule would have it: as far
    /// that way as the force may change. (W3)
    RuleAnswer<D> hand_over(Vec<D>& proxy, const Vec<D>& hip) noexcept {
        const ForceBall<D> ball = way_out_.force_ball(proxy, hip);
        if constexpr (requires { motion_.move_within(&ball, proxy, hip); }) {
            const Vec<D> start = proxy;
            const MotionEnd end = motion_.move_within(&ball, proxy, hip);
            is_handing_over_ = end == MotionEnd::force_ball;
            if (end == MotionEnd::limit) is_handing_over_ = !path_.has_taken_over(false);
            return finish(start, proxy, hip, end, is_handing_over_ ? Status::inside : Status::ok);
        } else {
            if (path_.leads_to(hip)) {
                // At the end the proxy is where it would rest, unless the HIP has moved since.
                const bool would_rest = path_.walk(proxy, ball) && planned_.status == Status::ok;
                const bool rests = would_rest && path_.was_planned_for(hip);
                if (M::rest_is_final && would_rest && path_.has_taken_over(rests)) {
                    is_handing_over_ = false;
                    if (!rests) planned_ = finish(proxy, proxy, hip, MotionEnd::force_ball, 0);
                    rests_ = rests;
                    return last_ = planned_;
                }
            } else {
                Vec<D> end = proxy;
                path_.begin_recording(hip);
                planned_ = follow(end, hip);
                path_.end_recording(!(end == proxy));
                const bool is_at_end = path_.walk(proxy, ball);
                if (is_at_end && path_.has_taken_over(planned_.status == Status::ok)) {
                    is_handing_over_ = false;
                    if (planned_.state != State::entrenched) {
                        proxy = end;
                        return planned_;
                    }
                }
            }
            return finish(proxy, proxy, hip, MotionEnd::force_ball, Status::inside);
        }
    }

    /// Checks where the proxy has come to, and says what it touches there.
    RuleAnswer<D> finish(const Vec<D>& start, Vec<D>& proxy, const Vec<D>& hip, MotionEnd end,
                         std::uint8_t status) noexcept {
        if (end == MotionEnd::limit) status |= Status::limit;
        if (end != MotionEnd::settled && !motion_.is_outside(proxy)) {
            // Cannot happen. If it does, the proxy stays where it was safe, and the next tick looks
            // whether it still is.
            proxy = start;
            path_.drop();
            motion_.release();
            rests_ = is_outside_ = false;
            last_.status = status | Status::limit;
            return last_;
        }
        rests_ = status == Status::ok;
        if constexpr (requires { motion_.settle(start, proxy, hip, rests_); }) {
            if (end == MotionEnd::rests || end == MotionEnd::limit) {
                motion_.settle(start, proxy, hip, rests_);
                path_.record(proxy);
            }
        }
        last_ = motion_.contact(proxy, hip);
        last_.status = status;
        return last_;
    }

    M motion_;
    StallTest<D> stall_;
    WayOut<D> way_out_;
    PlannedPath<D> path_;
    Vec<D> anchor_;  // where a way out began on which the proxy does not go with the HIP
    bool is_outside_ = false;
    bool is_handing_over_ = false;  // the proxy has come out, and is not where it would rest
    bool keeps_place_ = false;      // on the way out the proxy does not go with the HIP
    bool rests_ = false;
    Vec<D> last_hip_;
    RuleAnswer<D> last_, planned_;  // of the last tick, and at the end of the path
};

}  // namespace vfplan::inline v1
