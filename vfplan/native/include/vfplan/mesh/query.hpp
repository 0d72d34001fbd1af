// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Steps among triangles: what a straight one meets first, and the planes that it then keeps to.
//
// All that lies nearer to a triangle than R is convex. Where a path first meets it, a plane parts
// the two. A triangle behind a plane needs none of its own, so that coplanar neighbours are one.
#pragma once

#include "vfplan/mesh/triangles.hpp"
#include "vfplan/rules/half_spaces.hpp"

namespace vfplan::inline v1::mesh {

/// Triangle i is met after the part t of a step, where `foot` is its nearest place.
struct TriangleHit {
    double t = 1;
    std::uint32_t i = Mesh::none;
    Vec3 normal, foot;
};

/// The planes that a step from one place keeps to.
class ContactPlanes {
  public:
    static constexpr int max_planes = 8;
    /// Square of the angle between two planes below which they count as parallel.
    static constexpr double flattest = 1e-14;

    ContactPlanes(double radius, double band) noexcept : R_(radius), band_(band) {}

    void clear() noexcept { count_ = 0; }
    int count() const noexcept { return count_; }
    /// The triangle that plane j was made of.
    std::uint32_t triangle(int j) const noexcept { return triangle_[j]; }
    const Vec3& normal(int j) const noexcept { return plane_[j].normal; }
    /// How far x is from what lies behind plane j [m].
    double height(int j, const Vec3& x) const noexcept {
        return dot(plane_[j].normal, x) - level_[j];
    }
    /// The part of the way to the HIP after which the step met the first of them.
    double first_met() const noexcept { return first_met_; }

    /// Adds the plane of what a step from x has met, and turns the step to the one nearest to the
    /// HIP that keeps to all planes. False, and the step as it was, where there is none.
    bool turn(const Vec3& x, const Vec3& to_hip, const TriangleHit& hit, Vec3& step) noexcept {
        if (count_ == max_planes) return false;
        if (count_ == 0) first_met_ = hit.t;
        for (int j = 0; j < count_; ++j)
            if (triangle_[j] == hit.i && dot(plane_[j].normal, hit.normal) > 1 - 1e-12)
                return false;
        triangle_[count_] = hit.i;
        level_[count_] = dot(hit.normal, hit.foot);
        plane_[count_] = {hit.normal, R_ - dot(hit.normal, x - hit.foot)};
        ++count_;
        const Vec3 turned = nearest_step(to_hip, plane_, count_, band_ / 16, flattest);
        if (!(dot(turned, turned) > 0) && !detail::keeps_to(turned, plane_, count_, band_ / 16)) {
            --count_;
            return false;
        }
        step = turned;
        return true;
    }

    /// Whether a triangle lies behind a plane, so that no step that keeps to that plane meets it.
    bool hide(const Triangle& t) const noexcept {
        for (int j = 0; j < count_; ++j)
            if (t.extent_along(plane_[j].normal) <= level_[j] + band_ / 4) return true;
        return false;
    }
    /// Whether one of the planes parts x from all that lies nearer than about R to a triangle.
    bool part(const Vec3& x, const Triangle& t) const noexcept {
        return std::any_of(plane_, plane_ + count_, [&](const ContactPlane<3>& plane) {
            return dot(plane.normal, x) - t.extent_along(plane.normal) >= R_ - band_ / 2;
        });
    }

  private:
    double R_, band_;
    ContactPlane<3> plane_[max_planes];
    double level_[max_planes] = {};  // along its normal, of what lies behind a plane [m]
    std::uint32_t triangle_[max_planes] = {};
    int count_ = 0;
    double first_met_ = 0;
};

/// What of a mesh lies near the proxy and in its way. It counts the inner steps that a tick takes.
class TriangleQuery {
  public:
    /// The beginning of a step is looked at first [R].
    static constexpr double beginning = 0.05;
    /// How far is looked around a place at most [R].
    static constexpr double reach = 1.2;

    TriangleQuery(Mesh mesh, double radius, double band)
        : mesh_(std::move(mesh)), R_(radius), band_(band), lowest_(radius - band / 2) {}
    const Mesh& mesh() const noexcept { return mesh_; }

    /// The inner steps that a tick, and a part of it, may still take.
    WorkBudget& budget() const noexcept { return budget_; }
    /// One nearest step to so many planes: eight inner steps for each choice of at most three.
    void spend_on_planes(int n) const noexcept { budget_.spend(8 * plane_choices<3>(n)); }

    /// Whether x + t v comes nearer to triangle i than roundings take, before hit.t. The distance
    /// from it is convex along the path: Newton's method goes up to the meeting, never beyond.
    bool meets(std::uint32_t i, const Vec3& x, const Vec3& v, TriangleHit& hit) const noexcept {
        constexpr int max_iterations = 24;
        const Triangle& triangle = mesh_[i];
        double t = 0;
        for (int k = 1; k <= max_iterations; ++k) {
            const Vec3 y = x + t * v;
            const Vec3 foot = triangle.nearest(y);
            const Vec3 w = y - foot;
            budget_.spend(3);
            const double r = norm(w);
            const double slope = dot(w, v);
            const double over = r - lowest_;
            if (!(slope < 0)) return false;
            const bool is_last = k == max_iterations || (k > 1 && budget_.is_overdrawn());
            if (over <= band_ / 16 || is_last) {
                hit = {t, i, (1 / r) * w, foot};
                return true;
            }
            t -= over * r / slope;
            if (!(t < hit.t)) return false;
        }
        return false;
    }

    /// What the step v from x meets first, behind no plane, or something before it where the tick
    /// has done enough. Where it has no steps left to look on, `t` without a triangle is how much
    /// is free.
    TriangleHit sweep(const Vec3& x, const Vec3& v, const ContactPlanes& planes) const noexcept {
        TriangleHit hit;
        const double length = norm(v);
        const double first = beginning * R_;
        if (!(length > 0)) return hit;
        double free = 0;
        for (hit.t = length > first ? first / length : 1;; hit.t = 1) {
            const double all = hit.t;
            const double half = R_ + all * length / 2;
            const Vec3 middle = x + (all / 2) * v;
            const auto is_cut_short = [&] {
                return free > 0 ? budget_.is_overdrawn() : budget_.is_over();
            };
            mesh_.tree().visit(
                [&](const Disc& disc) noexcept {
                    budget_.spend(1);
                    if (is_cut_short()) return false;
                    const Vec3 w = disc.middle - x;
                    const double share = dot(w, v) / (length * length);
                    const double reach_of_disc = R_ + disc.size();
                    const Vec3 sideways = w - std::min(std::max(share, 0.0), hit.t) * v;
                    return dot(sideways, sideways) <= reach_of_disc * reach_of_disc &&
                           disc.distance2(middle) <= half * half;
                },
                [&](std::uint32_t i) noexcept {
                    if (is_cut_short()) return;
                    const bool is_late = budget_.is_overdrawn();
                    budget_.spend(3);
                    if (is_late || !planes.hide(mesh_[i])) meets(i, x, v, hit);
                });
            if (is_cut_short()) return {free, Mesh::none, {}, {}};
            if (hit.i != Mesh::none || all == 1) return hit;
            free = all;
        }
    }

    /// The triangle nearest to y, or none where all are `distance` [m] away, which becomes its
    /// distance. Triangles that planes which touch y part from it are left out, as they are no
    /// nearer than the planes are.
    std::uint32_t nearest(const Vec3& y, double& distance,
                          const ContactPlanes& planes) const noexcept {
        std::uint32_t found = Mesh::none;
        const auto look = [&](std::uint32_t i) noexcept {
            if (const double d = mesh_[i].distance(y); d < distance) distance = d, found = i;
        };
        for (int j = 0; j < planes.count(); ++j) look(planes.triangle(j));
        const bool touches = distance <= R_ + band_;
        budget_.spend(3 * planes.count() +
                      mesh_.tree().around(y, distance, [&](std::uint32_t i) noexcept {
                          if (!(touches && planes.part(y, mesh_[i]))) look(i);
                      }));
        return found;
    }
    std::uint32_t nearest(const Vec3& y, double& distance) const noexcept {
        return nearest(y, distance, ContactPlanes(R_, band_));
    }
    /// Whether f(i) holds for a triangle within `reach` of y, or for another one near there; true
    /// also where the tick has no steps left to look on.
    template <class F>
    bool finds(const Vec3& y, double reach, F&& f) const noexcept {
        bool found = false;
        mesh_.tree().visit(
            [&](const Disc& disc) noexcept {
                budget_.spend(1);
                found = found || budget_.is_spent();
                return !found && disc.distance2(y) <= reach * reach;
            },
            [&](std::uint32_t i) noexcept {
                budget_.spend(3);
                found = found || f(i);
            });
        return found;
    }

  private:
    Mesh mesh_;
    double R_, band_, lowest_;
    mutable WorkBudget budget_;
};

}  // namespace vfplan::inline v1::mesh
