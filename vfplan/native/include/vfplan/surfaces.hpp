// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What the proxy touches: the surfaces around it, the normal of each, and how far each one asks it
// to move.
#pragma once

#include "vfplan/cone.hpp"
#include "vfplan/contacts.hpp"
#include "vfplan/neighbours.hpp"
#include "vfplan/surface.hpp"
#include "vfplan/tuned.hpp"

namespace vfplan {

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
    double grain_;   // g of tuned.hpp
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
