// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Rule `exact`: the proxy among lines and arcs, not among samples of them.
//
// The positions R away from a line or an arc are again lines and arcs, so that the proxy is a point
// among them: it goes straight until it meets one, and then along it, until it is nearest to the
// HIP, sees it, comes to the end of the piece, or meets another one. Each of these ends is a root
// of a quadratic, and each iteration brings it nearer to the HIP.
#pragma once

#include <utility>

#include "vfplan/curve/curve.hpp"
#include "vfplan/escape.hpp"
#include "vfplan/paper.hpp"

namespace vfplan::curve {

/// What a start may be inside of: all that lies nearer to the curve than R.
class Bands {
  public:
    explicit Bands(double radius) noexcept : R_(radius) {}

    Vec2 from_nearest(const Curve& curve, const Vec2& x) const noexcept {
        double least = R_ * (1 + 1e-6);
        Vec2 away;
        curve.around(x, least, [&](int i) noexcept {
            const double d = curve[i].distance(x);
            if (d < least && d > 0) least = d, away = curve[i].contact(x).normal;
        });
        return away;
    }
    double out(const Curve& curve, const Vec2& y, const Vec2& d) const noexcept {
        const Way path(y, d, 0);
        double s = -never;
        curve.around(y, R_, [&](int i) noexcept {
            if (curve[i].distance(y) < R_ * (1 - 1e-9)) s = std::max(s, curve[i].out(path));
        });
        return s;
    }

  private:
    double R_;
};

class ExactRule {
  public:
    static constexpr int dimension = 2;
    /// Of R: how far below R roundings may let the proxy sink.
    static constexpr double finest = 1e-7;
    static constexpr int most_iterations = 32;
    static constexpr double skin = 0.2;  // of R: how far the proxy may go with one gathered list
    static constexpr double list_reach = 1 + skin + 4 * finest;  // of R

    /// What roundings take [m], where the strokes lie far from the origin too.
    static double band(const Parameters& p, const std::vector<Stroke>& strokes) noexcept {
        double most = 0;
        for (const Stroke& s : strokes)
            for (double c : s.vertices) most = std::max(most, std::abs(c));
        const double rounding = std::numeric_limits<double>::epsilon() * most;
        return std::max(finest * p.R(), roundings_a_band * rounding);
    }

    ExactRule(Curve curve, const Parameters& p)
        : curve_(std::move(curve)),
          R_(p.R()),
          band_(p.band),
          outer_(p.outer_radius + p.point_radius),
          heights_{1e-3 * p.band, 0.75 * p.band, 0.1 * p.band},
          escape_(Bands(R_), R_) {
        near_.reserve(curve_.size());
    }

    void reset() noexcept {
        escape_.stop();
        held_ = taking_over_ = rests_ = gathered_ = stays_ = false;
        on_ = none;
    }
    /// As a reset, but a proxy that is inside is led out from where it is.
    void go_on() noexcept {
        reset();
        stays_ = true;
    }
    std::size_t bytes() const noexcept {
        return curve_.bytes() + near_.capacity() * sizeof near_[0];
    }
    std::size_t cells() const noexcept { return curve_.boxes(); }
    double distance(const Vec2& x) const noexcept { return curve_.distance(x); }

    /// One servo loop.
    Tick<2> operator()(Vec2& proxy, const Vec2& hip) noexcept {
        if (!held_ && !enter(proxy, hip)) {
            Tick<2> tick;
            tick.state = State::entrenched;
            tick.normal = escape_.way();
            tick.status = inside;
            return tick;
        }
        if (rests_ && hip == hip_) return last_;
        hip_ = hip;
        const Vec2 start = proxy;
        Tick<2> tick;
        if (taking_over_) {
            const Leash<2> leash = escape_.leash(proxy, hip);
            end_ = go(proxy, hip, &leash);
            taking_over_ = end_ == End::leash || (end_ == End::limit && ++unfinished_ < 32);
            if (taking_over_) tick.status = inside;
        } else {
            end_ = go(proxy, hip, nullptr);
        }
        if (end_ == End::limit) tick.status |= limit;
        double near = nearest(proxy);
        if (!(near >= R_ - band_)) {  // cannot happen; if it does, stay where it was safe
            proxy = start;
            on_ = none;
            near = nearest(proxy);
            tick.status |= limit;
            held_ = near >= R_ - band_;  // else it is taken out, from the next tick on
        }
        rests_ = tick.status == ok;
        describe(proxy, hip, near, tick);
        return last_ = tick;
    }

  private:
    static constexpr int none = -1;
    static constexpr int walls = 6;   // that are looked at together, at most
    static constexpr int turns = 12;  // from feature to feature where the proxy stands

    enum class End { arrived, rest, corner, more, blocked, leash, limit };
    struct Hit {
        double t = never;
        int feature = none;
        bool touching = false;
    };

    /// Makes sure that the proxy is outside; false while it is on its way out.
    bool enter(Vec2& proxy, const Vec2& hip) noexcept {
        if (!escape_.active()) {
            if (curve_.distance(proxy) >= R_ - band_) return held_ = true;
            anchor_ = proxy;
            escape_.begin(curve_, stays_ ? proxy : hip);
        }
        held_ = escape_.step(curve_, stays_ ? anchor_ : hip, proxy);
        taking_over_ = held_ && !(proxy == hip);
        if (held_) {
            escape_.meets(hip);
            stays_ = false;
        }
        unfinished_ = 0;
        on_ = none;
        rests_ = false;
        return false;
    }

    /// From x towards the HIP at h.
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

    /// Whether the feature that the proxy slid along last holds it from going along u.
    bool presses(const Vec2& x, const Vec2& u) const noexcept {
        if (on_ == none || !curve_[on_].beside(x, heights_.slack)) return false;
        const Contact c = curve_[on_].contact(x);
        return c.distance < R_ + heights_.slack && dot(c.normal, u) < -1e-12 * (R_ + norm(u));
    }

    /// Straight to the HIP, up to what lies on the way.
    End fly(Vec2& x, const Vec2& h, const Vec2& u, double length, const Leash<2>* leash) noexcept {
        const Way path(x, (1 / length) * u, 0);
        const Hit hit = sweep(path, length, none);
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
        if (at_once(hit)) return End::blocked;
        x = path.at(hit.t);
        return End::more;
    }

    bool at_once(const Hit& hit) const noexcept {
        return hit.t < (hit.touching ? 1e4 : 1.0) * heights_.slack;
    }

    /// Along what holds the proxy; `rest` and `corner` where that leads no nearer to the HIP.
    End slide(Vec2& x, const Vec2& h, const Leash<2>* leash) noexcept {
        raise(x);
        const Vec2 u = h - x;
        Walls w;
        add(w, on_, x);
        Vec2 before;
        for (int turn = 0; turn < turns; ++turn) {
            const int i = free(w, u);
            if (i == none) return w.count > 1 ? End::corner : End::rest;
            const Contact& c = w.touch[i];
            const Vec2 T = ahead(c.normal, u);
            if (dot(T, before) < 0) return End::rest;  // a kink, from both sides of it
            const Feature& f = curve_[w.feature[i]];
            Way path(x, T, 0);
            path.q = (dot(path.N, c.normal) < 0 ? c.bend : -c.bend) / 2;
            End end = End::rest;
            double t = path.nearest(u);
            const auto sooner = [&](double s, End why) noexcept {
                if (s < t) t = s, end = why;
            };
            if (c.bend > 0) sooner(path.in_sight(u, c.normal), End::more);
            sooner(path.quarter(), End::more);
            int next = w.feature[i];
            for (const Border& b : f.border)
                if (const double s = b.met(path); s < t) t = s, end = End::more, next = b.next;
            if (next != w.feature[i] && t < heights_.slack) {  // at the end of the piece already
                const Contact on = curve_[next].contact(x);
                if (full(on)) {
                    if (!add(w, next, x)) return End::corner;
                    before = {};
                    continue;
                }
                before = T;
                w.feature[i] = next;
                w.touch[i] = on;
                continue;
            }
            const Hit hit = sweep(path, t, w.feature[i]);
            if (hit.feature != none && at_once(hit)) {
                if (!add(w, hit.feature, x)) return End::corner;
                before = {};
                continue;
            }
            if (hit.feature != none) t = hit.t, end = End::more, next = hit.feature;
            if (leash)
                if (const double s = leaves(*leash, path); s < t) {
                    t = s;
                    end = End::leash;
                    next = w.feature[i];
                }
            const Vec2 y = path.at(t);
            if (!(norm(h - y) < norm(u))) return End::rest;
            x = y;
            on_ = next;
            return end;
        }
        return End::rest;
    }

    /// Up to R again where roundings have let the proxy sink.
    void raise(Vec2& x) noexcept {
        const Contact c = curve_[on_].contact(x);
        const double up = R_ - c.distance;
        if (up < band_ / 2) return;
        const Way path(x, c.normal, 0);
        const Hit hit = sweep(path, up, on_);
        if (!at_once(hit)) x = path.at(std::min(hit.t, up));
    }
    /// Tangent of a wall towards u.
    static Vec2 ahead(const Vec2& normal, const Vec2& u) noexcept {
        const Vec2 T = left(normal);
        return dot(T, u) < 0 ? -1.0 * T : T;
    }
    /// What touches the proxy.
    struct Walls {
        int feature[walls], count = 0;
        Contact touch[walls];
    };
    /// False where it is there already, or there are too many. A hollow that the proxy fills pushes
    /// from all its directions at once: as much as its two ends do.
    bool add(Walls& w, int feature, const Vec2& x) const noexcept {
        for (int j = 0; j < w.count; ++j)
            if (w.feature[j] == feature) return false;
        const Contact c = curve_[feature].contact(x);
        if (full(c)) {
            const Border* ends = curve_[feature].border;
            const bool one = add(w, ends[0].next, x), other = add(w, ends[1].next, x);
            return one || other;
        }
        if (w.count == walls) return false;
        w.feature[w.count] = feature;
        w.touch[w.count++] = c;
        return true;
    }
    bool full(const Contact& c) const noexcept { return -c.bend * heights_.filled > 1; }
    /// The wall along which a step leads nearer to u and into no other; the last met first.
    static int free(const Walls& w, const Vec2& u) noexcept {
        for (int i = w.count - 1; i >= 0; --i) {
            const Vec2 T = ahead(w.touch[i].normal, u);
            bool open = dot(T, u) > 0;
            for (int j = 0; j < w.count && open; ++j)
                open = j == i || dot(T, w.touch[j].normal) > -1e-9;
            if (open) return i;
        }
        return none;
    }
    /// Where the way comes out of the leash's ball.
    static double leaves(const Leash<2>& leash, const Way& path) noexcept {
        const Vec2 w = path.x - leash.middle;
        const double in = std::min((dot(w, w) - leash.radius * leash.radius) / 2, 0.0);
        return (-path.along(in, w, 1)).falls();
    }

    /// What the way meets first, within `most`; `skip` is none of it. Looked at from near to far.
    Hit sweep(const Way& path, double most, int skip) noexcept {
        for (double reach = skin * R_ / 2;; reach *= 4) {
            const Hit hit = within(path, std::min(reach, most), skip);
            if (hit.feature != none || !(reach < most)) return hit;
        }
    }
    Hit within(const Way& path, double most, int skip) noexcept {
        Hit hit;
        const auto look = [&](int i) noexcept {
            const double reach = R_ + std::min(most, hit.t) + heights_.slack;
            if (i == skip || curve_[i].box_square(path.x) > reach * reach) return;
            bool touching;
            const double t = meets(curve_[i], path, std::min(most, hit.t), heights_, touching);
            if (t < hit.t) hit = {t, i, touching};
        };
        if (gather(path.x, most)) {
            for (int i : near_) look(i);
        } else {
            curve_.visit(
                [&](const Vec2& least, const Vec2& high) noexcept {
                    return passes(path, std::min(most, hit.t), least, high);
                },
                look);
        }
        return hit;
    }
    /// Whether the way up to `most` may come within R of a box.
    bool passes(const Way& path, double most, const Vec2& least, const Vec2& high) const noexcept {
        double from = 0, to = most;
        for (int k = 0; k < 2; ++k) {
            const double low = least.c[k] - R_ - path.x.c[k], top = high.c[k] + R_ - path.x.c[k];
            if (path.q != 0 || path.T.c[k] == 0) {
                const double reach = path.q != 0 ? most : 0;
                if (low > reach || top < -reach) return false;
            } else {
                const double a = low / path.T.c[k], b = top / path.T.c[k];
                from = std::max(from, std::min(a, b));
                to = std::min(to, std::max(a, b));
            }
        }
        return from <= to;
    }

    /// The list of what lies near serves a way of length `most` from x; gathered anew if it has to.
    bool gather(const Vec2& x, double most) noexcept {
        if (gathered_ && norm(x - centre_) + most <= skin * R_) return true;
        if (!(most <= skin * R_ / 2)) return false;
        near_.clear();
        centre_ = x;
        gathered_ = true;
        curve_.around(x, R_ * (1 + skin) + 2 * band_, [&](int i) noexcept { near_.push_back(i); });
        return true;
    }

    /// Distance from the curve where that is less than about R, else some more [m].
    double nearest(const Vec2& x) noexcept {
        gather(x, 0);
        double least = never;
        for (int i : near_) least = std::min(least, curve_[i].distance(x));
        return least;
    }

    void describe(const Vec2& x, const Vec2& hip, double near, Tick<2>& tick) noexcept {
        if (near <= R_ + band_) {
            tick.state = State::in_contact;
            if (on_ == none || end_ == End::corner)
                tick.normal = along(x - hip, 1);
            else
                tick.normal = curve_[on_].contact(x).normal;
        } else if (std::min(near, outer_) < outer_ || curve_.distance(x) < outer_) {
            tick.state = State::free_motion;
        }
    }

    Curve curve_;
    double R_, band_, outer_;
    Heights heights_;
    Escape<2, const Curve, Bands> escape_;
    std::vector<int> near_;       // features near centre_
    Vec2 centre_, hip_, anchor_;  // anchor_: where a way out began on which the proxy stays
    int on_ = none;               // what the proxy slid along last
    End end_ = End::arrived;
    Tick<2> last_;
    int unfinished_ = 0;
    bool gathered_ = false, held_ = false, taking_over_ = false, rests_ = false;
    bool stays_ = false;  // on the way out the proxy does not go with the HIP
};

}  // namespace vfplan::curve
