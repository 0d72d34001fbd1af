// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The drawn curve as a ruler: the tip is kept within a tube around it, or led along it.
//
//     vfplan::GuideParameters p;
//     p.radius = 1e-3;                                    // of the tube [m]
//     vfplan::Guide guide(xyz, n, false, p);              // throws std::invalid_argument
//     for (;;) force = guide.step(hip).force;             // never allocates, throws, locks, waits
//
// The guide keeps its place on the curve and moves it by descent of the distance, never by a search
// among all of it: where strands run close by or cross, it stays on its own.
#pragma once

#include <cstdint>
#include <cstdio>
#include <optional>

#include "vfplan/cloud/points.hpp"
#include "vfplan/curve/tube.hpp"
#include "vfplan/parameters.hpp"

namespace vfplan {

/// What an open curve's ends do.
enum class Ends {
    stop,  ///< a cap closes the tube
    open   ///< the tip goes free there; the force that was left dies down without giving energy
};
/// When the guide takes hold of the tip.
enum class Hold {
    at_once,  ///< at the first tick, with whatever force that takes
    on_entry  ///< once the tip is within the tube: no force before
};

struct GuideParameters {
    double radius = 1e-3;     ///< rho, of the tube [m]
    double stiffness = 1000;  ///< K beyond it [N/m]
    Ends ends = Ends::stop;
    Hold hold = Hold::at_once;
    bool cut_bends = false;           ///< takes bends that are tighter than the tube is wide
    std::optional<Vec3> ignore_axis;  ///< unit vector along which curve and tube are infinite
    double lead_force = 0;            ///< pull along the curve [N]; below 0: towards its beginning
    double lead_speed = 0.02;         ///< at which the pull has fallen to 0 [m/s]
    double period = 1e-3;             ///< of a tick, for that speed [s]
};

struct GuideStep {
    Vec3 proxy;            ///< nearest place of the tube [m]; the HIP's own where it is free
    Vec3 force;            ///< on the hand [N]
    double arc = 0;        ///< of the place on its strand [m]
    double lateral = 0;    ///< HIP to place [m]
    double remaining = 0;  ///< from the place to the strand's end [m]
    std::uint32_t strand = 0;
    bool held = false;         ///< the guide has hold of the tip
    std::uint8_t status = ok;  ///< bad_hip; limit: the place goes on next tick
};

/// Throws std::invalid_argument on a value outside its range.
inline void check(const GuideParameters& p) {
    check_from("radius", p.radius, smallest_radius, largest_radius, " m");
    check_above("stiffness", p.stiffness, 0, unbounded, " N/m");
    if (!std::isfinite(p.lead_force))
        reject("lead_force " + shown(p.lead_force) + " N: allowed is a finite force");
    check_above("lead_speed", p.lead_speed, 0, unbounded, " m/s");
    check_above("period", p.period, 0, unbounded, " s");
    if (p.ignore_axis) check_axis(*p.ignore_axis);
}

class Guide {
  public:
    /// What the proxy may lag behind the HIP's own motion in a tick [m]: the force changes by
    /// K (|dx| + 2e-5 m) at most, the pull's part included.
    static constexpr double give = 0.95e-5;

    /// One curve through `n` points [m], x y z of each in turn.
    Guide(const double* xyz, std::size_t n, bool closed, const GuideParameters& p) : Guide(p) {
        add(xyz, n, closed);
        check_tube();
    }

    /// Several curves, one after the other in `xyz`: strand i has counts[i] points.
    Guide(const double* xyz, const std::vector<std::size_t>& counts,
          const std::vector<bool>& closed, const GuideParameters& p)
        : Guide(p) {
        for (std::size_t i = 0; i < counts.size(); xyz += 3 * counts[i++])
            add(xyz, counts[i], closed.at(i));
        check_tube();
    }

    /// Lines and arcs across p.ignore_axis, as they are.
    Guide(const std::vector<Stroke>& strokes, const GuideParameters& p) : Guide(p) {
        check(strokes);
        if (!p.ignore_axis) reject("lines and arcs need an ignore_axis: they are planar");
        for (const Stroke& s : strokes) path_.add(s, *p.ignore_axis, p.radius / 2);
        check_tube();
    }

    /// The tip is at `hip` [m]: take the nearest place, and hold it as `hold` says.
    void reset(const Vec3& hip) noexcept {
        last_ = {};
        pull_ = {};
        speed_ = 0;
        placed_ = good(hip);
        if (!placed_) return;
        x_ = across(hip);
        search(p_.hold == Hold::at_once);
        if (held_) stretch_ = stretch_at(at_);
        last_.proxy = hip;
    }

    /// One servo loop.
    GuideStep step(const Vec3& hip) noexcept {
        if (!good(hip)) {
            GuideStep s = last_;
            s.status = bad_hip;
            return s;
        }
        if (!placed_) reset(hip);
        const Vec3 before = x_;
        x_ = across(hip);
        const double moved = norm(x_ - before);
        last_.status = ok;
        if (held_ && beyond_end()) held_ = false, distance_to_tube_ = 0;
        held_ ? follow(moved + step_allowance()) : decay_force(moved);
        lead(before);
        last_.force = p_.stiffness * stretch_ + pull_;
        last_.proxy = hip + stretch_;
        report();
        return last_;
    }

    const Path& path() const noexcept { return path_; }
    const GuideParameters& parameters() const noexcept { return p_; }
    std::size_t bytes() const noexcept { return sizeof(*this) + path_.bytes(); }

  private:
    explicit Guide(const GuideParameters& p) : p_(p) { check(p); }

    void add(const double* xyz, std::size_t n, bool closed) {
        std::vector<Vec3> points(n);
        for (std::size_t i = 0; i < n; ++i) {
            const Vec3 x{{xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]}};
            if (!good(x)) reject("points must be finite, coordinates up to 1e6 m");
            points[i] = across(x);
        }
        path_.add(points, closed);
    }
    void check_tube() {
        if (path_.size() == 0) reject("a guide needs a curve");
        const auto text = [](double metres) {
            char digits[32];
            std::snprintf(digits, sizeof digits, "%.5g", 1e3 * metres);
            return std::string(digits);
        };
        const std::string asked = "radius " + text(p_.radius) + " mm: at most ";
        const auto place = [&](const TubeObstacle& n) {
            return " at arc " + text(n.arc) + " mm, [" + text(n.at[0]) + ", " + text(n.at[1]) +
                   ", " + text(n.at[2]) + "] mm";
        };
        if (const double most = path_.extent(); p_.radius > most)
            reject(asked + text(most) + " mm, the extent of the curve itself");
        if (const TubeObstacle n = narrowest(path_, p_.radius); n.found)
            reject(asked + text(widest(path_, p_.radius, narrowest)) + " mm fit, as " +
                   (n.turn ? "the curve turns round" : "strands run beside each other") +
                   " within " + text(n.width) + " mm" + place(n));
        if (p_.cut_bends) return;
        if (const TubeObstacle n = tight_bend(path_, p_.radius); n.found)
            reject(asked + text(widest(path_, p_.radius, tight_bend)) +
                   " mm fit the bends, unless the tip may cut them (cut_bends); the tightest is" +
                   place(n));
    }

    static bool good(const Vec3& x) noexcept {
        for (int k = 0; k < 3; ++k)
            if (!(std::abs(x[k]) <= largest_coordinate)) return false;
        return true;
    }
    Vec3 across(const Vec3& x) const noexcept {
        return p_.ignore_axis ? x - dot(*p_.ignore_axis, x) * *p_.ignore_axis : x;
    }
    const Strand& strand() const noexcept { return path_.strands()[strand_]; }
    double step_allowance() const noexcept { return p_.lead_force == 0 ? 2 * give : give; }

    /// Proxy less HIP when the place is c: to the ball of the tube's radius around it.
    Vec3 stretch_at(const Vec3& c) const noexcept {
        const Vec3 v = x_ - c;
        const double d = norm(v);
        return d > p_.radius ? (p_.radius / d - 1) * v : Vec3{};
    }

    /// Moves the place along the curve while that brings it nearer to the HIP, as far as the
    /// stretch may change. Where the place stays, it changes by no more than the HIP moves.
    void follow(double allowed) noexcept {
        int side = 0;
        for (std::size_t n = 0; n <= path_.size(); ++n) {
            const Piece& piece = path_[piece_];
            const Piece::PieceDescent foot = piece.descend(x_, at_);
            const Vec3 next = stretch_at(foot.at);
            if (norm(next - stretch_) > allowed) return move_partly(piece, foot.at, allowed);
            at_ = foot.at;
            if (foot.side == 0 || foot.side == -side) break;
            const std::size_t on = path_.next_piece(strand(), piece_, foot.side);
            if (on == Path::none) break;
            const Vec3& ahead = foot.side > 0 ? path_[on].entering : path_[on].leaving;
            if (!(foot.side * dot(x_ - at_, ahead) > 0)) break;
            piece_ = on;
            side = foot.side;
        }
        stretch_ = stretch_at(at_);
    }
    /// As far towards `goal` on the piece as the stretch may change.
    void move_partly(const Piece& piece, const Vec3& goal, double allowed) noexcept {
        double least = 0, most = 1;
        for (int n = 0; n < 30; ++n) {
            const double middle = 0.5 * (least + most);
            const Vec3 next = stretch_at(piece.between(at_, goal, middle));
            (norm(next - stretch_) <= allowed ? least : most) = middle;
        }
        at_ = piece.between(at_, goal, least);
        stretch_ = stretch_at(at_);
        last_.status = limit;
    }

    /// Not held: what is left of the stretch dies down, the proxy always coming nearer to the HIP,
    /// until the tip is within the tube again.
    void decay_force(double moved) noexcept {
        const double left = norm(stretch_), less = moved + step_allowance();
        stretch_ = left > less ? (1 - less / left) * stretch_ : Vec3{};
        distance_to_tube_ -= moved;
        if (distance_to_tube_ <= 0) search(false);
        if (held_) stretch_ = {};
    }
    /// The nearest place of all; held when `at_once` or within the tube.
    void search(bool at_once) noexcept {
        const Path::Place near = path_.nearest(x_);
        strand_ = near.strand;
        piece_ = near.piece;
        at_ = near.at;
        held_ = at_once || (near.distance <= p_.radius && norm(stretch_) == 0 && !beyond_end());
        distance_to_tube_ =
            near.distance - p_.radius;  // the HIP has to go that far to get into the tube
    }
    /// The place is at an end that lets the tip go, and the HIP is past it.
    bool beyond_end() const noexcept {
        if (p_.ends == Ends::stop || strand().closed) return false;
        const Piece &first = path_[strand().first],
                    &last = path_[strand().first + strand().count - 1];
        return (at_ == first.from && dot(x_ - at_, first.entering) < 0) ||
               (at_ == last.to && dot(x_ - at_, last.leaving) > 0);
    }

    /// A pull along the curve that falls to 0 at the speed limit and at the curve's end.
    void lead(const Vec3& before) noexcept {
        if (p_.lead_force == 0) return;
        constexpr double settling = 0.01;  // [s] over which the speed is averaged
        const Vec3 t = path_[piece_].tangent(at_);
        const double speed = dot(x_ - before, t) / p_.period;
        speed_ += (speed - speed_) * std::min(1.0, p_.period / settling);
        const double towards = p_.lead_force > 0 ? speed_ : -speed_;
        const double rest = p_.lead_force > 0 ? last_.remaining : last_.arc;
        const bool pulls = held_ && (strand().closed || rest > p_.radius);
        const double part = std::clamp(1 - towards / p_.lead_speed, 0.0, 1.0);
        const Vec3 wanted = (pulls ? p_.lead_force * part : 0.0) * t, change = wanted - pull_;
        // It grows more slowly than it falls, so that a light arm does not overshoot the limit.
        const double most = p_.stiffness * give * (norm(wanted) > norm(pull_) ? 0.25 : 1.0);
        const double size = norm(change);
        pull_ = pull_ + (size > most ? most / size : 1.0) * change;
    }

    void report() noexcept {
        last_.arc = path_[piece_].arc(at_);
        last_.lateral = norm(x_ - at_);
        last_.remaining = std::max(0.0, strand().length - last_.arc);
        last_.strand = static_cast<std::uint32_t>(strand_);
        last_.held = held_;
    }

    GuideParameters p_;
    Path path_;
    GuideStep last_;
    Vec3 x_, at_;          // HIP and place, across an ignored axis
    Vec3 stretch_, pull_;  // proxy less HIP [m], pull along the curve [N]
    std::size_t strand_ = 0, piece_ = 0;
    double distance_to_tube_ =
        0;              // while not held: how far the HIP has to go at least to get into the tube
    double speed_ = 0;  // of the HIP along the curve [m/s]
    bool placed_ = false, held_ = false;
};

}  // namespace vfplan
