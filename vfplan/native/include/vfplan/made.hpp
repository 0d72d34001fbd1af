// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A rule in its space, and the same behind a type that a controller can hold.
// What the scene does not need is left out by type, chosen once when the engine is made.
#pragma once

#include <memory>

#include "vfplan/changing.hpp"
#include "vfplan/curve/exact.hpp"
#include "vfplan/edited.hpp"
#include "vfplan/mesh/exact.hpp"
#include "vfplan/paper.hpp"
#include "vfplan/robust.hpp"
#include "vfplan/space.hpp"
#include "vfplan/thinning.hpp"

namespace vfplan {

/// What was free before an exchange.
template <class S>
struct Before final : Passage<S::dimension> {
    static constexpr int most_looks = 24;      // along a way; a longer one is none
    static constexpr double stride = 1 / 8.0;  // of R: no wall is passed over

    const S* space = nullptr;
    detail::AnyEngine* engine = nullptr;
    Vec3 from;

    bool free(const Vec<S::dimension>& d, double length,
              const Vec<S::dimension>& out) const noexcept override {
        const double R = engine->radius, enough = R - 2 * engine->band;
        const Vec3 way = space->direction(d), up = 2 * stride * R * space->direction(out);
        if (engine->within(from + up, 2 * R) < engine->within(from - up, 2 * R)) return false;
        double t = 0;
        for (int i = 0; i < most_looks; ++i) {
            const double room = engine->within(from + t * way, 2 * R) - enough;
            if (!(room >= 0)) return false;
            if (t >= length) return true;
            t = std::min(t + std::max(room, stride * R), length);
        }
        return false;
    }
};

namespace detail {

/// A rule in a space; both known to the compiler.
template <class S, class RuleOf>
class RuleEngine : public AnyEngine {
  public:
    static constexpr int D = S::dimension;

    RuleEngine(S space, RuleOf rule, const Parameters& p)
        : AnyEngine(std::max({p.stiffness[0], p.stiffness[1], p.stiffness[2]}), p.R(), p.band),
          space_(space),
          rule_(std::move(rule)),
          stiffness_{p.stiffness} {}

    void reset(const Vec3& hip) noexcept final {
        rule_.reset();
        last_ = {};
        placed_ = good(hip);
        if (!placed_) return;
        last_.proxy = hip;
        proxy_ = space_.across(hip);
    }

    /// The next tick begins with the proxy at `proxy`, wherever that is; out of `before` it was.
    void go_on(const Vec3& proxy, AnyEngine* before) noexcept final {
        reset(proxy);
        before_.from = proxy;
        before_.engine = before;
        before_.space = &space_;
        rule_.go_on(before ? &before_ : nullptr);
    }

    Step step(const Vec3& hip) noexcept final {
        if (!good(hip)) return refuse();
        if (!placed_) reset(hip);
        const Vec<D> h = space_.across(hip);
        const Tick<D> tick = rule_(proxy_, h);
        last_.proxy = space_.place(proxy_, hip, h);
        last_.normal = space_.direction(tick.normal);
        last_.force = stiffness_.force(space_, proxy_ - h);
        last_.state = tick.state;
        last_.status = tick.status;
        return last_;
    }
    bool planar() noexcept final { return D == 2; }

  protected:
    S space_;
    RuleOf rule_;

  private:
    static bool good(const Vec3& hip) noexcept {
        for (int k = 0; k < 3; ++k)
            if (!(std::abs(hip[k]) <= largest_coordinate)) return false;
        return true;
    }
    Step refuse() noexcept {
        Step s = last_;  // all 0 before there was any proxy: a controller is never given a NaN
        s.status = bad_hip;
        return s;
    }

    Stiffness stiffness_;
    Before<S> before_;
    Vec<D> proxy_;
    Step last_;
    bool placed_ = false;
};

/// Points of this many or fewer are looked through one by one: measured, a grid costs more.
inline constexpr std::size_t small_cloud = 64;

/// Points.
template <class S, class R>
class Some final : public RuleEngine<S, R> {
  public:
    static constexpr bool editable = requires(R& rule) { rule.neighbours().source().remove(0); };
    using All = std::unique_ptr<Grid<S::dimension>>;

    /// `all`: the points, where the rule has not all of them.
    Some(S s, R rule, const Parameters& p, const Kernels<S::dimension>& kernels, All all)
        : RuleEngine<S, R>(s, std::move(rule), p), kernels_(kernels), all_(std::move(all)) {}
    void remove(std::size_t id) noexcept override {
        if constexpr (editable) this->rule_.edited(source().remove(id), false);
    }
    void add(const Vec3& point) noexcept override {
        if constexpr (editable) {
            const auto p = this->space_.across(point);
            source().add(p);
            this->rule_.edited(p, true);
        }
    }
    std::size_t bytes() noexcept override {
        return sizeof(*this) + this->rule_.neighbours().bytes() + (all_ ? all_->bytes() : 0);
    }
    std::size_t cells() noexcept override { return source().cells(); }
    double within(const Vec3& at, double reach) noexcept override {
        return within(source(), at, reach);
    }
    double distance(const Vec3& at) noexcept override {
        return all_ ? distance(*all_, at) : distance(source(), at);
    }

  private:
    auto& source() noexcept { return this->rule_.neighbours().source(); }
    template <class Source>
    double within(Source& source, const Vec3& at, double reach) noexcept {
        const auto x = this->space_.across(at);
        return std::sqrt(std::min(reach * reach, nearest2(source, kernels_, x, reach)));
    }
    template <class Source>
    double distance(Source& source, const Vec3& at) noexcept {
        if constexpr (requires { source.cell(); })
            for (double r = source.cell(), i = 0; i < 3; ++i, r *= 2)
                if (const double d = within(source, at, r); d < r) return d;
        return within(source, at, std::numeric_limits<double>::infinity());
    }

    Kernels<S::dimension> kernels_;
    All all_;
};

/// Lines and arcs, or triangles, as they are.
template <class S, class R>
struct Exact final : RuleEngine<S, R> {
    using RuleEngine<S, R>::RuleEngine;
    std::size_t bytes() noexcept override { return sizeof(*this) + this->rule_.bytes(); }
    std::size_t cells() noexcept override { return this->rule_.cells(); }
    double distance(const Vec3& at) noexcept override {
        return this->rule_.distance(this->space_.across(at));
    }
    double within(const Vec3& at, double reach) noexcept override {
        return std::min(distance(at), reach);
    }
};

using Made = std::unique_ptr<AnyEngine>;

template <class R, class S, class C>
Made with_rule(S space, const C& cloud, const Parameters& p, Width width,
               std::unique_ptr<Grid<S::dimension>> all = nullptr) {
    const auto loops = kernels<S::dimension>(width);
    return std::make_unique<Some<S, R>>(space, R(cloud, p, loops), p, loops, std::move(all));
}

template <class S>
Made in_space(S space, const double* xyz, std::size_t n, const Parameters& p, Width width) {
    constexpr int D = S::dimension;
    auto cloud = make_cloud(space, xyz, n);
    check_resolved(p, xyz, n);
    const bool brute =
        p.search == Search::brute || (p.search == Search::automatic && n <= small_cloud);
    if (p.rule == Rule::paper)
        return brute ? with_rule<PaperRule<D, AllPoints>>(space, cloud, p, width)
                     : with_rule<PaperRule<D, Neighbours>>(space, cloud, p, width);
    const auto kept = thinned(cloud, p);
    auto all = kept.lent > 0 ? std::make_unique<Grid<D>>(cloud, 2 * tuned::brief * p.R()) : nullptr;
    const auto with = [&]<template <int> class Search>() {
        return with_rule<RobustRule<D, Search>>(space, kept, p, width, std::move(all));
    };
    if (p.search == Search::editable) return with.template operator()<EditedNeighbours>();
    return brute ? with.template operator()<AllPoints>() : with.template operator()<Neighbours>();
}

inline Made make(const double* xyz, std::size_t n, const Parameters& p, Width width) {
    check(p);
    if (p.rule == Rule::exact) reject("rule exact renders a curve, not points");
    return p.ignore_axis ? in_space(Slice(*p.ignore_axis), xyz, n, p, width)
                         : in_space(Space{}, xyz, n, p, width);
}

inline Made make(const std::vector<Stroke>& strokes, Parameters p) {
    p.rule = Rule::exact;
    p.band = curve::ExactRule::band(p, strokes);
    check(p);
    check(strokes);
    if (!p.ignore_axis) reject("rule exact needs an ignore_axis: it is planar");
    const Slice space(*p.ignore_axis);
    return std::make_unique<Exact<Slice, curve::ExactRule>>(
        space, curve::ExactRule(curve::Curve(strokes, space, p.R()), p), p);
}

inline Made make(const mesh::Surface& surface, Parameters p) {
    p.rule = Rule::exact;
    mesh::check(surface);
    p.band = mesh::ExactRule::band(p, surface);
    check(p);
    if (p.ignore_axis) reject("rule exact renders a mesh in space: without an ignore_axis");
    mesh::Mesh triangles(surface, mesh::ExactRule::tolerance * p.R());
    mesh::Smooth smooth(triangles, p.R());
    p.band += smooth.rise();
    return std::make_unique<Exact<Space, mesh::ExactRule>>(
        Space{}, mesh::ExactRule(std::move(triangles), std::move(smooth), p), p);
}

}  // namespace detail

}  // namespace vfplan
