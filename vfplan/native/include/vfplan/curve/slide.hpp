// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A proxy on its way to the HIP: straight until it meets the curve, and then along it, until it is
// nearest to the HIP, sees it, comes to the end of the piece, or meets another one. Each of these
// ends is a root of a quadratic, and each iteration brings it nearer to the HIP.
#pragma once

#include "vfplan/curve/walls.hpp"
#include "vfplan/handover.hpp"

namespace vfplan::curve {

enum class End { arrived, rest, corner, more, blocked, leash, limit };

class Slider {
  public:
    static constexpr int most_iterations = 32;

    Slider(Curve curve, double radius, double band)
        : near_(std::move(curve), radius, band), R_(radius), band_(band) {}

    Nearby& near() noexcept { return near_; }
    const Nearby& near() const noexcept { return near_; }
    const Curve& curve() const noexcept { return near_.curve(); }

    void let_go() noexcept { on_ = none; }
    bool held() const noexcept { return on_ != none; }
    /// From what the proxy slid along last.
    Vec2 normal(const Vec2& x) const noexcept { return curve()[on_].contact(x).normal; }

    /// From x towards the HIP at h, as far as the leash allows.
    End go(Vec2& x, const Vec2& h, const Leash<2>* leash) noexcept {
        for (int i = 0; i < most_iterations; ++i) {
            const Vec2 u = h - x;
            const double length = norm(u);
            if (!(length > 0)) return End::arrived;
            End end = presses(x, u) ? End::blocked : fly(x, h, u, length, leash);
            if (end == End::blocked) end = slide(x, h, leash);
            if (end != End::more) return end;
        }
        return End::limit;
    }

  private:
    static constexpr int turns = 12;  // from feature to feature where the proxy stands

    /// Whether the feature that the proxy slid along last holds it from going along u.
    bool presses(const Vec2& x, const Vec2& u) const noexcept {
        const double slack = near_.heights().slack;
        if (on_ == none || !curve()[on_].beside(x, slack)) return false;
        const Contact c = curve()[on_].contact(x);
        return c.distance < R_ + slack && dot(c.normal, u) < -1e-12 * (R_ + norm(u));
    }

    /// Straight to the HIP, up to what lies on the way.
    End fly(Vec2& x, const Vec2& h, const Vec2& u, double length, const Leash<2>* leash) noexcept {
        const Way path(x, (1 / length) * u, 0);
        const Hit hit = near_.sweep(path, length, none);
        const double most = std::min(hit.t, length);
        if (leash)
            if (const double t = leaves(*leash, path); t < most) {
                x = path.at(t);
                on_ = none;
                return End::leash;
            }
        on_ = hit.feature;
        if (hit.feature == none) {
            x = h;
            return End::arrived;
        }
        if (hit.at_once(near_.heights())) return End::blocked;
        x = path.at(hit.t);
        return End::more;
    }

    /// Along what holds the proxy; `rest` and `corner` where that leads no nearer to the HIP.
    End slide(Vec2& x, const Vec2& h, const Leash<2>* leash) noexcept {
        raise(x);
        const Vec2 u = h - x;
        Walls w;
        w.add(near_, on_, x);
        Vec2 before;
        for (int turn = 0; turn < turns; ++turn) {
            const int i = w.free(u);
            if (i == none) return w.count > 1 ? End::corner : End::rest;
            const Contact& c = w.touch[i];
            const Vec2 T = ahead(c.normal, u);
            if (dot(T, before) < 0) return End::rest;  // a kink, from both sides of it
            Way path(x, T, 0);
            path.q = (dot(path.N, c.normal) < 0 ? c.bend : -c.bend) / 2;
            Stop stop = along(path, u, c, w.feature[i]);
            if (stop.next != w.feature[i] &&
                stop.t < near_.heights().slack) {  // at its end already
                const Contact on = curve()[stop.next].contact(x);
                if (full(on, near_.heights())) {
                    if (!w.add(near_, stop.next, x)) return End::corner;
                    before = {};
                    continue;
                }
                before = T;
                w.feature[i] = stop.next;
                w.touch[i] = on;
                continue;
            }
            const Hit hit = near_.sweep(path, stop.t, w.feature[i]);
            if (hit.feature != none && hit.at_once(near_.heights())) {
                if (!w.add(near_, hit.feature, x)) return End::corner;
                before = {};
                continue;
            }
            if (hit.feature != none) stop = {hit.t, End::more, hit.feature};
            if (leash)
                if (const double s = leaves(*leash, path); s < stop.t)
                    stop = {s, End::leash, w.feature[i]};
            const Vec2 y = path.at(stop.t);
            if (!(norm(h - y) < norm(u))) return End::rest;
            x = y;
            on_ = stop.next;
            return wedged(w.feature[i], hit, x, h) ? End::corner : stop.end;
        }
        return End::rest;
    }

    /// In a slight hollow kink, between a feature and one that the way along it had sunk into: each
    /// holds from sliding on the other. In a gate, sinking a little gets the proxy through.
    bool wedged(int feature, const Hit& hit, const Vec2& x, const Vec2& h) const noexcept {
        if (!hit.touching || on_ != hit.feature) return false;
        Walls both;
        return both.add(near_, feature, x) && both.add(near_, on_, x) &&
               dot(both.touch[0].normal, both.touch[1].normal) > 0 && both.free(h - x) == none;
    }

    /// Where a way along a feature ends, nothing else met, and on what it goes on.
    struct Stop {
        double t;
        End end;
        int next;
    };
    Stop along(const Way& path, const Vec2& u, const Contact& c, int feature) const noexcept {
        Stop stop{path.nearest(u), End::rest, feature};
        const auto sooner = [&](double t, int next) noexcept {
            if (t < stop.t) stop = {t, End::more, next};
        };
        if (c.bend > 0) sooner(path.in_sight(u, c.normal), feature);
        sooner(path.quarter(), feature);
        for (const Border& b : curve()[feature].border) sooner(b.met(path), b.next);
        return stop;
    }

    /// Up to R again where roundings have let the proxy sink.
    void raise(Vec2& x) noexcept {
        const Contact c = curve()[on_].contact(x);
        const double up = R_ - c.distance;
        if (up < band_ / 2) return;
        const Way path(x, c.normal, 0);
        const Hit hit = near_.sweep(path, up, on_);
        if (!hit.at_once(near_.heights())) x = path.at(std::min(hit.t, up));
    }
    /// Where the way comes out of the leash's ball.
    static double leaves(const Leash<2>& leash, const Way& path) noexcept {
        const Vec2 w = path.x - leash.middle;
        const double in = std::min((dot(w, w) - leash.radius * leash.radius) / 2, 0.0);
        return (-path.along(in, w, 1)).falls();
    }

    Nearby near_;
    double R_, band_;
    int on_ = none;  // what the proxy slid along last
};

}  // namespace vfplan::curve
