// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The rules in their spaces, behind the type that an engine holds. Part of engine.hpp, which a
// controller includes, and which declares what is defined here.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "vfplan/cloud/density.hpp"
#include "vfplan/cloud/grid.hpp"
#include "vfplan/curve/exact.hpp"
#include "vfplan/exchange.hpp"
#include "vfplan/mesh/exact.hpp"
#include "vfplan/rules/paper.hpp"
#include "vfplan/rules/robust.hpp"
#include "vfplan/rules/rule.hpp"
#include "vfplan/tick_time.hpp"

namespace vfplan {

namespace detail {

/// A rule in the space in which the proxy moves. It gives forces, and answers a bad HIP.
template <class Space, ProxyRule RuleOf>
class RuleInSpace : public EngineImpl {
  public:
    static constexpr int D = Space::dimension;

    RuleInSpace(Space space, RuleOf rule, const Parameters& p)
        : EngineImpl(std::max({p.stiffness[0], p.stiffness[1], p.stiffness[2]}), p.R(), p.band),
          space_(space),
          rule_(std::move(rule)),
          stiffness_{p.stiffness} {}

    void reset(const Vec3& hip) noexcept final {
        rule_.reset();
        last_ = {};
        is_placed_ = is_good(hip);
        if (!is_placed_) return;
        last_.proxy = hip;
        proxy_ = space_.across(hip);
    }
    void continue_from(const Vec3& proxy, EngineImpl* previous) noexcept final {
        reset(proxy);
        previous_.from = proxy;
        previous_.engine = previous;
        previous_.space = &space_;
        rule_.continue_from(previous ? &previous_ : nullptr);
    }

    Step step(const Vec3& hip) noexcept final {
        if (!is_good(hip)) {
            Step s = last_;  // all 0 before there was any proxy: a controller is never given a NaN
            s.status = bad_hip;
            return s;
        }
        if (!is_placed_) reset(hip);
        const Vec<D> h = space_.across(hip);
        const RuleAnswer<D> answer = rule_.step(proxy_, h);
        last_.proxy = space_.place(proxy_, hip, h);
        last_.normal = space_.direction(answer.normal);
        last_.force = stiffness_.force(space_, proxy_ - h);
        last_.state = answer.state;
        last_.status = answer.status;
        return last_;
    }
    bool planar() noexcept final { return D == 2; }

  protected:
    Space space_;
    RuleOf rule_;

  private:
    static bool is_good(const Vec3& hip) noexcept {
        for (int k = 0; k < 3; ++k)
            if (!(std::abs(hip[k]) <= largest_coordinate)) return false;
        return true;
    }

    Stiffness stiffness_;
    PreviousSpace<Space> previous_;
    Vec<D> proxy_;
    Step last_;
    bool is_placed_ = false;
};

/// A rule among points.
template <class Space, class RuleOf>
class CloudEngine final : public RuleInSpace<Space, RuleOf> {
    static constexpr int D = Space::dimension;

  public:
    /// `all`: the points, where the rule has not all of them.
    CloudEngine(Space space, RuleOf rule, const Parameters& p, const Kernels<D>& kernels,
                std::unique_ptr<Grid<D>> all)
        : RuleInSpace<Space, RuleOf>(space, std::move(rule), p),
          kernels_(kernels),
          all_(std::move(all)) {}

    void remove(std::size_t id) noexcept override {
        if constexpr (is_editable) this->rule_.point_changed(index().remove(id), false);
    }
    void add(const Vec3& point) noexcept override {
        if constexpr (is_editable) {
            const Vec<D> p = this->space_.across(point);
            index().add(p);
            this->rule_.point_changed(p, true);
        }
    }
    std::size_t bytes() noexcept override {
        return sizeof(*this) + this->rule_.neighbours().bytes() + (all_ ? all_->bytes() : 0);
    }
    std::size_t cells() noexcept override { return index().cells(); }
    double distance_within(const Vec3& x, double reach) noexcept override {
        return distance_within(index(), this->space_.across(x), reach);
    }
    double distance(const Vec3& x) noexcept override {
        const Vec<D> y = this->space_.across(x);
        return all_ ? distance(*all_, y) : distance(index(), y);
    }

  private:
    static constexpr bool is_editable =
        requires(RuleOf& rule, const Vec<D>& p) { rule.point_changed(p, true); };

    PointIndex<D>& index() noexcept { return this->rule_.neighbours().index(); }
    template <class Points>
    double distance_within(Points& points, const Vec<D>& x, double reach) noexcept {
        return std::sqrt(std::min(reach * reach, nearest2(points, kernels_, x, reach)));
    }
    /// Looks near by first, for that is where most places are asked about.
    template <class Points>
    double distance(Points& points, const Vec<D>& x) noexcept {
        double reach = points.cell();
        for (int i = 0; i < 3 && reach > 0; ++i, reach *= 2) {
            const double d = distance_within(points, x, reach);
            if (d < reach) return d;
        }
        return distance_within(points, x, std::numeric_limits<double>::infinity());
    }

    Kernels<D> kernels_;
    std::unique_ptr<Grid<D>> all_;
};

/// A rule among lines and arcs, or triangles.
template <class Space, class RuleOf>
struct GeometryEngine final : RuleInSpace<Space, RuleOf> {
    using RuleInSpace<Space, RuleOf>::RuleInSpace;
    std::size_t bytes() noexcept override { return sizeof(*this) + this->rule_.bytes(); }
    std::size_t cells() noexcept override { return this->rule_.cells(); }
    double distance(const Vec3& x) noexcept override {
        return this->rule_.distance(this->space_.across(x));
    }
    double distance_within(const Vec3& x, double reach) noexcept override {
        return std::min(distance(x), reach);
    }
};

template <class Space>
ImplPtr make_in_space(Space space, const double* xyz, std::size_t n, const Parameters& p,
                      Width width) {
    constexpr int D = Space::dimension;
    Cloud<D> cloud = make_cloud(space, xyz, n);
    check_resolved(p, xyz, n);
    const Kernels<D> loops = kernels<D>(width);
    if (p.rule == Rule::paper)
        return std::make_unique<CloudEngine<Space, PaperRule<D>>>(
            space, PaperRule<D>(cloud, p, loops), p, loops, nullptr);
    const Thinned<D> thinned_cloud = thinned(cloud, p);
    std::unique_ptr<Grid<D>> all;
    if (thinned_cloud.lent > 0)
        all = std::make_unique<Grid<D>>(cloud, 2 * tuned::list_margin * p.R());
    return std::make_unique<CloudEngine<Space, RobustRule<D>>>(
        space, RobustRule<D>(thinned_cloud, p, loops), p, loops, std::move(all));
}

VFPLAN_COMPILED_ONCE ImplPtr make_impl(const double* xyz, std::size_t n, const Parameters& p,
                                       Width width) {
    check(p);
    if (p.rule == Rule::exact) reject("rule exact renders a curve, not points");
    if (p.ignore_axis) return make_in_space(Slice(*p.ignore_axis), xyz, n, p, width);
    return make_in_space(Space{}, xyz, n, p, width);
}

VFPLAN_COMPILED_ONCE ImplPtr make_impl(const std::vector<Stroke>& strokes, Parameters p) {
    p.rule = Rule::exact;
    p.band = curve::CurveRule::band(p, strokes);
    check(p);
    check(strokes);
    if (!p.ignore_axis) reject("rule exact needs an ignore_axis: it is planar");
    const Slice space(*p.ignore_axis);
    return std::make_unique<GeometryEngine<Slice, curve::CurveRule>>(
        space, curve::CurveRule(curve::Curve(strokes, space, p.R()), p), p);
}

VFPLAN_COMPILED_ONCE ImplPtr make_impl(const mesh::Surface& surface, Parameters p) {
    p.rule = Rule::exact;
    mesh::check(surface);
    p.band = mesh::MeshRule::band(p, surface);
    check(p);
    if (p.ignore_axis) reject("rule exact renders a mesh in space: without an ignore_axis");
    mesh::Mesh triangles(surface);
    mesh::SmoothBody body(triangles, p.R());
    p.band += body.rise();
    return std::make_unique<GeometryEngine<Space, mesh::MeshRule>>(
        Space{}, mesh::MeshRule(std::move(triangles), std::move(body), p), p);
}

VFPLAN_COMPILED_ONCE bool is_too_dense(const double* xyz, std::size_t n, const Parameters& p) {
    return !(tick_time_bound(xyz, n, p) <= max_tick_time);
}

}  // namespace detail

}  // namespace vfplan
