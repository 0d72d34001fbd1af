// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A fixture that moves: its pose comes from a tracker at 20 to 100 Hz, late, noisy, or not at all,
// and the engine steps in the fixture's frame:
//
//     vfplan::MovingFrame frame;                            // allocates
//     frame.pose(stamp, {place, w, {x, y, z}});             // the tracker's thread
//     for (;;) force = frame.step(engine, t, hip).force;    // never allocates, throws or waits
//
// From each pose to the next the frame goes evenly, one sample late, and never faster than it was
// told. Nothing is predicted, because a predictor overshoots where a motion turns. K and
// ignore_axis turn with the fixture.
#pragma once

#include "vfplan/base/queue.hpp"
#include "vfplan/parameters.hpp"

namespace vfplan::inline v1 {

/// Where a frame lies: place + rotation by the unit quaternion w + v. Square roots only, so that
/// every processor computes the same.
struct Pose {
    Vec3 place;
    double w = 1;
    Vec3 v;

    Vec3 turn(const Vec3& x) const noexcept {
        const Vec3 u = 2.0 * cross(v, x);
        return x + w * u + cross(v, u);
    }
    Vec3 back(const Vec3& x) const noexcept { return Pose{{}, w, -1.0 * v}.turn(x); }
    Vec3 out(const Vec3& x) const noexcept { return turn(x) + place; }  ///< from the frame
    Vec3 in(const Vec3& x) const noexcept { return back(x - place); }   ///< into the frame

    /// The pose of a rigid (4, 4) matrix, given row by row. Throws std::invalid_argument for one
    /// that is not rigid, or whose last row is not 0 0 0 1, as of one given column by column.
    static Pose of_rows(const double* m) {
        const auto close = [](double a, double b) { return std::abs(a - b) < matrix_tolerance; };
        const Vec3 x{m[0], m[4], m[8]}, y{m[1], m[5], m[9]}, z{m[2], m[6], m[10]};
        if (!(m[12] == 0 && m[13] == 0 && m[14] == 0 && m[15] == 1))
            reject(
                "the last row of a pose is not 0 0 0 1. Give its rows to of_rows, as a matrix "
                "of NumPy, and its columns to of_columns, as O_T_EE of libfranka.");
        if (!(close(dot(x, x), 1) && close(dot(y, y), 1) && close(dot(z, z), 1) &&
              close(dot(x, y), 0) && close(dot(y, z), 0) && close(dot(z, x), 0) &&
              dot(cross(x, y), z) > 0))
            reject("a pose is no rotation and translation. Give a rigid matrix.");
        const double d[3] = {m[0], m[5], m[10]};
        Pose p{{{m[3], m[7], m[11]}}, 0, {}};
        // From the largest of four squares, so that no small difference is divided by.
        const int i = static_cast<int>(std::max_element(d, d + 3) - d);
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        const double trace = d[0] + d[1] + d[2];
        const double wv = m[4 * k + j] - m[4 * j + k];
        if (trace > d[i]) {
            const double s = 2 * std::sqrt(1 + trace);
            p.w = s / 4;
            p.v = {{(m[9] - m[6]) / s, (m[2] - m[8]) / s, (m[4] - m[1]) / s}};
        } else {
            const double s = 2 * std::sqrt(1 + d[i] - d[j] - d[k]);
            p.w = wv / s;
            p.v[i] = s / 4;
            p.v[j] = (m[4 * i + j] + m[4 * j + i]) / s;
            p.v[k] = (m[4 * i + k] + m[4 * k + i]) / s;
        }
        return p;
    }
    /// The same, given column by column.
    static Pose of_columns(const double* m) {
        double rows[16];
        for (int i = 0; i < 16; ++i) rows[i] = m[4 * (i % 4) + i / 4];
        return of_rows(rows);
    }

  private:
    /// How far an entry of R^T R may be from that of the unit matrix: files have six digits.
    static constexpr double matrix_tolerance = 1e-5;
};

struct MovingLimits {
    double max_age = 0.1;     ///< of a pose [s]; an older one is stale
    double max_speed = 0.25;  ///< of the pivot [m/s]
    double max_turn = 1;      ///< of the frame about its pivot [rad/s]
    Vec3 pivot;  ///< in the fixture's frame, near where the tool works [m]; a pose that
                 ///< jumps is followed by these limits, and may push the tool
};

namespace detail {

/// What a MovingFrame keeps from pose to pose and from tick to tick.
struct FrameState {
    // Of the tracker's thread.
    bool has_given_ = false;
    double youngest_ = 0;    // stamp of the last pose given [s]
    int older_ = 0;          // poses in order, each older than that
    double last_older_ = 0;  // stamp of the last of them [s]
    // Of the loop.
    Pose now_, goal_;
    double t_ = -infinity;           // latest [s]
    double stepped_at_ = -infinity;  // t_ at the last step [s]
    double stamp_ = 0;               // of goal_ [s]
    double arrives_at_ = 0;          // goal_, where the next pose is due [s]
    bool is_placed_ = false;
    bool may_go_back_ = false;            // the clock, at the next tick
    bool is_clock_ahead_ = false;         // the tracker's
    bool is_clock_bad_ = false;           // the loop's
    std::uint64_t taken_ = 0, seen_ = 0;  // number of poses
};

}  // namespace detail

class MovingFrame : private detail::FrameState {
  public:
    /// Number of poses that may wait for the loop.
    static constexpr std::size_t most_waiting = 64;
    /// By how much the size of a unit quaternion may be off.
    static constexpr double rigid_tolerance = 1e-3;
    static constexpr int resyncs_after = 3;

    /// Throws std::invalid_argument for a limit out of range.
    explicit MovingFrame(const MovingLimits& limits = {}) : limits_(limits), poses_(most_waiting) {
        check_above("max_age", limits.max_age, 0, 10, " s");
        check_above("max_speed", limits.max_speed, 0, 10, " m/s");
        check_above("max_turn", limits.max_turn, 0, 100, " rad/s");
        if (!is_within_range(limits.pivot)) reject("pivot must be finite and within 1e6 m");
    }

    /// Hands over the fixture's frame at `stamp`, on the loop's clock [s]; for the thread of the
    /// tracker. False, and counted, for a pose that is not rigid to 1e-3 or further than 100 m from
    /// the base, that is not younger than the last, or that finds `most_waiting` poses which the
    /// loop has not seen. One stray stamp does no harm for long: of poses that come younger and
    /// younger, but all older than the last one taken, the `resyncs_after`-th is taken; and one
    /// that lies ahead of the loop by more than max_age is dropped when another follows it.
    bool pose(double stamp, const Pose& pose) noexcept {
        Pose p = pose;
        const double size = std::sqrt(p.w * p.w + dot(p.v, p.v));
        const bool is_rigid = std::abs(size - 1) < rigid_tolerance;
        const bool is_good = std::isfinite(stamp) && norm(p.place) <= largest_distance && is_rigid;
        p.w /= size;
        p.v = (1 / size) * p.v;
        if (!is_good || !is_due(stamp) || !poses_.push({stamp, p})) {
            refused_.fetch_add(1, std::memory_order_relaxed);
            return false;
        }
        older_ = 0;
        has_given_ = true;
        youngest_ = stamp;
        return true;
    }
    /// How many more poses may wait; for the thread of the tracker.
    std::size_t room() const noexcept { return poses_.free_slots(); }
    std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }

    /// The frame at t [s]; for the loop, as all that follows. At a t that goes back or is not
    /// finite the frame stays where it is, and is stale.
    const Pose& at(double t) noexcept {
        if (std::exchange(may_go_back_, false) && t < t_) {
            t_ = stepped_at_ = -infinity;
            is_placed_ = false;
        }
        is_clock_bad_ = !std::isfinite(t) || t < t_;
        if (!std::isfinite(t)) t = t_;
        if (is_placed_ && t > t_) advance(std::min(t - t_, limits_.max_age), t);
        t_ = std::max(t, t_);
        const Stamped* next = poses_.front();
        const auto is_ahead = [&] { return next->stamp > t + limits_.max_age; };
        while (next && (next->stamp <= t || (is_ahead() && poses_.holds_more()))) {
            if (next->stamp <= t) accept_pose(*next, t);
            poses_.pop();
            ++taken_;
            next = poses_.front();
        }
        seen_ = taken_ + (next != nullptr);
        is_clock_ahead_ = next && is_ahead();
        return now_;
    }
    const Pose& now() const noexcept { return now_; }
    /// The loop begins anew; for the loop. Where its clock has gone back at the next tick, the
    /// frame waits for the first pose of the new time, and forgets those of the old one.
    void restart() noexcept { may_go_back_ = true; }
    /// There was no pose and no tick; while neither thread uses it.
    void reset() noexcept {
        while (poses_.front()) poses_.pop();
        refused_ = 0;
        static_cast<detail::FrameState&>(*this) = {};
    }
    /// Whether there is no pose yet, or only one older than max_age, or the tracker's clock is that
    /// much ahead, or the last t of the loop was not later than the one before.
    bool stale() const noexcept {
        return !is_placed_ || is_clock_bad_ || is_clock_ahead_ || age() > limits_.max_age;
    }
    /// Age of the youngest pose taken up, at the last t [s].
    double age() const noexcept { return is_placed_ ? t_ - stamp_ : infinity; }
    /// How far the fixture still has to go at `place` (in the base), to where its youngest pose
    /// puts it [m]. Infinite before the first pose, and where `place` is not finite.
    double lag(const Vec3& place) const noexcept {
        if (!is_placed_ || !is_within_range(place)) return infinity;
        return norm(goal_.out(now_.in(place)) - place);
    }
    /// How many of the poses that were not refused the last tick knew of.
    std::uint64_t seen() const noexcept { return seen_; }
    /// Whether there has been a pose. Before, nothing is rendered.
    bool placed() const noexcept { return is_placed_; }

    /// One servo loop of an engine, or a Guide, that is in the fixture's frame. HIP and answer are
    /// in the base. The fixture stands still, and is stale, unless t is later than in the step
    /// before; so a second engine needs a frame of its own.
    template <class E>
    auto step(E& engine, double t, const Vec3& hip) noexcept {
        at(t);
        if (!(t > stepped_at_)) is_clock_bad_ = true;
        stepped_at_ = t_;
        decltype(engine.step(hip)) s;
        if (!is_placed_) {
            s.status = Status::stale_pose;
            if (is_within_range(hip))
                s.proxy = hip;
            else
                s.status |= Status::bad_hip;
            return s;
        }
        s = engine.step(now_.in(hip));
        s.proxy = now_.out(s.proxy);
        if constexpr (requires { s.normal; }) s.normal = now_.turn(s.normal);
        s.force = now_.turn(s.force);
        if (stale()) s.status |= Status::stale_pose;
        return s;
    }

  private:
    struct Stamped {
        double stamp;
        Pose pose;
    };

    /// Whether a stamp is younger than the last one, or of poses that are all older the one that is
    /// taken.
    bool is_due(double stamp) noexcept {
        if (!has_given_ || !(stamp <= youngest_)) return true;
        older_ = stamp > last_older_ ? older_ + 1 : 1;
        last_older_ = stamp;
        return older_ >= resyncs_after;
    }

    /// Lets the frame arrive at this pose when the next one is due. It begins at the first one.
    void accept_pose(const Stamped& next, double t) noexcept {
        arrives_at_ = t + std::min(next.stamp - stamp_, limits_.max_age);
        stamp_ = next.stamp;
        goal_ = next.pose;
        if (!is_placed_) now_ = goal_;
        is_placed_ = true;
    }

    /// Moves the frame by the fraction of what is left that belongs to the dt before t, or by as
    /// much as the limits allow.
    void advance(double dt, double t) noexcept {
        const double fraction = arrives_at_ > t ? dt / (arrives_at_ - t + dt) : 1;
        const Vec3 from = now_.out(limits_.pivot);
        const Vec3 to = goal_.out(limits_.pivot);
        const Vec3 way = fraction * (to - from);
        const double max_length = limits_.max_speed * dt;
        const bool has_turned =
            rotate_towards(fraction, std::min(0.5 * limits_.max_turn * dt, 1.0));
        if (fraction == 1 && !(norm(way) > max_length) && has_turned) {
            now_ = goal_;
            return;
        }
        const Vec3 pivot = from + shortened(way, max_length);
        now_.place = pivot - now_.turn(limits_.pivot);
    }
    /// Turns the frame by `fraction` of what is left, but by at most the angle whose half has the
    /// sine `max_half_turn`; false when that is less.
    bool rotate_towards(double fraction, double max_half_turn) noexcept {
        const double c = now_.w * goal_.w + dot(now_.v, goal_.v);
        const double sign = c < 0 ? -1 : 1;  // q and -q are one turn: the shorter way is taken
        const double uw = sign * goal_.w - sign * c * now_.w;  // across now_, towards the goal
        const Vec3 uv = sign * goal_.v - (sign * c) * now_.v;
        const double sine = std::sqrt(uw * uw + dot(uv, uv));
        if (!(sine > 0)) return true;
        const double w = 1 - fraction + fraction * std::abs(c);
        const double u = fraction * sine;
        const double whole = u / std::sqrt(w * w + u * u);
        const double s = std::min(whole, max_half_turn);
        const double keep = std::sqrt(1 - s * s);
        const double add = s / sine;
        now_.w = keep * now_.w + add * uw;
        now_.v = keep * now_.v + add * uv;
        const double size = std::sqrt(now_.w * now_.w + dot(now_.v, now_.v));
        now_.w /= size;
        now_.v = (1 / size) * now_.v;
        return whole <= max_half_turn;
    }

    MovingLimits limits_;
    SpscQueue<Stamped> poses_;
    std::atomic<std::uint64_t> refused_{0};
};

}  // namespace vfplan::inline v1
