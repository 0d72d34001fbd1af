// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Which surfaces touch the proxy, and the plane that each of them offers it.
#pragma once

#include <algorithm>

#include "vfplan/base/half_spaces.hpp"
#include "vfplan/base/vec.hpp"
#include "vfplan/cloud/grid.hpp"
#include "vfplan/cloud/kernels.hpp"
#include "vfplan/rules/constants.hpp"

namespace vfplan {

// The points that touch the proxy, sorted into surfaces. Points whose directions hang together
// belong to one surface, however it curves; a corner's walls do not hang together.

/// One surface that touches the proxy.
template <int D>
struct Contact {
    double r = 0;      ///< distance of its nearest point
    Vec<D> nearest;    ///< unit vector from that point to the proxy
    Vec<D> direction;  ///< unit mean of such vectors, the nearer the heavier
};

template <int D>
class Contacts {
  public:
    static constexpr int most = 6;        // surfaces
    static constexpr int most_kept = 24;  // directions; further points join one of them

    /// `shell`: distance up to which a point touches; `linked`: cosine of the angle within which
    /// two directions belong to one surface.
    Contacts(double shell, double linked) noexcept : shell_(shell), linked_(linked) {}

    void clear() noexcept { kept_ = count_ = 0; }
    int count() const noexcept { return count_; }
    const Contact<D>& operator[](int i) const noexcept { return contact_[i]; }

    /// A point at `away` = proxy - point. Up to `most_kept` of them, their order does not matter.
    void add(const Vec<D>& away) noexcept {
        const double r = norm(away);
        if (!(r > 0)) return;
        const Vec<D> c = (1 / r) * away;
        const double w = shell_ - r;
        if (kept_ < most_kept) {
            direction_[kept_] = c;
            part_[kept_++] = {r, c, (w * w) * c};
        } else {
            include(part_[like(c)], {r, c, (w * w) * c});
        }
    }

    /// Joins what hangs together, however far round it goes.
    void group() noexcept {
        Contact<D> all[most_kept];
        int next[most_kept], left = kept_, found = 0;
        for (int i = 0; i < left; ++i) next[i] = i;
        while (left > 0) {
            int chain[most_kept], links = 1;
            chain[0] = next[--left];
            Contact<D>& c = all[found++] = part_[chain[0]];
            for (int i = 0; i < links && left > 0; ++i)
                for (int j = left - 1; j >= 0; --j) {
                    if (!(dot(direction_[chain[i]], direction_[next[j]]) > linked_)) continue;
                    include(c, part_[chain[links++] = next[j]]);
                    next[j] = next[--left];
                }
            const double length = norm(c.direction);
            c.direction = length > 0 ? (1 / length) * c.direction : c.nearest;
        }
        count_ = std::min(found, most);
        std::partial_sort(all, all + count_, all + found,
                          [](const auto& a, const auto& b) { return a.r < b.r; });
        std::copy(all, all + count_, contact_);
    }

  private:
    static void include(Contact<D>& whole, const Contact<D>& part) noexcept {
        whole.direction = whole.direction + part.direction;
        if (part.r < whole.r) whole.r = part.r, whole.nearest = part.nearest;
    }
    /// A kept direction of the surface that c belongs to, or else the nearest.
    int like(const Vec<D>& c) const noexcept {
        int best = 0;
        double near = -2;
        for (int i = 0; i < kept_ && !(near > linked_); ++i) {
            const double cosine = dot(c, direction_[i]);
            if (cosine > near) near = cosine, best = i;
        }
        return best;
    }

    double shell_, linked_;
    Vec<D> direction_[most_kept];
    Contact<D> part_[most_kept];  // its direction: a sum, not of unit length
    Contact<D> contact_[most];
    int kept_ = 0, count_ = 0;
};

// The normal of a sampled surface under the proxy: a quadric fitted to the points around its foot.
//
// A mean of directions, eq. (1), leans towards wherever there are more points: away from a wall or
// a border. A fit does not, whether or not the sampling is even.

/// Turns the slopes of a quadric right under the proxy into those at its foot, where the normal
/// goes through the proxy: m -> (1 + 2 h Q)⁻¹ m for bends Q and height h.
template <int D>
void to_foot(double* x, double h) noexcept {
    constexpr double least = tuned::narrowest;
    if constexpr (D == 2) {
        x[1] /= std::max(1 + 2 * h * x[2], least);
    } else {
        const double a = 1 + 2 * h * x[3], b = 1 + 2 * h * x[4], c = h * x[5];
        const double det = a * b - c * c;
        if (!(a > least && b > least && det > least * least)) return;
        const double s = (b * x[1] - c * x[2]) / det, t = (a * x[2] - c * x[1]) / det;
        x[1] = s;
        x[2] = t;
    }
}

template <int D>
struct Fit {
    Vec<D> n;        ///< unit normal
    double off = 0;  ///< how far the points' centre is from the foot [length unit of the patch]
    /// Second derivatives of the depth below the proxy, ss (tt st): above 0 on a bulge [1 / that].
    double bend[D == 2 ? 1 : 3] = {};
};

/// The quadric through the points behind `m`, over the proxy, in the frame of `p`. Across a
/// direction in which the points do not extend (a curve in space) the normal stays `p.up`.
template <int D>
Fit<D> fit(const Patch<D>& p, const Moments<D>& m) noexcept {
    constexpr int terms = Moments<D>::terms;
    constexpr double flat = 1e-7, bent = 1e-4;  // ridges: slopes only if seen, bends only if needed
    const double weight = m.a[0];
    if (!(weight > 0)) return {p.up};
    double l[terms][terms] = {}, d[terms], x[terms];
    for (int r = 0, n = 0; r < terms; ++r)  // the lower triangle of the normal equations
        for (int c = r; c < terms; ++c, ++n) l[c][r] = m.a[n];
    for (int r = 1; r < terms; ++r)  // st counts half: so the frame's turn does not matter
        l[r][r] += weight * (r < D ? flat : r < 5 ? bent : 0.5 * bent);
    for (int j = 0; j < terms; ++j) {  // L D Lᵀ
        d[j] = l[j][j];
        for (int k = 0; k < j; ++k) d[j] -= l[j][k] * l[j][k] * d[k];
        if (!(d[j] > 0)) return {p.up};
        for (int i = j + 1; i < terms; ++i) {
            for (int k = 0; k < j; ++k) l[i][j] -= l[i][k] * l[j][k] * d[k];
            l[i][j] /= d[j];
        }
    }
    for (int i = 0; i < terms; ++i) {
        x[i] = m.z[i];
        for (int k = 0; k < i; ++k) x[i] -= l[i][k] * x[k];
    }
    for (int i = terms - 1; i >= 0; --i) {
        x[i] /= d[i];
        for (int k = i + 1; k < terms; ++k) x[i] -= l[k][i] * x[k];
    }
    const double h = p.height * p.scale;
    to_foot<D>(x, h);
    Vec<D> n = p.up;
    double off2 = 0;
    for (int k = 0; k < D - 1; ++k) {
        n = n - x[1 + k] * p.side[k];
        const double off = m.a[1 + k] / weight + h * x[1 + k];
        off2 += off * off;
    }
    if constexpr (D == 2) return {along(n, 1), std::sqrt(off2), {2 * x[2]}};
    if constexpr (D == 3) return {along(n, 1), std::sqrt(off2), {2 * x[3], 2 * x[4], x[5]}};
}

/// n where it leans no more than the angle of sine `lean` from the unit vector `axis`; `axis`
/// itself from twice that on, for then the proxy rests on an edge, not on a surface; gradually
/// between.
template <int D>
Vec<D> lean_at_most(const Vec<D>& n, const Vec<D>& axis, double lean) noexcept {
    const double c = dot(n, axis);
    const Vec<D> off = n - c * axis;
    const double sine = norm(off);
    if (c > 0 && sine <= lean) return n;
    if (!(c > 0) || sine >= 2 * lean) return axis;
    const double s = 2 * lean - sine;
    return std::sqrt(1 - s * s) * axis + (s / sine) * off;
}

// What the proxy touches: the surfaces around it, the normal of each, and how far each one asks it
// to move.

template <int D, class Search>
class Surfaces {
  public:
    Surfaces(const Kernels<D>& kernels, double radius, double band) noexcept
        : kernels_(kernels),
          R_(radius),
          deep_(tuned::deep * band),
          shell_(R_ + deep_),
          grain_(std::sqrt(band / R_)),
          window_(std::min(tuned::window * spacing(), tuned::widest_window) * R_),
          lean_(std::min(tuned::lean * std::sqrt(2.0) * grain_, tuned::most_linked / 2)),
          contacts_(shell_, std::cos(std::min(tuned::linked * grain_, tuned::most_linked))) {}

    /// What is asked of the list of neighbours: a fit's samples.
    double reach() const noexcept { return std::sqrt(shell_ * shell_ + window_ * window_); }
    /// How far off a point may be and still touch.
    double shell() const noexcept { return shell_; }

    void forget() noexcept { known_ = false; }
    /// What is known belongs to x.
    bool known_at(const Vec<D>& x) const noexcept { return known_ && x == looked_at_; }
    int count() const noexcept { return count_; }
    const Wall<D>* walls() const noexcept { return wall_; }
    const Contact<D>& contact(int j) const noexcept { return contacts_[j]; }

    /// The step that keeps to the one surface that touches: over its plane, to beside the place of
    /// its circle of curvature that is nearest to the HIP at u. On a bulge at most twice as far as
    /// to below the HIP, for a HIP behind the circle's centre is nearer to no place than to the
    /// others. `wall`: its own.
    Vec<D> slide(const Vec<D>& u, const Wall<D>& wall, double slack) const noexcept {
        const double deep = -dot(u, wall.n);
        if (!(deep + wall.lift > slack)) return u;
        const Vec<D> on = u + deep * wall.n;
        const double across = norm(on);
        if (!(across > 0)) return wall.lift * wall.n;
        const double bends = bend((1 / across) * on), near = 1 - bends * deep;
        const double aside = bends * across;  // no hypot, whose last bit differs among libraries
        const double far = near > 0 ? std::sqrt(near * near + aside * aside) : 0;
        return wall.lift * wall.n + (1 / std::max(far, 0.5)) * on;
    }
    /// The step nearest to u that keeps to all of them. Where none of these brings the proxy nearer
    /// to the HIP, and two face each other less than 2 R apart: one along the middle between them.
    Vec<D> step(const Vec<D>& u, double slack) const noexcept {
        const Vec<D> v = project(u, wall_, count_, slack);
        if (norm(v - u) < norm(u)) return v;
        for (int i = 0; i < count_; ++i)
            for (int j = 0; j < i; ++j) {
                const Wall<D>&a = wall_[i], &b = wall_[j];
                if (!(norm(a.n + b.n) <= 2 * lean_ && a.lift + b.lift > 0)) continue;
                const Vec<D> across = along(a.n - b.n, 1);
                const double middle = (a.lift - b.lift) / 2;
                Wall<D> between[Contacts<D>::most];
                std::copy(wall_, wall_ + count_, between);
                between[i] = {across, middle};
                between[j] = {-1.0 * across, -middle};
                return project(u, between, count_, slack);
            }
        return v;
    }
    /// Where all of them together push a proxy whose HIP is at u; 0 where none touches.
    Vec<D> normal(const Vec<D>& u, double rest, double slack) const noexcept {
        if (count_ < 2) return count_ == 1 ? wall_[0].n : Vec<D>{};
        Vec<D> n = project(u, wall_, count_, slack) - u;
        if (norm(n) > rest) return along(n, 1);
        n = {};
        for (int j = 0; j < count_; ++j) n = n + wall_[j].n;
        return along(n, 1);
    }

    /// The surfaces that touch the proxy at x.
    void update(Search& search, const Vec<D>& x) noexcept {
        if (known_at(x)) return;
        known_ = true;
        looked_at_ = x;
        contacts_.clear();
        search.visit(x, shell_, [&](const Span<D>& s) noexcept {
            std::uint32_t which[room];
            const std::size_t n = kernels_.within(s, x, shell_ * shell_, which, room);
            for (std::size_t i = 0; i < std::min(n, room); ++i) touch(s, which[i], x);
            if (n > room)  // a crowd of points: go through all of them
                for (std::size_t i = which[room - 1] + 1; i < s.n; ++i) touch(s, i, x);
        });
        contacts_.group();
        count_ = contacts_.count();
        for (int j = 0; j < count_; ++j) wall_[j] = wall(search, x, contacts_[j]);
    }

  private:
    static constexpr std::size_t room = 256;

    /// Of the cloud whose dimples are as deep as the band, in R.
    double spacing() const noexcept { return (D == 2 ? std::sqrt(8.0) : 2.0) * grain_; }

    /// How much the surface bends where the proxy goes, R above it, along the unit vector `way`
    /// across its normal: above 0 on a bulge [1/m].
    double bend(const Vec<D>& way) const noexcept {
        const double s = dot(way, side_[0]);
        double k = bend_[0] * s * s;
        if constexpr (D == 3) {
            const double t = dot(way, side_[1]);
            k += bend_[1] * t * t + 2 * bend_[2] * s * t;
        }
        return k / std::max(1 + R_ * k, tuned::narrowest);
    }

    void touch(const Span<D>& s, std::size_t i, const Vec<D>& x) noexcept {
        const Vec<D> away = x - s[i];
        if (dot(away, away) <= shell_ * shell_) contacts_.add(away);
    }

    /// The normal of one surface, and the height that is missing to R above its nearest point.
    Wall<D> wall(Search& search, const Vec<D>& x, const Contact<D>& c) noexcept {
        Patch<D> patch;
        patch.at = x;
        patch.up = c.direction;
        frame(patch.up, patch.side);
        patch.height = c.r;
        patch.scale = 1 / window_;
        patch.least2 = c.r * c.r;
        patch.most2 = patch.least2 + window_ * window_;
        patch.cosine2 = R_ * R_ / (R_ * R_ + 2 * window_ * window_);
        Moments<D> m;
        search.visit(x, std::sqrt(patch.most2),
                     [&](const Span<D>& s) noexcept { kernels_.patch(s, patch, m); });
        Wall<D> w;
        const Fit<D> f = fit(patch, m);
        // Points on one side of the foot only: the surface ends here, and the proxy turns round its
        // rim.
        const double whole = std::clamp(
            (tuned::one_sided - f.off) / (tuned::one_sided - tuned::surrounded), 0.0, 1.0);
        w.n = lean_at_most(f.n, c.direction, whole * lean_);
        std::copy(patch.side, patch.side + (D - 1), side_);
        const bool fits = whole > 0 && w.n == f.n;  // else no surface is known that could bend
        for (std::size_t k = 0; k < std::size(bend_); ++k)
            bend_[k] = fits ? whole * f.bend[k] / window_ : 0;
        w.lift = std::clamp(R_ - c.r * dot(c.nearest, w.n), -deep_, deep_);
        return w;
    }

    Kernels<D> kernels_;
    double R_, deep_, shell_;
    double grain_;   // g of constants.hpp
    double window_;  // lateral radius of the fit [m]
    double lean_;    // sine of the angle that a normal leans from the contact's on a surface
    Contacts<D> contacts_;
    Wall<D> wall_[Contacts<D>::most];
    Vec<D> side_[D - 1];                // of the last wall looked at, ...
    double bend_[D == 2 ? 1 : 3] = {};  // ... second derivatives of its depth
    Vec<D> looked_at_;
    int count_ = 0;
    bool known_ = false;  // what belongs to looked_at_
};

}  // namespace vfplan
