// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The drawn curve as a ruler. A guide keeps the tip within a tube around the curve, or leads it
// along.
//
//     vfplan::GuideParameters p;
//     p.radius = 1e-3;                                    // of the tube [m]
//     vfplan::Guide guide(xyz, n, false, p);              // throws std::invalid_argument
//     for (;;) force = guide.step(hip).force;             // never allocates, throws, locks, waits
//
// The guide keeps the place of the curve that is nearest to the tip, and moves it by descent of the
// distance. It does not search the whole curve for a nearer place, so it stays on its own strand
// where strands run close by or cross.
#pragma once

#include "vfplan/curve/tube.hpp"
#include "vfplan/parameters.hpp"

namespace vfplan::inline v1 {

struct GuideStep {
    Vec3 proxy;            ///< nearest place of the tube [m]; the HIP's own where it is free
    Vec3 force;            ///< on the hand [N]
    double arc = 0;        ///< of the place on its strand [m]
    double lateral = 0;    ///< HIP to place [m]
    double remaining = 0;  ///< from the place to the strand's end [m]
    std::uint32_t strand = 0;
    bool held = false;                 ///< whether the guide has hold of the tip
    std::uint8_t status = Status::ok;  ///< `bad_hip`, or `limit` where the place goes on next tick
};

/// Throws OutOfRange on a value outside its range.
inline void check(const GuideParameters& p) {
    check_from("radius", p.radius, smallest_radius, largest_radius, " m");
    check_above("stiffness", p.stiffness, 0, infinity, " N/m");
    if (!std::isfinite(p.lead_force))
        reject_setting("lead_force", p.lead_force, " N", "a finite force");
    check_above("lead_speed", p.lead_speed, 0, infinity, " m/s");
    check_above("period", p.period, 0, infinity, " s");
    if (p.ignore_axis) check_axis(*p.ignore_axis);
}

class Guide {
  public:
    /// What the proxy may move in a millisecond besides following the HIP [m]. With it the force
    /// changes by K (|dx| + 2e-5 m) at most, the part of the pull included.
    static constexpr double give = 0.95e-5;
    /// Inner steps of a tick's search for the nearest place of the whole curve, and pieces that it
    /// goes along: less than 0.2 ms of each.
    static constexpr std::int64_t max_steps = 8000;
    static constexpr std::size_t max_pieces = 2000;

    /// One curve through `n` points [m], x y z of each in turn.
    Guide(const double* xyz, std::size_t n, bool closed, const GuideParameters& p)
        : Guide(xyz, std::vector{n}, std::vector{closed}, p) {}

    /// Several curves, one after the other in `xyz`: strand i has counts[i] points.
    Guide(const double* xyz, const std::vector<std::size_t>& counts,
          const std::vector<bool>& closed, const GuideParameters& p)
        : Guide(p) {
        for (std::size_t i = 0; i < counts.size(); xyz += 3 * counts[i++]) {
            check_coordinates(xyz, counts[i]);
            std::vector<Vec3> points(counts[i]);
            for (std::size_t k = 0; k < counts[i]; ++k) points[k] = seen_across(point_at(xyz, k));
            path_.add(points, closed.at(i));
        }
        check_tube();
    }

    /// Lines and arcs across p.ignore_axis, as they are.
    Guide(const std::vector<Stroke>& strokes, const GuideParameters& p) : Guide(p) {
        check(strokes);
        if (!p.ignore_axis) reject("lines and arcs need an ignore_axis: they are planar");
        for (const Stroke& s : strokes) {
            path_.add(s, *p.ignore_axis, p.radius / 2);
            for (std::size_t i = 0; i < s.bulges.size(); ++i)
                seen_across(point_at(s.vertices.data(), i));
        }
        check_tube();
    }

    /// The tip is at `hip` [m]. Takes the place nearest to it, and holds the tip as `hold` says.
    void reset(const Vec3& hip) noexcept {
        last_ = {};
        pull_ = {};
        speed_ = 0;
        is_placed_ = is_within_range(hip);
        if (!is_placed_) return;
        x_ = across(hip);
        search(p_.hold == Hold::at_once);
        if (is_held_) stretch_ = stretch_at(place_.at);
        last_.proxy = hip;
    }

    /// One servo loop.
    GuideStep step(const Vec3& hip) noexcept {
        if (!is_within_range(hip)) {
            GuideStep s = last_;
            s.status = Status::bad_hip;
            return s;
        }
        if (!is_placed_) reset(hip);
        const Vec3 before = x_;
        x_ = across(hip);
        const double moved = norm(x_ - before);
        last_.status = Status::ok;
        if (is_held_ && is_beyond_end()) {
            is_held_ = false;
            distance_to_tube_ = 0;
        }
        if (is_held_)
            follow_hip(moved + step_allowance());
        else
            decay_force(moved);
        lead(before);
        last_.force = p_.stiffness * stretch_ + pull_;
        last_.proxy = hip + stretch_;
        last_.arc = path_[place_.piece].arc(place_.at);
        last_.lateral = norm(x_ - place_.at);
        last_.remaining = std::max(0.0, strand().length - last_.arc);
        last_.strand = static_cast<std::uint32_t>(place_.strand);
        last_.held = is_held_;
        return last_;
    }

    /// The curve across an ignored axis, and what the given points have along it, on average.
    const Path& path() const noexcept { return path_; }
    const Vec3& along_axis() const noexcept { return along_axis_; }
    const GuideParameters& parameters() const noexcept { return p_; }

  private:
    explicit Guide(const GuideParameters& p) : p_(p) { check(p); }

    void check_tube() {
        if (path_.size() == 0) reject("a guide needs a curve");
        path_.finish();
        const auto text = [](double metres) { return shown(1e3 * metres); };
        const std::string asked = "radius " + text(p_.radius) + " mm: at most ";
        const auto place = [&](const TubeObstacle& obstacle) {
            const Vec3 at = obstacle.at + along_axis_;
            return " at arc " + text(obstacle.arc) + " mm, [" + text(at[0]) + ", " + text(at[1]) +
                   ", " + text(at[2]) + "] mm";
        };
        const double extent = path_.extent();
        if (p_.radius > extent)
            reject(asked + text(extent) + " mm, the extent of the curve itself");
        const TubeObstacle obstacle = narrowest(path_, p_.radius);
        if (obstacle.found) {
            std::string why = "strands run beside each other";
            if (obstacle.turn) why = "the curve turns round";
            reject(asked + text(widest(path_, p_.radius, narrowest)) + " mm fit, as " + why +
                   " within " + text(obstacle.width) + " mm" + place(obstacle));
        }
        if (p_.cut_bends) return;
        const TubeObstacle bend = tight_bend(path_, p_.radius);
        if (bend.found)
            reject(asked + text(widest(path_, p_.radius, tight_bend)) +
                   " mm fit the bends, unless the tip may cut them (cut_bends); the tightest is" +
                   place(bend));
    }

    /// A given point across an ignored axis.
    Vec3 seen_across(const Vec3& x) {
        const Vec3 seen = across(x);
        along_axis_ += (1 / ++given_) * (x - seen - along_axis_);
        return seen;
    }
    Vec3 across(const Vec3& x) const noexcept {
        return p_.ignore_axis ? vfplan::across(x, *p_.ignore_axis) : x;
    }
    const Strand& strand() const noexcept { return path_.strands()[place_.strand]; }
    /// What the stretch may change in a tick besides following the HIP [m]. A pull takes the other
    /// half of it.
    double step_allowance() const noexcept {
        return (p_.lead_force == 0 ? 2 : 1) * give * (p_.period / 1e-3);
    }

    /// Proxy less HIP when the place is c: the shortest way into the ball of the radius of the tube
    /// around c.
    Vec3 stretch_at(const Vec3& c) const noexcept {
        const Vec3 v = x_ - c;
        const double d = norm(v);
        return d > p_.radius ? (p_.radius / d - 1) * v : Vec3{};
    }

    /// Moves the place along the curve while that brings it nearer to the HIP, as far as the
    /// stretch may change. Where the place stays, it changes by no more than the HIP moves.
    void follow_hip(double allowed) noexcept {
        int side = 0;  // of the last piece, on which the place left it
        for (std::size_t n = 0; n <= std::min(path_.size(), max_pieces); ++n) {
            const Piece& piece = path_[place_.piece];
            const Piece::PieceDescent foot = piece.descend(x_, place_.at);
            const Vec3 next = stretch_at(foot.at);
            if (norm(next - stretch_) > allowed) return move_partly(piece, foot.at, allowed);
            place_.at = foot.at;
            if (foot.side == 0 || foot.side == -side) break;
            const std::size_t next_piece = path_.next_piece(strand(), place_.piece, foot.side);
            if (next_piece == Path::none) break;
            Vec3 ahead = path_[next_piece].leaving;
            if (foot.side > 0) ahead = path_[next_piece].entering;
            if (!(foot.side * dot(x_ - place_.at, ahead) > 0)) break;
            place_.piece = next_piece;
            side = foot.side;
        }
        stretch_ = stretch_at(place_.at);
    }
    /// Moves the place as far towards `goal` on the piece as the stretch may change.
    void move_partly(const Piece& piece, const Vec3& goal, double allowed) noexcept {
        constexpr int halvings = 30;  // to 1e-9 of the way
        double allowed_share = 0;
        double refused_share = 1;
        for (int n = 0; n < halvings; ++n) {
            const double middle = 0.5 * (allowed_share + refused_share);
            const Vec3 next = stretch_at(piece.between(place_.at, goal, middle));
            if (norm(next - stretch_) <= allowed)
                allowed_share = middle;
            else
                refused_share = middle;
        }
        place_.at = piece.between(place_.at, goal, allowed_share);
        stretch_ = stretch_at(place_.at);
        last_.status = Status::limit;
    }

    /// While the tip is not held, what is left of the stretch dies down, and the proxy comes nearer
    /// to the HIP in every tick. The tip is held again once it is within the tube.
    void decay_force(double moved) noexcept {
        const double left = norm(stretch_);
        const double decay = moved + step_allowance();
        stretch_ = left > decay ? (1 - decay / left) * stretch_ : Vec3{};
        distance_to_tube_ -= moved;
        if (distance_to_tube_ <= 0) search(false);
        if (is_held_) stretch_ = {};
    }
    /// Takes the nearest place of the whole curve. The tip is held there if it is within the tube,
    /// or in any case if `at_once`. In the middle of a circle all places are as near: after so many
    /// steps it takes the nearest that it has seen, and the next tick searches again.
    void search(bool at_once) noexcept {
        WorkBudget look(max_steps);
        place_ = path_.nearest(x_, &look);
        const bool is_in_tube = place_.distance <= p_.radius;
        is_held_ = at_once || (is_in_tube && norm(stretch_) == 0 && !is_beyond_end());
        distance_to_tube_ = look.is_spent() ? 0 : place_.distance - p_.radius;
    }
    /// Whether the place is at an end that lets the tip go, and the HIP is past it.
    bool is_beyond_end() const noexcept {
        if (p_.ends == Ends::stop || strand().closed) return false;
        const Piece& first = path_[strand().first];
        const Piece& last = path_[strand().first + strand().count - 1];
        return (place_.at == first.from && dot(x_ - place_.at, first.entering) < 0) ||
               (place_.at == last.to && dot(x_ - place_.at, last.leaving) > 0);
    }

    /// Pulls along the curve, with a force that falls to 0 at the speed limit and at the end of the
    /// curve.
    void lead(const Vec3& before) noexcept {
        if (p_.lead_force == 0) return;
        // How fast the tip goes along the curve, averaged over this time [s].
        constexpr double settling = 0.01;
        const Vec3 tangent = path_[place_.piece].tangent(place_.at);
        const double speed = dot(x_ - before, tangent) / p_.period;
        speed_ += (speed - speed_) * std::min(1.0, p_.period / settling);

        // How fast it goes where it is led to, and how far the end is.
        const bool is_ahead = p_.lead_force > 0;
        const double speed_ahead = is_ahead ? speed_ : -speed_;
        const double way_left = is_ahead ? last_.remaining : last_.arc;
        double force = 0;
        if (is_held_ && (strand().closed || way_left > p_.radius))
            force = p_.lead_force * std::clamp(1 - speed_ahead / p_.lead_speed, 0.0, 1.0);
        const Vec3 wanted = force * tangent;

        // The pull grows at a quarter of the rate at which it falls, so that a light arm does not
        // overshoot the speed limit.
        double max_change = p_.stiffness * give * (p_.period / 1e-3);
        if (norm(wanted) > norm(pull_)) max_change *= 0.25;
        pull_ += shortened(wanted - pull_, max_change);
    }

    GuideParameters p_;
    Path path_;
    Vec3 along_axis_;
    double given_ = 0;  // number of points, of which that is the mean
    GuideStep last_;
    Vec3 x_;                       // the HIP, across an ignored axis
    Vec3 stretch_;                 // proxy less HIP [m]
    Vec3 pull_;                    // along the curve [N]
    Path::PathPlace place_;        // of the curve; `distance` where it was searched for last
    double distance_to_tube_ = 0;  // while not held: the HIP has to go as far at least [m]
    double speed_ = 0;             // of the HIP along the curve [m/s]
    bool is_placed_ = false;
    bool is_held_ = false;
};

}  // namespace vfplan::inline v1
