// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Which surfaces touch the proxy, and the plane that each of them offers it. The numbers in
// brackets are the equations of docs/robust.md.
//
// The points that touch the proxy are sorted into surfaces (R1): points whose directions hang
// together belong to one surface, however it curves, and the walls of a corner do not hang
// together. The plane of a surface is that of a quadric fitted to the points around its foot (R2).
// A mean of directions, as in eq. (1) of the paper, leans towards wherever there are more points:
// away from a wall or a border. A fit does not, whether or not the sampling is even.
#pragma once

#include "vfplan/cloud/grid.hpp"
#include "vfplan/rules/half_spaces.hpp"

namespace vfplan::inline v1 {

/// One surface that touches the proxy.
template <int D>
struct SurfaceContact {
    double nearest_distance = 0;  ///< of its nearest point [m]
    Vec<D> nearest_direction;     ///< unit vector from that point to the proxy
    Vec<D> mean_direction;  ///< unit mean of such vectors over its points, the nearer the heavier
};

/// Sorts the points that touch the proxy into surfaces. (R1)
template <int D>
class ContactGroups {
  public:
    static constexpr int max_groups = 6;
    /// Directions that are kept; further points join one of them.
    static constexpr int max_directions = 24;

    /// `touch_radius`: distance up to which a point touches [m]. `same_surface`: cosine of the
    /// angle within which two directions belong to one surface.
    ContactGroups(double touch_radius, double same_surface) noexcept
        : touch_radius_(touch_radius), same_surface_(same_surface) {}

    void clear() noexcept {
        direction_count_ = 0;
        count_ = 0;
    }
    int count() const noexcept { return count_; }
    const SurfaceContact<D>& operator[](int i) const noexcept { return contact_[i]; }

    /// Adds a point; `away` leads from it to the proxy. The order of up to `max_directions` points
    /// does not matter.
    void add(const Vec<D>& away) noexcept {
        const double r = norm(away);
        if (!(r > 0)) return;
        const Vec<D> direction = (1 / r) * away;
        const double depth = touch_radius_ - r;
        const SurfaceContact<D> point{r, direction, (depth * depth) * direction};
        if (direction_count_ == max_directions)
            return include(part_[most_similar(direction)], point);
        direction_[direction_count_] = direction;
        part_[direction_count_++] = point;
    }

    /// Joins the directions that hang together, and keeps the nearest groups.
    void group() noexcept {
        SurfaceContact<D> all[max_directions];
        int ungrouped[max_directions];
        int left = direction_count_;
        int groups = 0;
        for (int i = 0; i < left; ++i) ungrouped[i] = i;
        while (left > 0) {
            int chain[max_directions];
            int links = 1;
            chain[0] = ungrouped[--left];
            SurfaceContact<D>& group = all[groups++] = part_[chain[0]];
            for (int i = 0; i < links && left > 0; ++i) {
                for (int j = left - 1; j >= 0; --j) {
                    const double cosine = dot(direction_[chain[i]], direction_[ungrouped[j]]);
                    if (!(cosine > same_surface_)) continue;
                    chain[links++] = ungrouped[j];
                    include(group, part_[ungrouped[j]]);
                    ungrouped[j] = ungrouped[--left];
                }
            }
            const double length = norm(group.mean_direction);
            group.mean_direction =
                length > 0 ? (1 / length) * group.mean_direction : group.nearest_direction;
        }
        count_ = std::min(groups, max_groups);
        keep_nearest(all, groups);
        std::copy(all, all + count_, contact_);
    }

  private:
    /// Brings the nearest `count_` groups to the front, in order: a heap of the farthest takes in
    /// the others, then gives them back. Standard libraries differ where distances are equal.
    void keep_nearest(SurfaceContact<D>* all, int groups) noexcept {
        for (int k = count_ / 2 - 1; k >= 0; --k) sift(all, k, count_, all[k]);
        for (int k = count_; k < groups; ++k)
            if (all[k].nearest_distance < all[0].nearest_distance) sift(all, 0, count_, all[k]);
        for (int last = count_ - 1; last > 0; --last) {
            const SurfaceContact<D> moved = all[last];
            all[last] = all[0];
            sift(all, 0, last, moved);
        }
    }
    /// Puts `value` into the heap of `n` whose place `hole` is free: down to a leaf, then up.
    static void sift(SurfaceContact<D>* heap, int hole, int n, SurfaceContact<D> value) noexcept {
        const int top = hole;
        while (2 * hole + 1 < n) {
            int child = 2 * hole + 2;
            if (child == n || heap[child].nearest_distance < heap[child - 1].nearest_distance)
                --child;
            heap[hole] = heap[child];
            hole = child;
        }
        while (hole > top) {
            const int parent = (hole - 1) / 2;
            if (!(heap[parent].nearest_distance < value.nearest_distance)) break;
            heap[hole] = heap[parent];
            hole = parent;
        }
        heap[hole] = value;
    }
    static void include(SurfaceContact<D>& whole, const SurfaceContact<D>& part) noexcept {
        whole.mean_direction = whole.mean_direction + part.mean_direction;
        if (part.nearest_distance < whole.nearest_distance) {
            whole.nearest_distance = part.nearest_distance;
            whole.nearest_direction = part.nearest_direction;
        }
    }
    /// A kept direction of the surface that this one belongs to, or else the nearest.
    int most_similar(const Vec<D>& direction) const noexcept {
        int best = 0;
        double best_cosine = -2;
        for (int i = 0; i < direction_count_ && !(best_cosine > same_surface_); ++i) {
            const double cosine = dot(direction, direction_[i]);
            if (cosine > best_cosine) {
                best_cosine = cosine;
                best = i;
            }
        }
        return best;
    }

    double touch_radius_, same_surface_;
    Vec<D> direction_[max_directions];
    SurfaceContact<D> part_[max_directions];  // their `mean_direction` is a sum, not of unit length
    SurfaceContact<D> contact_[max_groups];
    int direction_count_ = 0;
    int count_ = 0;
};

/// A quadric fitted to the points around the foot of the proxy.
template <int D>
struct QuadricFit {
    Vec<D> normal;           ///< unit vector
    double foot_offset = 0;  ///< from the foot to the centre of the points [radii of the fit]
    /// Second derivatives of the depth below the proxy along ss (tt, st); above 0 on a bulge
    /// [1 / radius of the fit].
    double curvature[D == 2 ? 1 : 3] = {};
};

/// Turns the slopes of a quadric right under the proxy into those at its foot, where the normal
/// goes through the proxy: m -> (1 + 2 h Q)^-1 m for curvatures Q and height h.
template <int D>
void slopes_at_foot(double* x, double h) noexcept {
    constexpr double smallest = tuned::narrowest_hollow;
    if constexpr (D == 2) {
        x[1] /= std::max(1 + 2 * h * x[2], smallest);
    } else {
        const double a = 1 + 2 * h * x[3];
        const double b = 1 + 2 * h * x[4];
        const double c = h * x[5];
        const double det = a * b - c * c;
        if (!(a > smallest && b > smallest && det > smallest * smallest)) return;
        const double s = (b * x[1] - c * x[2]) / det;
        const double t = (a * x[2] - c * x[1]) / det;
        x[1] = s;
        x[2] = t;
    }
}

/// Solves the normal equations for the quadric that lies over the window. Across a direction in
/// which the points do not extend, as along a curve in space, the normal stays `window.up`. (R2)
template <int D>
QuadricFit<D> fit_quadric(const FitWindow<D>& window, const NormalEquations<D>& sums) noexcept {
    constexpr int terms = NormalEquations<D>::terms;
    const double weight = sums.a[0];
    if (!(weight > 0)) return {window.up};
    // The lower triangle of the normal equations.
    double l[terms][terms] = {};
    for (int r = 0, n = 0; r < terms; ++r)
        for (int c = r; c < terms; ++c, ++n) l[c][r] = sums.a[n];
    // Ridges: a slope counts only if the points show it, a curvature only if they need it. The
    // mixed term counts half, so that the turn of the frame does not matter.
    for (int r = 1; r < terms; ++r) {
        double ridge = tuned::curvature_ridge;
        if (r < D) ridge = tuned::slope_ridge;
        if (r == 5) ridge = 0.5 * tuned::curvature_ridge;
        l[r][r] += weight * ridge;
    }
    double x[terms];
    std::copy_n(sums.z, terms, x);
    solve_symmetric(l, x);
    for (int r = 0; r < terms; ++r)
        if (!(l[r][r] > 0)) return {window.up};
    // From right under the proxy to the foot.
    const double height = window.height * window.scale;
    slopes_at_foot<D>(x, height);
    Vec<D> normal = window.up;
    double offset2 = 0;
    for (int k = 0; k < D - 1; ++k) {
        normal = normal - x[1 + k] * window.side[k];
        const double offset = sums.a[1 + k] / weight + height * x[1 + k];
        offset2 += offset * offset;
    }
    if constexpr (D == 2) return {along(normal, 1), std::sqrt(offset2), {2 * x[2]}};
    if constexpr (D == 3) return {along(normal, 1), std::sqrt(offset2), {2 * x[3], 2 * x[4], x[5]}};
}

/// The normal where it tilts no more than the angle of sine `max_tilt` from the unit vector `axis`.
/// From twice that on it is `axis` itself, for then the proxy rests on an edge and not on a
/// surface; between the two it goes over gradually.
template <int D>
Vec<D> limit_tilt(const Vec<D>& normal, const Vec<D>& axis, double max_tilt) noexcept {
    const double cosine = dot(normal, axis);
    const Vec<D> sideways = normal - cosine * axis;
    const double sine = norm(sideways);
    if (cosine > 0 && sine <= max_tilt) return normal;
    if (!(cosine > 0) || sine >= 2 * max_tilt) return axis;
    const double s = 2 * max_tilt - sine;
    return std::sqrt(1 - s * s) * axis + (s / sine) * sideways;
}

/// The surfaces that touch the proxy and the steps that keep to them.
template <int D>
class ContactSurfaces {
  public:
    static constexpr int max_surfaces = ContactGroups<D>::max_groups;

    ContactSurfaces(double radius, double band) noexcept
        : R_(radius),
          max_lift_(tuned::max_lift_bands * band),
          touch_radius_(R_ + max_lift_),
          g_(std::sqrt(band / R_)),
          fit_radius_(std::min(tuned::fit_spacings * spacing(), tuned::max_fit_radius) * R_),
          max_tilt_(
              std::min(tuned::max_tilt * std::sqrt(2.0) * g_, tuned::max_same_surface_angle / 2)),
          groups_(touch_radius_, std::cos(std::min(tuned::same_surface_angle * g_,
                                                   tuned::max_same_surface_angle))) {}

    /// How far away the samples of a fit lie at most [m].
    double reach() const noexcept {
        return std::sqrt(touch_radius_ * touch_radius_ + fit_radius_ * fit_radius_);
    }
    /// How far away a point may be and still touch: R + 2 b [m].
    double touch_radius() const noexcept { return touch_radius_; }

    void forget() noexcept { known_at_.reset(); }
    /// Whether the last update was for x.
    bool is_known_at(const Vec<D>& x) const noexcept { return known_at_ == x; }
    int count() const noexcept { return count_; }
    const ContactPlane<D>* planes() const noexcept { return plane_; }
    const SurfaceContact<D>& contact(int j) const noexcept { return groups_[j]; }

    /// Finds the surfaces that touch the proxy, and the plane of each.
    void update(Neighbours<D>& neighbours, const Vec<D>& proxy) noexcept {
        if (is_known_at(proxy)) return;
        known_at_ = proxy;
        groups_.clear();
        WorkBudget& budget = neighbours.index().budget();
        visit_within(neighbours, proxy, touch_radius_, [&](const Vec<D>& away) noexcept {
            budget.spend(work::contact);
            groups_.add(away);
        });
        groups_.group();
        count_ = groups_.count();
        budget.spend(work::fit * count_);
        for (int j = 0; j < count_; ++j) plane_[j] = plane_of(neighbours, proxy, groups_[j]);
    }

    /// The step along the one surface that touches: on its plane to beside the place of its circle
    /// of curvature that is nearest to the HIP, which lies at `to_hip`. On a bulge it goes at most
    /// twice as far as to below the HIP, because a HIP behind the centre of the circle is nearer to
    /// no place of it than to the others. `plane`: the surface's own, with the lift that this step
    /// may take. (R3)
    Vec<D> slide(const Vec<D>& to_hip, const ContactPlane<D>& plane, double slack) const noexcept {
        const double depth = -dot(to_hip, plane.normal);
        if (!(depth + plane.lift > slack)) return to_hip;
        const Vec<D> tangential = to_hip + depth * plane.normal;
        const double length = norm(tangential);
        if (!(length > 0)) return plane.lift * plane.normal;
        const double curvature = curvature_along((1 / length) * tangential);
        const double along_normal = 1 - curvature * depth;
        const double sideways = curvature * length;
        // Not std::hypot, whose last bit differs among libraries.
        const double to_centre =
            along_normal > 0 ? std::sqrt(along_normal * along_normal + sideways * sideways) : 0;
        return plane.lift * plane.normal + (1 / std::max(to_centre, 0.5)) * tangential;
    }

    /// The step nearest to `to_hip` that keeps to every plane. Where it would not bring the proxy
    /// nearer to the HIP, and two planes face each other less than 2 R apart, it is the one along
    /// the middle between these. (R4)
    Vec<D> step(const Vec<D>& to_hip, double slack) const noexcept {
        const Vec<D> step = nearest_step(to_hip, plane_, count_, slack);
        if (norm(step - to_hip) < norm(to_hip)) return step;
        for (int i = 0; i < count_; ++i) {
            for (int j = 0; j < i; ++j) {
                const ContactPlane<D>& a = plane_[i];
                const ContactPlane<D>& b = plane_[j];
                const bool face_each_other = norm(a.normal + b.normal) <= 2 * max_tilt_;
                if (!(face_each_other && a.lift + b.lift > 0)) continue;
                const Vec<D> across = along(a.normal - b.normal, 1);
                const double middle = (a.lift - b.lift) / 2;
                ContactPlane<D> between[max_surfaces];
                std::copy(plane_, plane_ + count_, between);
                between[i] = {across, middle};
                between[j] = {-1.0 * across, -middle};
                return nearest_step(to_hip, between, count_, slack);
            }
        }
        return step;
    }

    /// Where all surfaces together push a proxy; 0 where none touches.
    Vec<D> normal(const Vec<D>& to_hip, double min_step, double slack) const noexcept {
        if (count_ == 0) return {};
        if (count_ == 1) return plane_[0].normal;
        const Vec<D> push = nearest_step(to_hip, plane_, count_, slack) - to_hip;
        if (norm(push) > min_step) return along(push, 1);
        Vec<D> sum;
        for (int j = 0; j < count_; ++j) sum = sum + plane_[j].normal;
        return along(sum, 1);
    }

  private:
    /// Spacing of the cloud whose dimples are as deep as the band [R].
    double spacing() const noexcept { return (D == 2 ? std::sqrt(8.0) : 2.0) * g_; }

    /// The plane that one group of touching points offers: its normal from a quadric fitted around
    /// the foot, and the height that is missing to R above its nearest point. (R2)
    ContactPlane<D> plane_of(Neighbours<D>& neighbours, const Vec<D>& proxy,
                             const SurfaceContact<D>& contact) noexcept {
        const FitWindow<D> window = fit_window(proxy, contact);
        NormalEquations<D> sums;
        neighbours.visit(proxy, std::sqrt(window.outer2), [&](const PointSpan<D>& points) noexcept {
            kernels<D>.accumulate_fit(points, window, sums);
        });
        const QuadricFit<D> fit = fit_quadric(window, sums);

        // 1 where samples surround the foot, 0 where they lie on one side of it: there the surface
        // ends, and the proxy turns round its rim.
        const double surrounded =
            std::clamp((tuned::one_sided_offset - fit.foot_offset) /
                           (tuned::one_sided_offset - tuned::surrounded_offset),
                       0.0, 1.0);

        ContactPlane<D> plane;
        plane.normal = limit_tilt(fit.normal, contact.mean_direction, surrounded * max_tilt_);
        remember_curvature(window, fit, surrounded, plane.normal == fit.normal);
        plane.lift =
            std::clamp(R_ - contact.nearest_distance * dot(contact.nearest_direction, plane.normal),
                       -max_lift_, max_lift_);
        return plane;
    }

    FitWindow<D> fit_window(const Vec<D>& proxy, const SurfaceContact<D>& contact) const noexcept {
        FitWindow<D> window;
        window.at = proxy;
        window.up = contact.mean_direction;
        tangent_frame(window.up, window.side);
        window.height = contact.nearest_distance;
        window.scale = 1 / fit_radius_;
        window.inner2 = contact.nearest_distance * contact.nearest_distance;
        window.outer2 = window.inner2 + fit_radius_ * fit_radius_;
        window.cosine2 = R_ * R_ / (R_ * R_ + 2 * fit_radius_ * fit_radius_);
        return window;
    }

    /// Keeps the curvature of the last surface for `slide`. Where the fit was not taken, no surface
    /// is known that could be curved.
    void remember_curvature(const FitWindow<D>& window, const QuadricFit<D>& fit, double surrounded,
                            bool is_fit_taken) noexcept {
        std::copy(window.side, window.side + (D - 1), side_);
        const bool is_known = surrounded > 0 && is_fit_taken;
        for (std::size_t k = 0; k < std::size(curvature_); ++k)
            curvature_[k] = is_known ? surrounded * fit.curvature[k] / fit_radius_ : 0;
    }
    /// Curvature of what lies R above the last surface, along a unit tangent; above 0 on a bulge
    /// [1/m].
    double curvature_along(const Vec<D>& tangent) const noexcept {
        const double s = dot(tangent, side_[0]);
        double k = curvature_[0] * s * s;
        if constexpr (D == 3) {
            const double t = dot(tangent, side_[1]);
            k += curvature_[1] * t * t + 2 * curvature_[2] * s * t;
        }
        return k / std::max(1 + R_ * k, tuned::narrowest_hollow);
    }

    double R_;
    double max_lift_;      // 2 b [m]
    double touch_radius_;  // R + 2 b [m]
    double g_;             // sqrt(b / R)
    double fit_radius_;    // lateral [m]
    double max_tilt_;      // sine of the angle between a normal and its contact's direction
    ContactGroups<D> groups_;
    ContactPlane<D> plane_[max_surfaces];
    Vec<D> side_[D - 1];                     // tangents of the last surface, ...
    double curvature_[D == 2 ? 1 : 3] = {};  // ... and its curvature along them [1/m]
    std::optional<Vec<D>> known_at_;
    int count_ = 0;
};

}  // namespace vfplan::inline v1
