// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A start inside the fixture: the proxy is taken out along the shortest way found, slowly, so that
// the force ramps; it follows the HIP meanwhile.
#pragma once

#include "vfplan/neighbours.hpp"

namespace vfplan {

template <int D, class Search>
class Escape {
  public:
    static constexpr int most_hops = 48;  // from sphere to sphere along one direction
    static constexpr int most_hops_a_tick = 384;
    static constexpr double ramp = 1.0 / 256;  // of R, a tick

    Escape(const Kernels<D>& kernels, double radius) noexcept : kernels_(kernels), R_(radius) {}

    bool active() const noexcept { return active_; }
    const Vec<D>& way() const noexcept { return way_; }
    void stop() noexcept { active_ = false; }

    /// The HIP is at h, and the proxy inside: choose the way out.
    void begin(Search& search, const Vec<D>& h) noexcept {
        active_ = true;
        out_ = 0;
        last_ = h;
        budget_ = most_hops_a_tick;
        double best = std::numeric_limits<double>::infinity();
        way_ = Vec<D>{};
        way_.c[D - 1] = 1;
        try_way(search, h, from_nearest(search, h), best);
        try_way(search, h, -1.0 * way_, best);
        Vec<D> d;
        constexpr int ring = D == 3 ? 27 : 9;
        for (int i = 0; i < ring; ++i) {
            for (int k = 0, rest = i; k < D; ++k, rest /= 3) d.c[k] = rest % 3 - 1;
            if (norm(d) > 0) try_way(search, h, along(d, 1), best);
        }
        for (int i = 0; i < 2 && std::isfinite(best); ++i)
            try_way(search, h, from_nearest(search, h + best * way_), best);
    }

    /// One tick; true when the proxy has reached the free space.
    bool step(Search& search, const Vec<D>& h, Vec<D>& proxy) noexcept {
        budget_ = most_hops_a_tick;
        const double there = exit(search, h, way_, std::numeric_limits<double>::infinity());
        const double deeper = std::max(0.0, -dot(h - last_, way_));
        last_ = h;
        out_ = std::min(out_ + ramp * R_ + deeper, there);
        proxy = h + out_ * way_;
        if (out_ < there) return false;
        active_ = false;
        return true;
    }

  private:
    Vec<D> from_nearest(Search& search, const Vec<D>& x) noexcept {
        double least = std::numeric_limits<double>::infinity();
        Vec<D> away;
        search.source().visit(x, R_ * (1 + 1e-6), [&](const Span<D>& s) noexcept {
            if (!(kernels_.nearest2(s, x) < least)) return;
            for (std::size_t i = 0; i < s.n; ++i) {
                Vec<D> w = x;
                for (int k = 0; k < D; ++k) w.c[k] -= s.c[k][i];
                const double d2 = dot(w, w);
                if (d2 < least && d2 > 0) least = d2, away = w;
            }
        });
        const double r = norm(away);
        return r > 0 ? (1 / r) * away : way_;
    }

    void try_way(Search& search, const Vec<D>& h, const Vec<D>& d, double& best) noexcept {
        const double t = exit(search, h, d, best);
        if (t < best) best = t, way_ = d;
    }

    /// Distance from h along d to the free space; infinity beyond `most` or out of hops.
    double exit(Search& search, const Vec<D>& h, const Vec<D>& d, double most) noexcept {
        constexpr double never = std::numeric_limits<double>::infinity();
        const double inside2 = R_ * R_ * (1 - 1e-9);
        double t = 0;
        for (int i = 0; i < most_hops && budget_ > 0 && t < most; ++i, --budget_) {
            const Vec<D> y = h + t * d;
            double s = -never;
            search.source().visit(y, R_, [&](const Span<D>& span) noexcept {
                s = std::max(s, kernels_.out(span, y, d, inside2, R_ * R_));
            });
            if (s == -never) return t;
            t += s + 1e-12 * R_;
        }
        return never;
    }

    Kernels<D> kernels_;
    double R_;
    bool active_ = false;
    Vec<D> way_, last_;
    double out_ = 0;
    int budget_ = 0;
};

}  // namespace vfplan
