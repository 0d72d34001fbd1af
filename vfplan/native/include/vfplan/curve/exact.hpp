// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Rule `exact`: the proxy among lines and arcs, not among samples of them.
//
// The positions R away from a line or an arc are again lines and arcs, so that the proxy is a point
// among them. Inside of that, it is led out first.
#pragma once

#include "vfplan/curve/slide.hpp"
#include "vfplan/entrance.hpp"
#include "vfplan/parameters.hpp"

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
    static constexpr int most_iterations = Slider::most_iterations;
    static constexpr double list_reach = 1 + Nearby::skin + 4 * finest;  // of R

    /// What roundings take [m], where the strokes lie far from the origin too.
    static double band(const Parameters& p, const std::vector<Stroke>& strokes) noexcept {
        double most = 0;
        for (const Stroke& s : strokes)
            for (double c : s.vertices) most = std::max(most, std::abs(c));
        const double rounding = std::numeric_limits<double>::epsilon() * most;
        return std::max(finest * p.R(), roundings_a_band * rounding);
    }

    ExactRule(Curve curve, const Parameters& p)
        : R_(p.R()),
          band_(p.band),
          outer_(p.outer_radius + p.point_radius),
          slider_(std::move(curve), R_, band_),
          entrance_(Bands(R_), R_) {}

    void reset() noexcept {
        entrance_.reset();
        rests_ = false;
        slider_.near().forget();
        slider_.let_go();
    }
    /// As a reset, but a proxy that is inside is led out from where it is.
    void go_on(const Passage<2>* before) noexcept {
        reset();
        entrance_.go_on(before);
    }
    std::size_t bytes() const noexcept { return curve().bytes() + slider_.near().bytes(); }
    std::size_t cells() const noexcept { return curve().boxes(); }
    double distance(const Vec2& x) const noexcept { return curve().distance(x); }

    /// One servo loop.
    Tick<2> operator()(Vec2& proxy, const Vec2& hip) noexcept {
        const auto clear = [&]() noexcept { return curve().distance(proxy) >= R_ - band_; };
        if (!entrance_.outside(curve(), proxy, hip, clear)) {
            slider_.let_go();
            rests_ = false;
            return entrance_.tick();
        }
        if (rests_ && hip == hip_) return last_;
        hip_ = hip;
        const Vec2 start = proxy;
        Tick<2> tick;
        if (entrance_.taking_over()) {
            const Leash<2> leash = entrance_.leash(proxy, hip);
            end_ = slider_.go(proxy, hip, &leash);
            if (entrance_.goes_on(end_ == End::leash, end_ == End::limit)) tick.status = inside;
        } else {
            end_ = slider_.go(proxy, hip, nullptr);
        }
        if (end_ == End::limit) tick.status |= limit;
        double near = slider_.near().distance(proxy);
        if (!(near >= R_ - band_)) {  // cannot happen; if it does, stay where it was safe
            proxy = start;
            slider_.let_go();
            near = slider_.near().distance(proxy);
            tick.status |= limit;
            entrance_.hold(near >= R_ - band_);
        }
        rests_ = tick.status == ok;
        describe(proxy, hip, near, tick);
        return last_ = tick;
    }

  private:
    const Curve& curve() const noexcept { return slider_.curve(); }

    void describe(const Vec2& x, const Vec2& hip, double near, Tick<2>& tick) noexcept {
        if (near <= R_ + band_) {
            tick.state = State::in_contact;
            tick.normal =
                !slider_.held() || end_ == End::corner ? along(x - hip, 1) : slider_.normal(x);
        } else if (std::min(near, outer_) < outer_ || curve().distance(x) < outer_) {
            tick.state = State::free_motion;
        }
    }

    double R_, band_, outer_;
    Slider slider_;
    Entrance<2, const Curve, Bands> entrance_;
    Vec2 hip_;
    End end_ = End::arrived;
    Tick<2> last_;
    bool rests_ = false;
};

}  // namespace vfplan::curve
