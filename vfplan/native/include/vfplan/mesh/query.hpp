// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Steps among triangles: what a straight one meets first, and the walls that it then keeps to.
//
// All that lies nearer to a triangle than R is convex. Where a way first meets it, a plane parts
// the two: a wall. A triangle behind a wall needs none of its own, so that coplanar neighbours are
// one.
#pragma once

#include "vfplan/base/half_spaces.hpp"
#include "vfplan/mesh/triangles.hpp"

namespace vfplan::mesh {

/// Triangle i is met after the part t of a step, where `at` is its nearest place.
struct Hit {
    double t = 1;
    std::uint32_t i = Mesh::none;
    Vec3 normal, at;
};

/// The walls of a step from one place.
class Walls {
  public:
    static constexpr int most = 8;
    static constexpr double flattest = 1e-14;  // of two walls: the square of the angle between

    Walls(double radius, double band) noexcept : R_(radius), band_(band) {}

    void clear() noexcept { count_ = 0; }
    int count() const noexcept { return count_; }
    std::uint32_t on(int j) const noexcept { return on_[j]; }
    const Vec3& normal(int j) const noexcept { return wall_[j].n; }
    /// How far x is from what lies behind it.
    double height(int j, const Vec3& x) const noexcept { return dot(wall_[j].n, x) - level_[j]; }
    /// The part of the way towards the HIP at which it met the first.
    double met() const noexcept { return met_; }

    /// Another wall of steps from x, and the one nearest to u that keeps to all; false, and v as it
    /// was, where there is none.
    bool turn(const Vec3& x, const Vec3& u, const Hit& hit, Vec3& v) noexcept {
        if (count_ == most) return false;
        if (count_ == 0) met_ = hit.t;
        for (int j = 0; j < count_; ++j)
            if (on_[j] == hit.i && dot(wall_[j].n, hit.normal) > 1 - 1e-12) return false;
        on_[count_] = hit.i;
        level_[count_] = dot(hit.normal, hit.at);
        wall_[count_] = {hit.normal, R_ - dot(hit.normal, x - hit.at)};
        ++count_;
        const Vec3 w = project(u, wall_, count_, band_ / 16, flattest);
        const bool done = dot(w, w) > 0 || detail::keeps(w, wall_, count_, band_ / 16);
        if (done)
            v = w;
        else
            --count_;
        return done;
    }

    /// Whether a triangle lies behind a wall, so that no step that keeps to that wall meets it.
    bool hide(const Triangle& t) const noexcept {
        for (int j = 0; j < count_; ++j)
            if (t.reaches(wall_[j].n) <= level_[j] + band_ / 4) return true;
        return false;
    }
    /// Whether one of them parts x from all that lies nearer than about R to a triangle.
    bool part(const Vec3& x, const Triangle& t) const noexcept {
        for (int j = 0; j < count_; ++j)
            if (dot(wall_[j].n, x) - t.reaches(wall_[j].n) >= R_ - band_ / 2) return true;
        return false;
    }

  private:
    double R_, band_;
    Wall<3> wall_[most];
    double level_[most] = {};  // along its normal, of what lies behind a wall
    std::uint32_t on_[most] = {};
    int count_ = 0;
    double met_ = 0;
};

/// What of a mesh lies near the proxy and on its way.
class Near {
  public:
    static constexpr double beginning = 0.05;  // of a step: of R
    static constexpr double reach = 1.2;       // of R: how far is looked around a place at most

    Near(Mesh mesh, double radius, double band)
        : mesh_(std::move(mesh)), R_(radius), band_(band), low_(radius - band / 2) {}
    const Mesh& mesh() const noexcept { return mesh_; }

    /// Inner steps that a part of a tick may take from now on. One that has begun to look through
    /// the mesh looks on to the end: what it finds holds.
    void grant(int steps) const noexcept { left_ = steps; }
    void take(int steps) const noexcept { left_ -= steps; }
    /// One projection on so many walls: eight for each choice of three at most.
    void take_walls(int n) const noexcept {
        take(8 * (n + n * (n - 1) / 2 + n * (n - 1) * (n - 2) / 6));
    }
    bool spent() const noexcept { return left_ <= 0; }
    std::size_t bytes() const noexcept { return mesh_.bytes(); }

    /// Whether x + t v comes nearer to triangle i than roundings take, before hit.t. The distance
    /// from it is convex along the way: Newton's method goes up to the meeting, never beyond.
    bool meets(std::uint32_t i, const Vec3& x, const Vec3& v, Hit& hit) const noexcept {
        constexpr int most = 24;
        const Triangle& triangle = mesh_[i];
        double t = 0;
        for (int k = 1; k <= most; ++k) {
            const Vec3 y = x + t * v, at = triangle.nearest(y), w = y - at;
            take(3);
            const double r = norm(w), slope = dot(w, v), over = r - low_;
            if (!(slope < 0)) return false;
            if (over <= band_ / 16 || k == most) {
                hit = {t, i, (1 / r) * w, at};
                return true;
            }
            t -= over * r / slope;
            if (!(t < hit.t)) return false;
        }
        return false;
    }

    /// What the step v from x meets first, behind no wall. First looked at is its beginning.
    Hit sweep(const Vec3& x, const Vec3& v, const Walls& walls) const noexcept {
        Hit hit;
        const double length = norm(v), first = beginning * R_;
        if (!(length > 0)) return hit;
        for (hit.t = length > first ? first / length : 1;; hit.t = 1) {
            const double all = hit.t, half = R_ + all * length / 2;
            const Vec3 middle = x + (all / 2) * v;
            const int steps = mesh_.visit(
                [&](const Disc& disc) noexcept {
                    const Vec3 w = disc.middle - x;
                    const double share = dot(w, v) / (length * length), reach = R_ + disc.size();
                    const Vec3 off = w - std::min(std::max(share, 0.0), hit.t) * v;
                    return dot(off, off) <= reach * reach && disc.distance2(middle) <= half * half;
                },
                [&](std::uint32_t i) noexcept {
                    if (!walls.hide(mesh_[i])) meets(i, x, v, hit);
                });
            take(steps);
            if (hit.i != Mesh::none || all == 1) return hit;
        }
    }

    /// As Mesh::nearest, of the tick's steps.
    std::uint32_t nearest(const Vec3& y, double& least) const noexcept {
        int steps = 0;
        const auto found = mesh_.nearest(y, least, steps);
        take(steps);
        return found;
    }
    /// Distance from the mesh where that is less than about R, else some more [m]. What the proxy's
    /// walls part from it is not looked at: it is no nearer than they are.
    double nearest(const Vec3& x, const Walls& walls) const noexcept {
        double least = reach * R_;
        for (int j = 0; j < walls.count(); ++j)
            least = std::min(least, mesh_[walls.on(j)].distance(x));
        const bool touches = least <= R_ + band_;
        take(mesh_.around(x, least, [&](std::uint32_t i) noexcept {
            if (!(touches && walls.part(x, mesh_[i])))
                least = std::min(least, mesh_[i].distance(x));
        }));
        return least;
    }

  private:
    Mesh mesh_;
    double R_, band_, low_;
    mutable int left_ = 0;
};

}  // namespace vfplan::mesh
