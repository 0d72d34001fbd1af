// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Plain first form of both proxy rules: every point is looked at in every pass.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace vfplan::plain {

using V = std::array<double, 3>;
inline V operator+(V a, const V& b) {
    for (int i = 0; i < 3; ++i) a[i] += b[i];
    return a;
}
inline V operator-(V a, const V& b) {
    for (int i = 0; i < 3; ++i) a[i] -= b[i];
    return a;
}
inline V operator*(double s, V a) {
    for (double& x : a) x *= s;
    return a;
}
inline double dot(const V& a, const V& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline double norm(const V& a) { return std::sqrt(dot(a, a)); }

struct Parameters {
    bool robust;
    double rc, band, rv, r3, xi;
    V K, axis;
    bool planar;
    int max_iterations;
};

struct Tick {
    V proxy, normal, force;
    int state;
    unsigned status;
};

class Engine {
  public:
    Engine(std::vector<V> points, Parameters p) : points_(std::move(points)), p_(p) {
        for (V& x : points_) x = across(x);
    }
    void reset(const V& hip) {
        proxy_ = hip;
        started_ = true;
        normal_ = {};
        force_ = {};
        state_ = -1;
    }

    Tick step(const V& hip) noexcept {
        for (double x : hip)
            if (!(std::abs(x) <= 1e6)) {
                V proxy = proxy_;
                if (!started_) proxy = {NAN, NAN, NAN};
                return {proxy, normal_, force_, state_, 1u};
            }
        if (!started_) {
            proxy_ = hip;
            started_ = true;
        }
        const V h = across(hip);
        V q = across(proxy_);
        unsigned status = p_.robust ? robust(q, h) : paper(q, h);
        proxy_ = q + (hip - h);
        force_ = force(proxy_ - hip);
        return {proxy_, normal_, force_, state_, status};
    }

  private:
    V across(const V& x) const { return p_.planar ? x - dot(x, p_.axis) * p_.axis : x; }
    V force(const V& pull) const {
        V f = across(pull);
        for (int i = 0; i < 3; ++i) f[i] *= p_.K[i];
        return across(f);
    }
    double phi(double r, double r1) const {
        const double t = std::clamp((r - r1) / (p_.r3 - r1), 0.0, 1.0);
        return (1 + 4 * t) * std::pow(1 - t, 4);
    }
    V weighted_normal(const V& q, double offset, const V* agree) const {
        V sum{};
        double total = 0;
        for (const V& c : points_) {
            const V away = q - c;
            const double r = norm(away);
            if (!(r < p_.r3 + p_.rv) || r == 0) continue;
            if (agree && dot(away, *agree) < 0.5 * r) continue;
            const double w = phi(r - offset, p_.rc - p_.band);
            sum = sum + (w / r) * away;
            total += w;
        }
        const double length = norm(sum);
        return length > 1e-12 * total ? (1 / length) * sum : V{};
    }

    unsigned paper(V& q, const V& h) {
        const double r1 = p_.rc - p_.band, r2 = p_.rc + p_.band, rv = p_.rv, R = p_.rc + rv;
        bool entrenched = false, contact = false, near = false;
        double mean_hip = 0, mean_proxy = 0;
        const V u = h - q;
        const double length = norm(u);
        double d0 = std::numeric_limits<double>::infinity();
        for (const V& c : points_) {
            const V w = c - q;
            const double r = norm(w);
            if (!(r < p_.r3 + rv)) continue;
            if (r < r1 + rv)
                entrenched = true;
            else if (r <= r2 + rv)
                contact = true;
            else
                near = true;
            mean_hip += norm(c - h);
            mean_proxy += r;
            if (length > 0) {
                const double ahead = dot(w, u) / length, disc = ahead * ahead - r * r + R * R;
                if (disc >= 0) {
                    const double d = ahead - std::sqrt(disc);
                    if (d >= 0) d0 = std::min(d0, d);
                }
            }
        }
        state_ = entrenched ? 2 : contact ? 1 : near ? 0 : -1;
        normal_ = state_ >= 0 ? weighted_normal(q, 0, nullptr) : V{};
        const V& n = normal_;
        auto unit_step = [](const V& v, double d) {
            const double l = norm(v);
            return l > 0 ? (d / l) * v : V{};
        };
        const V up = u - dot(n, u) * n;
        const double dt = p_.xi * std::min(norm(up), r1);
        const bool inside = dot(n, u) < 0;
        V s = u;
        if (state_ == 2) {
            double d = -std::numeric_limits<double>::infinity();
            for (const V& c : points_) {
                const V w = c - q;
                if (!(norm(w) < r1 + rv)) continue;
                const double ahead = dot(w, n);
                d = std::max(d, ahead + std::sqrt(ahead * ahead + R * R - dot(w, w)));
            }
            s = d * n;
        } else if (state_ == 1) {
            s = inside ? unit_step(up, dt) : unit_step(u, dt);
        } else if (state_ == 0) {
            if (length == 0)
                s = {};
            else {
                const double d = std::min(d0, length);
                s = (d / length) * u;
                if (d == 0 && inside) s = unit_step(up, dt);
                if (!inside && mean_hip > mean_proxy) s = u;
            }
        }
        q = q + s;
        return 0;
    }

    double clearance(const V& q) const {
        double best = std::numeric_limits<double>::infinity();
        for (const V& c : points_) best = std::min(best, dot(q - c, q - c));
        return std::sqrt(best);
    }
    // How far q may go along v (|v| = full step) before it is within `radius` of a point.
    double sweep(const V& q, const V& v, double radius) const {
        const double length = norm(v);
        double t = 1;
        if (length == 0) return 0;
        for (const V& c : points_) {
            const V w = c - q;
            const double ahead = dot(w, v) / length;
            if (ahead <= 0) continue;
            const double miss = dot(w, w) - ahead * ahead, disc = radius * radius - miss;
            if (disc <= 0) continue;
            t = std::min(t, std::max(0.0, (ahead - std::sqrt(disc)) / length));
        }
        return t;
    }

    unsigned robust(V& q, const V& h) {
        const double R = p_.rc + p_.rv, lo = R - p_.band, hi = R + p_.band;
        unsigned status = 0;
        state_ = -1;
        for (int it = 0; it < p_.max_iterations; ++it) {
            std::array<V, 3> n{};
            int groups = 0;
            bool first_pass = true;
            double deepest = std::numeric_limits<double>::infinity();
            std::array<V, 3> seed{};
            for (int g = 0; g < 3; ++g) {
                const V* pick = nullptr;
                double best = std::numeric_limits<double>::infinity();
                for (const V& c : points_) {
                    const V away = q - c;
                    const double r = norm(away);
                    if (!(r <= hi) || r == 0) continue;
                    deepest = std::min(deepest, r);
                    bool explained = false;
                    for (int k = 0; k < g; ++k)
                        explained = explained || dot(away, seed[k]) >= 0.8 * r;
                    if (!explained && r < best) {
                        best = r;
                        pick = &c;
                    }
                }
                if (!pick) break;
                seed[g] = (1 / norm(q - *pick)) * (q - *pick);
                ++groups;
            }
            (void)first_pass;
            for (int g = 0; g < groups; ++g)
                n[g] = weighted_normal(q, p_.rv, groups == 1 ? nullptr : &seed[g]);
            if (it == 0 || groups) {
                normal_ = groups ? n[0] : V{};
            }
            if (deepest < lo)
                state_ = 2;
            else if (groups)
                state_ = 1;
            else if (state_ < 1)
                state_ = clearance(q) < p_.r3 + p_.rv ? 0 : -1;
            const V before = q;
            if (groups) {  // lift what is below R
                V out{};
                for (int g = 0; g < groups; ++g) out = out + n[g];
                const double l = norm(out);
                if (l > 0 && deepest < R) {
                    const double d =
                        deepest < lo ? R - deepest : std::min(R - deepest, 2 * p_.band);
                    const V move = (d / l) * out;
                    q = q + (deepest < lo ? 1.0 : sweep(q, move, lo)) * move;
                    if (deepest < lo) {
                        status |= 2u;
                        continue;
                    }
                }
            }
            const V u = h - q;
            if (norm(u) < 1e-12) break;
            V v = u;
            for (int round = 0; round < 8; ++round)
                for (int g = 0; g < groups; ++g) {
                    const double into = dot(n[g], v);
                    if (into < 0) v = v - into * n[g];
                }
            if (norm(v) < 1e-12) break;
            q = q + sweep(q, v, groups ? lo : R) * v;
            if (groups > 1 && norm(h - q) >= norm(h - before)) {
                q = before;
                break;
            }
            if (norm(q - before) < 1e-7) break;
        }
        return status;
    }

    std::vector<V> points_;
    Parameters p_;
    V proxy_{}, normal_{}, force_{};
    int state_ = -1;
    bool started_ = false;
};

}  // namespace vfplan::plain
