// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A start inside the fixture. The proxy is led out along the shortest way that is found, slowly, so
// that the force grows as a ramp, and follows the HIP meanwhile. Once it is outside, the rule takes
// over as slowly. The numbers in brackets are the equations of docs/robust.md.
#pragma once

#include "vfplan/cloud/grid.hpp"
#include "vfplan/mesh/triangles.hpp"

namespace vfplan::inline v1 {

/// A ball that holds the proxy for one tick, so that the force changes no faster than it may. Its
/// middle is where the proxy would be had it gone with the HIP; K times its radius is what the tick
/// may add to the force, or turn it by. (W3)
template <int D>
struct ForceBall {
    Vec<D> middle;
    double radius;  ///< [m]

    /// How much of [0, length] along the unit vector `direction` from x, which lies in the ball,
    /// stays in it.
    double free_length(const Vec<D>& x, const Vec<D>& direction, double length) const noexcept {
        const Vec<D> w = x - middle;
        const double b = dot(w, direction);
        const double c = dot(w, w) - radius * radius;
        return std::clamp(std::sqrt(std::max(0.0, b * b - c)) - b, 0.0, length);
    }
};

/// The space around the fixture that was there before an exchange. A way out of the new fixture
/// leads to the proxy's own side if the proxy could have gone it before, and the old fixture lay on
/// the side of -out, as the new one does. `out` points away from the new fixture where the way
/// ends.
template <int D>
struct FreeBefore {
    /// Nothing where this tick may look no further.
    virtual std::optional<bool> is_free(const Vec<D>& direction, double length,
                                        const Vec<D>& out) noexcept = 0;

  protected:
    ~FreeBefore() = default;
};

/// The way out of what a start is inside of. The proxy is at hip + length_ * direction_.
///
/// `Geometry` is a motion (rules/rule.hpp), of which it asks
///
///     from_nearest(x)        from the nearest place within R to x; 0 where there is none but x
///                            itself
///     exit_distance(y, d)    distance from y along the unit vector d out of all that y is in;
///                            -infinity where it is in nothing, 0 where this tick may look no
///                            further (W1)
///     is_spent()             whether this tick may look no further
///     is_in_body(y, clear)   whether y lies in a body of which the geometry is the skin, as no
///                            curve is; nothing where this tick may look no further. No geometry
///                            is nearer to y than `clear`.
template <int D>
class WayOut {
  public:
    /// Hops from sphere to sphere along one direction, a tick.
    static constexpr int max_hops = 48;
    /// Hops along all directions together while one of them is chosen, a tick.
    static constexpr int max_hops_to_choose = 128;
    static constexpr int max_ticks_to_choose = 1024;

    /// `ramp`: how much longer the spring may become in a tick [m].
    WayOut(double radius, double ramp) noexcept : R_(radius), ramp_(ramp) {}

    bool is_active() const noexcept { return is_active_; }
    const Vec<D>& direction() const noexcept { return direction_; }
    /// `inside`, and whether no way out on the proxy's own side was found.
    std::uint8_t status() const noexcept {
        return leads_to_other_side_ ? Status::inside | Status::other_side : Status::inside;
    }
    /// Where it leads a proxy at x that does not go with the HIP; nothing while that is not known.
    std::optional<Vec<D>> end(const Vec<D>& x) const noexcept {
        if (!is_active_ || leads_to_other_side_) return x;
        if (ticks_to_choose_ > 0) return std::nullopt;
        return shortest_ < infinity ? start_ + shortest_ * direction_ : x;
    }
    void stop() noexcept {
        is_active_ = false;
        leads_to_other_side_ = false;
        free_before_ = nullptr;
    }
    /// The next way out is one that was free before, where there is one.
    void keep_to(FreeBefore<D>* free_before) noexcept { free_before_ = free_before; }

    /// The HIP is at `hip` and the proxy inside: the way out is looked for from the next tick on.
    template <class Geometry>
    void begin(Geometry& geometry, const Vec<D>& hip) noexcept {
        is_active_ = true;
        length_ = 0;
        last_hip_ = start_ = hip;
        direction_ = Vec<D>{};
        direction_.c[D - 1] = 1;
        direction_ = nearest_ = leave_nearest(geometry, hip);
        shortest_ = infinity;
        for (double& t : reached_) t = 0;
        ticks_to_choose_ = max_ticks_to_choose;
        leads_to_other_side_ = false;
        keeps_out_ = !free_before_;
        if (keeps_out_ && geometry.is_in_body(hip, 0) == true) direction_ = nearest_ = -nearest_;
    }

    /// One tick; true once the proxy has reached the free space.
    template <class Geometry>
    bool step(Geometry& geometry, const Vec<D>& hip, Vec<D>& proxy) noexcept {
        bool is_out;
        is_cut_short_ = false;
        if (ticks_to_choose_ > 0 && !choose_direction(geometry)) {
            // No force before there is a way.
            if (!is_cut_short_) --ticks_to_choose_;
            is_out = hop(geometry, hip, direction_) == free;
        } else {
            ticks_to_choose_ = 0;
            free_before_ = nullptr;
            is_out = advance(geometry, hip);
        }
        last_hip_ = hip;
        proxy = hip + length_ * direction_;
        is_active_ = !is_out;
        return is_out;
    }

    /// The HIP is at `hip`, wherever the way out began.
    void set_hip(const Vec<D>& hip) noexcept { last_hip_ = hip; }
    /// Where the proxy, now at x, may go while the rule takes over and the HIP has come to `hip`.
    ForceBall<D> force_ball(const Vec<D>& x, const Vec<D>& hip) noexcept {
        const Vec<D> moved = hip - std::exchange(last_hip_, hip);
        return {x + moved, ramp_ + norm(moved)};
    }

  private:
    /// Directions to the cells of a square or cube around one, its own included.
    static constexpr int cube_directions = D == 3 ? 27 : 9;
    static constexpr int candidates = cube_directions + 2;
    static constexpr double free = -infinity;

    /// One tick of the way out. K times the change of length_ is the change of force, so it changes
    /// by `ramp` a tick at most, and by what the HIP itself moves against the direction (W2). True
    /// once the proxy is outside.
    template <class Geometry>
    bool advance(Geometry& geometry, const Vec<D>& hip) noexcept {
        const double backwards = std::max(0.0, -dot(hip - last_hip_, direction_));
        const double allowed = ramp_ + backwards;
        // Whether the proxy is free already is asked first, while there is most left to look with.
        is_cut_short_ = false;
        const double ahead =
            distance_to_free(geometry, hip + length_ * direction_, direction_, allowed);
        const bool is_known = !is_cut_short_;
        const double needed = distance_to_free(geometry, hip, direction_, length_);
        if (needed < length_) {
            // The HIP has come nearer to the free space, or through to its other side: shorten.
            length_ = std::max(needed, length_ - ramp_);
        } else if (!is_known) {
            return false;
        } else {
            length_ += std::min(ahead, allowed);
            if (ahead < allowed) return true;
        }
        return hop(geometry, hip + length_ * direction_, direction_) == free;
    }

    /// Follows all directions hop by hop, in turn, so that none uses up the hops of a tick; false
    /// while the shortest way is not known.
    template <class Geometry>
    bool choose_direction(Geometry& geometry) noexcept {
        int hops = max_hops_to_choose;
        for (bool is_open = true; is_open;) {
            is_open = false;
            for (int i = 0; i < candidates; ++i) {
                if (!(reached_[i] < shortest_)) continue;
                if (hops-- == 0) return false;
                is_open = true;
                const Vec<D> d = candidate(i);
                const double s = hop(geometry, start_ + reached_[i] * d, d);
                if (s == free) {
                    shortest_ = reached_[i];
                    direction_ = d;
                    chosen_ = i;
                } else {
                    reached_[i] += s;
                }
            }
        }
        const std::optional<bool> was_free = was_free_before(geometry, direction_, shortest_);
        is_cut_short_ |= !was_free;
        if (was_free != true) return was_free && reject_direction();
        // From where it comes out, straight away from what is nearest there may be shorter.
        for (int i = 0; i < 2 && !geometry.is_spent(); ++i) {
            const Vec<D> d = leave_nearest(geometry, start_ + shortest_ * direction_);
            const double t = distance_to_free(geometry, start_, d, shortest_);
            if (t < shortest_ && was_free_before(geometry, d, t) == true) {
                shortest_ = t;
                direction_ = d;
            }
        }
        return true;
    }
    /// From the nearest point, its opposite, and the neighbours of a cube.
    Vec<D> candidate(int i) const noexcept {
        if (i < 2) return (i == 0 ? 1.0 : -1.0) * nearest_;
        Vec<D> d;
        for (int k = 0, rest = i - 2; k < D; ++k, rest /= 3) d.c[k] = rest % 3 - 1;
        return norm(d) > 0 ? along(d, 1) : nearest_;
    }
    template <class Geometry>
    std::optional<bool> was_free_before(Geometry& geometry, const Vec<D>& d,
                                        double length) noexcept {
        if (!free_before_) return true;
        return free_before_->is_free(d, length, leave_nearest(geometry, start_ + length * d));
    }
    /// The shortest way leads to the other side: the next one is tried, and where none is left, the
    /// shortest of all is taken.
    bool reject_direction() noexcept {
        reached_[chosen_] = shortest_ = infinity;
        for (double t : reached_)
            if (t < infinity) return false;
        for (double& t : reached_) t = 0;
        free_before_ = nullptr;
        leads_to_other_side_ = true;
        return false;
    }

    /// Unit vector from the nearest geometry to x; the direction of the way where x lies on it.
    template <class Geometry>
    Vec<D> leave_nearest(Geometry& geometry, const Vec<D>& x) noexcept {
        const Vec<D> away = geometry.from_nearest(x);
        const double r = norm(away);
        return r > 0 ? (1 / r) * away : direction_;
    }
    /// Distance from x along d to the free space; infinity beyond `max_length` or out of hops.
    template <class Geometry>
    double distance_to_free(Geometry& geometry, const Vec<D>& x, const Vec<D>& d,
                            double max_length) noexcept {
        double t = 0;
        for (int i = 0; i < max_hops && t < max_length; ++i) {
            const double s = hop(geometry, x + t * d, d);
            if (s == free) return t;
            t += s;
        }
        return infinity;
    }
    /// Distance from y along d out of all that y is in; `free` where it is in nothing, and 0 where
    /// this tick may look no further. What lies deep in a closed body is not free, and R further is
    /// in it or its skin.
    template <class Geometry>
    double hop(Geometry& geometry, const Vec<D>& y, const Vec<D>& d) noexcept {
        const double s = geometry.exit_distance(y, d);
        if (s != free) return s + tuned::hop_margin * R_;
        if (!keeps_out_) return free;
        const std::optional<bool> is_in = geometry.is_in_body(y, R_);
        if (!is_in) {
            is_cut_short_ = true;
            return 0;
        }
        return *is_in ? R_ : free;
    }

    double R_, ramp_;
    bool is_active_ = false;
    Vec<D> direction_, last_hip_;
    double length_ = 0;  // from the HIP to the proxy [m]
    Vec<D> start_, nearest_;
    double reached_[candidates] = {};  // along each candidate, from the start [m]
    double shortest_ = infinity;
    int chosen_ = 0;  // of the candidates
    FreeBefore<D>* free_before_ = nullptr;
    bool leads_to_other_side_ = false;
    bool is_cut_short_ = false;  // the tick ended before the side of a place was known
    bool keeps_out_ = false;     // of closed bodies, also where it began on their skin
    int ticks_to_choose_ = 0;
};

/// A path that the rule plans at once and the proxy walks over several ticks, each as far as the
/// force may change, after it has come out of a fixture. Without it
/// test_a_hand_that_leaves_clutter_feels_no_jump fails.
template <int D>
class PlannedPath {
  public:
    static constexpr int max_corners = 64;
    /// A HIP that moves further than this needs a new path [R].
    static constexpr double max_hip_motion = 1.0 / 64;

    explicit PlannedPath(double radius) noexcept : R_(radius) {}

    void clear() noexcept {
        drop();
        unfinished_ = 0;
    }
    /// What is left of the path may lead into something new.
    void drop() noexcept {
        next_ = 0;
        count_ = 0;
    }
    /// Whether something of the path is left, and it still leads to the HIP.
    bool leads_to(const Vec<D>& hip) const noexcept {
        return next_ < count_ && norm(hip - hip_) <= max_hip_motion * R_;
    }

    bool was_planned_for(const Vec<D>& hip) const noexcept { return hip == hip_; }

    /// The rule moves to the HIP now, and records each corner that it passes.
    void begin_recording(const Vec<D>& hip) noexcept {
        hip_ = hip;
        drop();
        is_recording_ = true;
    }
    bool is_recording() const noexcept { return is_recording_; }
    bool is_full() const noexcept { return is_recording_ && count_ + 2 > max_corners; }
    void record(const Vec<D>& x) noexcept {
        if (is_recording_) corner_[count_++] = x;
    }
    /// `moved`: the rule went to the last of those corners, and not back to where it was.
    void end_recording(bool moved) noexcept {
        is_recording_ = false;
        if (!moved) count_ = 0;
    }
    /// The path has come to its end. True when the rule has taken over: it came to an end, or it
    /// has not for 32 such paths, as below a HIP that trembles.
    bool has_taken_over(bool came_to_end) noexcept {
        return came_to_end || ++unfinished_ == tuned::ticks_to_stall;
    }

    /// Goes on from x as far as the ball allows; true at the end of the path.
    bool walk(Vec<D>& x, const ForceBall<D>& ball) noexcept {
        for (; next_ < count_; ++next_) {
            const Vec<D> leg = corner_[next_] - x;
            const double length = norm(leg);
            if (!(length > 0)) continue;
            const double s = ball.free_length(x, (1 / length) * leg, length);
            if (s < length) {
                x = x + (s / length) * leg;
                return false;
            }
            x = corner_[next_];
        }
        return true;
    }

  private:
    double R_;
    bool is_recording_ = false;
    Vec<D> corner_[max_corners];
    Vec<D> hip_;  // that the path was planned for
    int next_ = 0;
    int count_ = 0;
    int unfinished_ = 0;  // paths that fitted into a tick and had no end
};

}  // namespace vfplan::inline v1
