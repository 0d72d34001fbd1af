// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The rules in their spaces, behind the type that an engine holds, and how long a tick of theirs
// may take. engine.hpp, which a controller includes, and tick_time.hpp declare what is defined
// here.
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
#include "vfplan/mesh/triangles.hpp"
#include "vfplan/rules/paper.hpp"
#include "vfplan/rules/robust.hpp"
#include "vfplan/rules/rule.hpp"

namespace vfplan {

namespace detail {

/// A rule in the space in which the proxy moves. It gives forces, and answers a bad HIP.
template <class Space, ProxyRule RuleOf>
class RuleInSpace : public EngineImpl {
  public:
    static constexpr int D = Space::dimension;

    /// `of_rule`: what the rule is made of. It is made in its place, for it is large.
    template <class... OfRule>
    RuleInSpace(Space space, const Parameters& p, OfRule&&... of_rule)
        : EngineImpl(std::max({p.stiffness[0], p.stiffness[1], p.stiffness[2]}), p.R(), p.band),
          space_(space),
          rule_(std::forward<OfRule>(of_rule)...),
          stiffness_{p.stiffness} {}

    void reset(const Vec3& hip) noexcept final {
        rule_.reset();
        last_ = {};
        is_placed_ = is_good(hip);
        if (!is_placed_) return;
        last_.proxy = hip;
        proxy_ = space_.project(hip);
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
        const Vec<D> h = space_.project(hip);
        const RuleAnswer<D> answer = rule_.step(proxy_, h);
        last_.proxy = space_.place(proxy_, hip, h);
        last_.normal = space_.direction(answer.normal);
        last_.force = stiffness_.force(space_, proxy_ - h);
        last_.state = answer.state;
        last_.status = answer.status;
        return last_;
    }
    bool planar() noexcept final { return D == 2; }
    double work_time() noexcept final { return rule_.work_time(); }

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
    /// `points`: those that the rule looks at, all or a thinned cloud. `all`: all of them, where
    /// the rule has not.
    template <class Points>
    CloudEngine(Space space, const Parameters& p, const Points& points, const Kernels<D>& kernels,
                std::unique_ptr<PointIndex<D>> all)
        : RuleInSpace<Space, RuleOf>(space, p, points, p, kernels),
          kernels_(kernels),
          all_(std::move(all)) {}

    void remove(std::size_t id) noexcept override {
        if constexpr (is_editable) this->rule_.point_changed(index().remove(id), false);
    }
    void add(const Vec3& point) noexcept override {
        if constexpr (is_editable) {
            const Vec<D> p = this->space_.project(point);
            index().add(p);
            this->rule_.point_changed(p, true);
        }
    }
    std::size_t bytes() noexcept override {
        return sizeof(*this) + this->rule_.neighbours().bytes() + (all_ ? all_->bytes() : 0);
    }
    std::size_t cells() noexcept override { return index().cells(); }
    double distance_within(const Vec3& x, double reach) noexcept override {
        return vfplan::distance_within(index(), kernels_, this->space_.project(x), reach);
    }
    double distance(const Vec3& x) noexcept override {
        return vfplan::distance(all_ ? *all_ : index(), kernels_, this->space_.project(x));
    }

  private:
    static constexpr bool is_editable =
        requires(RuleOf& rule, const Vec<D>& p) { rule.point_changed(p, true); };

    PointIndex<D>& index() noexcept { return this->rule_.neighbours().index(); }

    Kernels<D> kernels_;
    std::unique_ptr<PointIndex<D>> all_;
};

/// A rule among lines and arcs, or triangles.
template <class Space, class RuleOf>
struct GeometryEngine final : RuleInSpace<Space, RuleOf> {
    using RuleInSpace<Space, RuleOf>::RuleInSpace;
    std::size_t bytes() noexcept override { return sizeof(*this) + this->rule_.bytes(); }
    std::size_t cells() noexcept override { return this->rule_.cells(); }
    double distance(const Vec3& x) noexcept override {
        return this->rule_.distance(this->space_.project(x));
    }
    double distance_within(const Vec3& x, double reach) noexcept override {
        return std::min(distance(x), reach);
    }
};

template <class Space, int D>
ImplPtr make_robust(Space space, const Thinned<D>& cloud, const Parameters& p,
                    const Kernels<D>& loops, std::unique_ptr<PointIndex<D>> all) {
    return std::make_unique<CloudEngine<Space, RobustRule<D>>>(space, p, cloud, loops,
                                                               std::move(all));
}

template <class Space, int D>
ImplPtr make_paper(Space space, const Cloud<D>& cloud, const Parameters& p,
                   const Kernels<D>& loops) {
    return std::make_unique<CloudEngine<Space, PaperRule<D>>>(space, p, cloud, loops, nullptr);
}

template <class Space>
ImplPtr make_in_space(Space space, const double* xyz, std::size_t n, const Parameters& p,
                      Width width) {
    constexpr int D = Space::dimension;
    Cloud<D> cloud = make_cloud(space, xyz, n);
    check_resolved(p, xyz, n);
    const Kernels<D> loops = kernels<D>(width);
    if (p.rule == Rule::paper) return make_paper(space, cloud, p, loops);
    const Thinned<D> thinned_cloud = thinned(cloud, p);
    std::unique_ptr<PointIndex<D>> all;
    if (thinned_cloud.lent > 0)
        all = std::make_unique<PointIndex<D>>(cloud, 2 * tuned::list_margin * p.R(), Search::grid);
    return make_robust(space, thinned_cloud, p, loops, std::move(all));
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
        space, p, curve::Curve(strokes, space, p.R()), p);
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
        Space{}, p, std::move(triangles), std::move(body), p);
}

/// The work of the worst tick that a search finds [s]. It tries many places of the geometry for a
/// few ticks each, the more laborious half of them for twice as long, and so on, to one place in
/// the end. A HIP starts near a place or on it, perhaps inside, and is led at up to 3 m/s to random
/// goals: most of them close, some far behind, and one in four at another place of the geometry, so
/// that much may lie between the HIP and its proxy. The work is counted and not timed, so that the
/// search finds the same everywhere.
inline double most_work_found(EngineImpl& engine, const std::vector<Vec3>& geometry) {
    constexpr std::size_t places = 256;
    constexpr int first_ticks = 16;
    constexpr int ticks_a_goal = 30;
    constexpr double share_of_far_goals = 0.25;
    constexpr double share_of_starts_on_it = 0.125;  // where a sum of directions may cancel
    constexpr double furthest_goal = 8;              // [R]; proxies that turn round a ring need it
    constexpr double largest_step = 3e-3;            // of a HIP of 3 m/s in a tick [m]

    std::uint64_t state = 42;
    const auto random = [&state](double low, double high) {
        state = state * 6364136223846793005ull + 1442695040888963407ull;
        return low + (high - low) * static_cast<double>(state >> 11) * 0x1p-53;
    };
    const auto any_place = [&] {
        const double number = random(0, static_cast<double>(geometry.size()));
        return geometry[static_cast<std::size_t>(number)];
    };
    const auto around = [&](const Vec3& place, double reach) {
        Vec3 x;
        for (int k = 0; k < 3; ++k) x[k] = place[k] + random(-reach, reach);
        return x;
    };
    const auto most_work = [&](const Vec3& place, int ticks) {
        double start_reach = 0;
        if (random(0, 1) >= share_of_starts_on_it) start_reach = random(0, 3) * engine.radius;
        Vec3 hip = around(place, start_reach);
        Vec3 goal = place;
        double most = 0;
        engine.reset(hip);
        for (int t = 0; t < ticks; ++t) {
            if (t % ticks_a_goal == 0) {
                if (random(0, 1) < share_of_far_goals) {
                    goal = around(any_place(), engine.radius);
                } else {
                    const double share = random(0, 1);
                    goal = around(place, furthest_goal * share * share * share * engine.radius);
                }
            }
            const Vec3 way = goal - hip;
            hip = hip + along(way, std::min(norm(way), largest_step));
            const double before = engine.work_time();
            engine.step(hip);
            most = std::max(most, engine.work_time() - before);
        }
        return most;
    };

    struct Place {
        double work;
        Vec3 at;
    };
    std::vector<Place> tried;
    for (std::size_t i = 0; i < places; ++i) tried.push_back({0, any_place()});
    double most = 0;
    for (int ticks = first_ticks; !tried.empty(); ticks *= 2) {
        for (Place& place : tried) {
            place.work = most_work(place.at, ticks);
            most = std::max(most, place.work);
        }
        std::stable_sort(tried.begin(), tried.end(),
                         [](const Place& a, const Place& b) { return a.work > b.work; });
        tried.resize(tried.size() / 2);
    }
    return most;
}

/// What a search misses of the worst tick, and what a count misses of its time. docs/engine.md has
/// the bound over the worst tick measured for it.
inline constexpr double search_margin = 2.2;

/// What a tick takes besides that no count tells [s]: the first one reads memory that no cache
/// holds yet.
inline constexpr double uncounted_time = 3e-6;

/// `search_margin` times what the search finds, and what is not counted, but no more than is
/// proven [s].
inline double bound_by_search(EngineImpl& engine, const std::vector<Vec3>& geometry,
                              double proven) {
    return std::min(proven, uncounted_time + search_margin * most_work_found(engine, geometry));
}

inline std::vector<Vec3> rows_of(const double* xyz, std::size_t n) {
    std::vector<Vec3> rows(n);
    for (std::size_t i = 0; i < n; ++i) rows[i] = {{xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]}};
    return rows;
}

/// The robust rule's: in each iteration it looks at the points in its list, and at those that touch
/// one by one.
template <int D>
double proven_robust_time(const Cloud<D>& cloud, const Parameters& p) {
    constexpr double an_iteration = 4.5e-6;  // [s]
    constexpr double a_point = 1.25e-9;      // in the list [s]
    constexpr double a_contact = 10e-9;      // [s]
    constexpr double beside = 16;            // iterations: what a tick does beside them
    const ContactSurfaces<D> surfaces(kernels<D>(Width::automatic), p.R(), p.band);
    const double list = std::max((1 + tuned::list_margin) * p.R(), surfaces.reach());
    const double near = most_within(cloud, list + 0.75 * tuned::list_margin * p.R());
    // From R - band to the shell, on one surface: as far around the foot.
    const double inner = p.R() - p.band, outer = surfaces.touch_radius();
    const double touching = most_within(cloud, std::sqrt(outer * outer - inner * inner));
    return (p.max_iterations + beside) * (an_iteration + a_point * near + a_contact * touching);
}

/// The paper's rule: it gathers its list, and goes through it five times at most.
template <int D>
double proven_paper_time(const Cloud<D>& cloud, const Parameters& p) {
    constexpr double a_tick = 15e-6;   // [s]
    constexpr double a_point = 10e-9;  // [s]
    const double reach = p.outer_radius + p.point_radius;
    return a_tick + a_point * most_within(cloud, 1.05 * reach);
}

template <class Space>
double tick_time_in_space(Space space, const double* xyz, std::size_t n, const Parameters& p,
                          bool searches) {
    constexpr int D = Space::dimension;
    Cloud<D> cloud = make_cloud(space, xyz, n);
    const Kernels<D> loops = kernels<D>(Width::automatic);
    ImplPtr engine;
    double proven;
    if (p.rule == Rule::paper) {
        proven = proven_paper_time(cloud, p);
        if (searches) engine = make_paper(space, cloud, p, loops);
    } else {
        const Thinned<D> all = thinned(std::move(cloud), p);
        proven = proven_robust_time(all.cloud, p);
        if (searches) engine = make_robust<Space, D>(space, all, p, loops, nullptr);
    }
    // A search seldom meets the tick that uses hundreds of iterations.
    constexpr int max_searched_iterations = 32;
    const bool has_long_ticks =
        p.rule == Rule::robust && p.max_iterations > max_searched_iterations;
    if (!searches || has_long_ticks) return proven;
    return bound_by_search(*engine, rows_of(xyz, n), proven);
}

inline double tick_time_of(const double* xyz, std::size_t n, const Parameters& p, bool searches) {
    check(p);
    if (p.ignore_axis) return tick_time_in_space(Slice(*p.ignore_axis), xyz, n, p, searches);
    return tick_time_in_space(Space{}, xyz, n, p, searches);
}

VFPLAN_COMPILED_ONCE bool is_too_dense(const double* xyz, std::size_t n, const Parameters& p) {
    return !(tick_time_of(xyz, n, p, false) <= max_tick_time);
}

}  // namespace detail

VFPLAN_COMPILED_ONCE double proven_tick_time(const double* xyz, std::size_t n,
                                             const Parameters& p) {
    return detail::tick_time_of(xyz, n, p, false);
}

VFPLAN_COMPILED_ONCE double proven_tick_time(const std::vector<Stroke>& strokes,
                                             const Parameters& p) {
    constexpr double an_iteration = 9.5e-6;  // [s]
    constexpr double a_feature = 12.5e-9;    // [s]
    check(strokes);
    if (!p.ignore_axis) reject("rule exact needs an ignore_axis: it is planar");
    const curve::Curve curve(strokes, Slice(*p.ignore_axis), p.R());
    std::vector<Box<2>> boxes;
    for (std::size_t i = 0; i < curve.size(); ++i) boxes.push_back(curve[static_cast<int>(i)].box);
    const double near = most_within(boxes, curve::CurveRule::list_reach * p.R());
    return curve::CurveRule::max_iterations * (an_iteration + a_feature * near);
}

VFPLAN_COMPILED_ONCE double proven_tick_time(const mesh::Surface& surface, const Parameters& p) {
    constexpr double a_triangle = 4;  // steps
    mesh::check(surface);
    std::vector<Box<3>> boxes;
    boxes.reserve(surface.k);
    for (std::size_t i = 0; i < surface.k; ++i) {
        const mesh::Face face = mesh::face_of(surface, i);
        const Vec3 first = mesh::corner_of(surface, face[0]);
        boxes.push_back({first, first});
        boxes.back().include(mesh::corner_of(surface, face[1]));
        boxes.back().include(mesh::corner_of(surface, face[2]));
    }
    const double near = most_within(boxes, mesh::MeshRule::list_reach * p.R());
    return mesh::MeshRule::a_step * (3 * mesh::MeshRule::max_steps + a_triangle * near);
}

VFPLAN_COMPILED_ONCE double tick_time_bound(const double* xyz, std::size_t n, const Parameters& p) {
    return detail::tick_time_of(xyz, n, p, true);
}

VFPLAN_COMPILED_ONCE double tick_time_bound(const std::vector<Stroke>& strokes,
                                            const Parameters& p) {
    const double proven = proven_tick_time(strokes, p);
    std::vector<Vec3> corners;
    for (const Stroke& stroke : strokes) {
        const auto more = detail::rows_of(stroke.vertices.data(), stroke.vertices.size() / 3);
        corners.insert(corners.end(), more.begin(), more.end());
    }
    return detail::bound_by_search(*detail::make_impl(strokes, p), corners, proven);
}

VFPLAN_COMPILED_ONCE double tick_time_bound(const mesh::Surface& surface, const Parameters& p) {
    const double proven = proven_tick_time(surface, p);
    return detail::bound_by_search(*detail::make_impl(surface, p),
                                   detail::rows_of(surface.points, surface.n), proven);
}

}  // namespace vfplan
