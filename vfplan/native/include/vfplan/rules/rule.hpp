// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What a rule is, and the guarantees that the rules `robust` and `exact` give, once for all of
// them. What differs between these rules is a motion; what is promised stands around it here. The
// numbers in brackets are the equations of docs/robust.md, and docs/rules.md lists the guarantees.
#pragma once

#include <concepts>

#include "vfplan/rules/start_inside.hpp"

namespace vfplan::inline v1 {

/// What an engine holds: something that moves a proxy, one servo tick after the other.
template <class R>
concept ProxyRule = requires(R rule, Vec<R::dimension>& proxy, const Vec<R::dimension>& hip,
                             const FreeBefore<R::dimension>* free_before) {
    { rule.step(proxy, hip) } noexcept -> std::same_as<RuleAnswer<R::dimension>>;
    { rule.reset() } noexcept;
    { rule.continue_from(free_before) } noexcept;
};

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

/// For a motion that comes to rest by itself.
template <int D>
struct NoStall {
    explicit NoStall(double) noexcept {}
    void release() noexcept {}
    void end_of_iterations(const Vec<D>&, bool) noexcept {}
    bool must_undo(const Vec<D>&, const Vec<D>&, const Vec<D>&, int) const noexcept {
        return false;
    }
};

/// What moves a proxy that is outside: towards the HIP, never through anything.
template <class M, class Stall>
concept Motion = requires(M motion, Stall& stall, PlannedPath<M::dimension>& path,
                          Vec<M::dimension>& proxy, const Vec<M::dimension>& hip) {
    { M::rest_is_final } -> std::convertible_to<bool>;
    { motion.begin_tick() } noexcept;
    { motion.move(proxy, hip, stall, path) } noexcept -> std::same_as<MotionEnd>;
    { motion.is_clear(proxy) } noexcept -> std::same_as<bool>;    // of one not known to be outside
    { motion.is_outside(proxy) } noexcept -> std::same_as<bool>;  // after a motion
    { motion.contact(proxy, hip) } noexcept -> std::same_as<RuleAnswer<M::dimension>>;
    { motion.iterations() } noexcept -> std::same_as<int>;  // of the last motion
    { motion.release() } noexcept;
    { motion.reset() } noexcept;
    motion.inside();  // what a way out leaves: InsideCloud, CurveMotion or InsideMesh
};

/// The guarantees: the proxy is outside or on its way out, it rests where the HIP rests, and a tick
/// that would end inside is undone.
template <class M, class Stall>
    requires Motion<M, Stall>
class GuardedRule {
  public:
    static constexpr int dimension = M::dimension;
    static constexpr int D = dimension;

    /// `of_motion`: what the motion is made of.
    template <class... OfMotion>
    GuardedRule(double radius, double band, double pace, OfMotion&&... of_motion)
        : motion_(std::forward<OfMotion>(of_motion)...),
          stall_(band),
          start_inside_(radius, tuned::force_ramp * radius * pace),
          path_(radius) {}

    void reset() noexcept {
        motion_.reset();
        stall_.release();
        start_inside_.reset();
        path_.clear();
        rests_ = false;
    }
    /// As a reset, but a proxy that is inside is led out from where it is.
    void continue_from(const FreeBefore<D>* free_before) noexcept {
        reset();
        start_inside_.continue_from(free_before);
    }

    /// Where a proxy at x is led to that was inside after an exchange, else x; nothing while that
    /// is not known.
    std::optional<Vec<D>> end_of_way(const Vec<D>& x) const noexcept {
        return start_inside_.end_of_way(x);
    }

    /// One servo tick.
    RuleAnswer<D> step(Vec<D>& proxy, const Vec<D>& hip) noexcept {
        motion_.begin_tick();
        const auto is_clear = [&]() noexcept { return motion_.is_clear(proxy); };
        if (!start_inside_.ensure_outside(motion_.inside(), proxy, hip, is_clear)) {
            motion_.release();
            path_.clear();
            rests_ = false;
            return start_inside_.answer();
        }
        if (M::rest_is_final && rests_ && hip == last_hip_) return last_;
        last_hip_ = hip;
        if (start_inside_.is_handing_over()) return hand_over(proxy, hip);
        return follow(proxy, hip);
    }

  protected:
    M& motion() noexcept { return motion_; }
    const M& motion() const noexcept { return motion_; }
    /// What was planned may lead into something new.
    void drop_plan() noexcept { path_.drop(); }
    /// Something came near, or went, where the proxy is.
    void surroundings_changed(bool something_came) noexcept {
        stall_.release();
        if (something_came) start_inside_.recheck();
    }

  private:
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
        return finish(start, proxy, hip, end, Status::ok);
    }

    /// One tick of a proxy that has come out and is not yet where the rule would have it: as far
    /// that way as the force may change. (W3)
    RuleAnswer<D> hand_over(Vec<D>& proxy, const Vec<D>& hip) noexcept {
        const ForceBall<D> ball = start_inside_.force_ball(proxy, hip);
        if constexpr (requires { motion_.move_within(ball, proxy, hip); }) {
            const Vec<D> start = proxy;
            const MotionEnd end = motion_.move_within(ball, proxy, hip);
            bool continues = end == MotionEnd::force_ball;
            if (end == MotionEnd::limit) continues = !path_.has_taken_over(false);
            start_inside_.continue_hand_over(continues);
            return finish(start, proxy, hip, end, continues ? Status::inside : Status::ok);
        } else {
            if (path_.leads_to(hip)) {
                path_.walk(proxy, ball);
            } else {
                Vec<D> end = proxy;
                path_.begin_recording(hip);
                const RuleAnswer<D> answer = follow(end, hip);
                path_.end_recording(!(end == proxy));
                const bool is_at_end = path_.walk(proxy, ball);
                if (is_at_end && path_.has_taken_over(answer.status == Status::ok)) {
                    start_inside_.continue_hand_over(false);
                    proxy = end;
                    return answer;
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
            // Cannot happen. If it does, the proxy stays where it was safe.
            proxy = start;
            path_.drop();
            motion_.release();
            status |= Status::limit;
            start_inside_.set_outside(motion_.is_outside(proxy));
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
    Stall stall_;
    StartInside<D> start_inside_;
    PlannedPath<D> path_;
    bool rests_ = false;
    Vec<D> last_hip_;
    RuleAnswer<D> last_;
};

}  // namespace vfplan::inline v1
