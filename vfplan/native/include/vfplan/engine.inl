// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The rules in their spaces, behind the type that an engine holds, and the most time that a tick of
// each rule takes. engine.hpp, which a controller includes, declares what is defined here.
#pragma once

#include "vfplan/curve/exact.hpp"
#include "vfplan/exchange.hpp"
#include "vfplan/mesh/exact.hpp"
#include "vfplan/rules/paper.hpp"
#include "vfplan/rules/robust.hpp"

namespace vfplan::inline v1 {

namespace detail {

/// A rule in the space in which the proxy moves. It gives forces, and answers a bad HIP.
template <class Space, class RuleOf>
class RuleInSpace : public EngineImpl, FreeBefore<Space::dimension> {
  public:
    static constexpr int D = Space::dimension;
    /// Least distance between places along a way that are looked at, in R: no wall is passed over.
    static constexpr double stride = 1 / 8.0;

    /// `of_rule`: what the rule is made of. It is made in its place, for it is large.
    template <class... OfRule>
    RuleInSpace(Space space, const Parameters& p, OfRule&&... of_rule)
        : EngineImpl(p), space_(space), rule_(std::forward<OfRule>(of_rule)...) {}

    void reset(const Vec3& hip) noexcept final {
        rule_.reset();
        last_ = {};
        is_placed_ = is_within_range(hip);
        if (!is_placed_) return;
        last_.proxy = hip;
        proxy_ = space_.project(hip);
    }
    void continue_from(const Vec3& proxy, EngineImpl* previous) noexcept final {
        reset(proxy);
        from_ = proxy;
        previous_ = previous;
        seen_ = Vec3{};
        rule_.continue_from(previous ? this : nullptr);
    }

    std::optional<Vec3> end_of_way() noexcept final {
        const std::optional<Vec<D>> end = rule_.end_of_way(proxy_);
        return end ? std::optional(space_.place(*end, last_.proxy, proxy_)) : std::nullopt;
    }
    Step step(const Vec3& hip) noexcept final {
        if (!is_within_range(hip)) {
            Step s = last_;  // all 0 before there was any proxy: a controller is never given a NaN
            s.status = Status::bad_hip;
            return s;
        }
        if (!is_placed_) reset(hip);
        const Vec<D> h = space_.project(hip);
        const RuleAnswer<D> answer = rule_.step(proxy_, h);
        look.begin(look_steps);
        last_.proxy = space_.place(proxy_, hip, h);
        last_.normal = space_.direction(answer.normal);
        last_.force = spring_force(parameters.stiffness, space_, proxy_ - h);
        last_.state = answer.state;
        last_.status = answer.status;
        // Field by field: a copy of the whole would wait until the fields have reached the cache.
        return {last_.proxy, last_.normal, last_.force, last_.state, last_.status};
    }
    /// Of a rule whose points cannot be edited, K alone changes.
    void change(const PendingChange& change) noexcept override {
        this->parameters.stiffness = change.point;
    }

  protected:
    Space space_;
    RuleOf rule_;

  private:
    /// In the space around the previous engine's geometry.
    std::optional<bool> is_free(const Vec<D>& direction, double length,
                                const Vec<D>& out) noexcept final {
        const double R = previous_->parameters.R(), enough = R - 2 * previous_->parameters.band;
        const auto distance = [&](const Vec3& x) { return previous_->distance(x, 2 * R, &look); };
        const Vec3 way = space_.direction(direction), up = 2 * stride * R * space_.direction(out);
        // A place for which all steps of a tick do not suffice counts as none; else it waits for
        // the next tick.
        bool had_all = look.is_fresh();
        if (!(way == seen_)) {
            const double below = distance(from_ - up), above = distance(from_ + up);
            if (!std::exchange(had_all, false) && look.is_spent()) return std::nullopt;
            if (above < below) return false;
            seen_ = way, seen_to_ = 0;
        }
        while (!look.is_spent()) {
            const double free = distance(from_ + seen_to_ * way) - enough;
            if (!std::exchange(had_all, false) && look.is_spent()) return std::nullopt;
            if (!(free >= 0) || seen_to_ >= length) return free >= 0;
            seen_to_ = std::min(seen_to_ + std::max(free, stride * R), length);
        }
        return std::nullopt;
    }

    EngineImpl* previous_ = nullptr;
    Vec3 from_;           // where the proxy was when it was exchanged
    Vec3 seen_;           // the way that was looked along last
    double seen_to_ = 0;  // as far as that was free [m]
    Vec<D> proxy_;
    Step last_;
    bool is_placed_ = false;
};

/// A rule among points.
template <class Space, class RuleOf>
class CloudEngine final : public RuleInSpace<Space, RuleOf> {
    static constexpr int D = Space::dimension;

  public:
    /// `all`: all points, where the rule has a thinned cloud. `of_rule`: what the rule is made of.
    template <class... OfRule>
    CloudEngine(Space space, const Parameters& p, std::unique_ptr<PointIndex<D>> all,
                OfRule&&... of_rule)
        : RuleInSpace<Space, RuleOf>(space, p, std::forward<OfRule>(of_rule)...),
          all_(std::move(all)) {}

    void change(const PendingChange& change) noexcept override {
        if (change.what == PendingChange::stiffness) {
            RuleInSpace<Space, RuleOf>::change(change);
        } else if constexpr (is_editable) {
            const bool is_added = change.what == PendingChange::add;
            Vec<D> p = this->space_.project(change.point);
            if (is_added)
                index().add(p);
            else
                p = index().remove(change.id);
            motion().set_skin(nullptr);
            this->rule_.surroundings_changed(motion().neighbours().reaches(p), is_added);
        }
    }
    void set_skin(const mesh::Surface& surface) override {
        if constexpr (is_editable && D == 3) {
            skin_ = std::make_unique<mesh::Mesh>(surface);
            if (!mesh::is_closed(*skin_)) skin_.reset();
            motion().set_skin(skin_.get());
        }
    }
    std::size_t bytes() noexcept override {
        return sizeof(*this) + motion().neighbours().bytes() + (all_ ? all_->bytes() : 0) +
               (skin_ ? skin_->bytes() : 0);
    }
    std::size_t cells() noexcept override { return index().cells(); }
    double distance(const Vec3& x, double reach, WorkBudget* budget) noexcept override {
        const Vec<D> at = this->space_.project(x);
        if (!(reach < infinity)) return vfplan::distance(all_ ? *all_ : index(), at);
        if (budget && budget->is_spent()) return 0;
        const std::int64_t before = index().budget().total();
        const double found = distance_within(index(), at, reach);
        if (budget) budget->spend((index().budget().total() - before) / work::triangle);
        return found;
    }

  private:
    static constexpr bool is_editable =
        requires(RuleOf& rule) { rule.surroundings_changed(true, true); };

    auto& motion() noexcept { return this->rule_.motion(); }
    PointIndex<D>& index() noexcept { return motion().neighbours().index(); }

    std::unique_ptr<PointIndex<D>> all_;
    std::unique_ptr<mesh::Mesh> skin_;
};

/// A rule among lines and arcs, or triangles.
template <class Space, class RuleOf>
struct GeometryEngine final : RuleInSpace<Space, RuleOf> {
    using RuleInSpace<Space, RuleOf>::RuleInSpace;
    std::size_t bytes() noexcept override { return sizeof(*this) + this->rule_.motion().bytes(); }
    std::size_t cells() noexcept override { return this->rule_.motion().cells(); }
    double distance(const Vec3& x, double reach, WorkBudget* budget) noexcept override {
        return this->rule_.motion().distance(this->space_.project(x), reach, budget);
    }
};

template <class Space>
ImplPtr make_in_space(Space space, const double* xyz, std::size_t n, const Parameters& p) {
    constexpr int D = Space::dimension;
    Cloud<D> cloud = make_cloud(space, xyz, n);
    check_resolved(p, xyz, n);
    if (p.rule == Rule::paper)
        return std::make_unique<CloudEngine<Space, PaperRule<D>>>(space, p, nullptr, cloud, p);
    const Thinned<D> thinned_cloud = thinned(cloud, p);
    std::unique_ptr<PointIndex<D>> all;
    if (thinned_cloud.lent > 0)
        all = std::make_unique<PointIndex<D>>(cloud, 2 * tuned::list_margin * p.R(), Search::grid);
    return std::make_unique<CloudEngine<Space, RobustRule<D>>>(space, p, std::move(all), p.R(),
                                                               p.band, p.pace(), thinned_cloud, p);
}

VFPLAN_ONCE ImplPtr make_impl(const double* xyz, std::size_t n, const Parameters& p) {
    check(p);
    if (p.rule == Rule::exact) reject("rule exact renders a curve, not points");
    if (p.ignore_axis) return make_in_space(Slice(*p.ignore_axis), xyz, n, p);
    return make_in_space(Space{}, xyz, n, p);
}

VFPLAN_ONCE ImplPtr make_impl(const std::vector<Stroke>& strokes, Parameters p) {
    double largest = 0;
    for (const Stroke& s : strokes)
        largest = std::max(largest, largest_of(s.vertices.data(), s.vertices.size() / 3));
    p.band = exact_band(p, largest);
    check(p);
    check(strokes);
    if (!p.ignore_axis) reject("rule exact needs an ignore_axis: it is planar");
    const Slice space(*p.ignore_axis);
    return std::make_unique<GeometryEngine<Slice, curve::CurveRule>>(
        space, p, p.R(), p.band, p.pace(), curve::Curve(strokes, space, p.R()), p);
}

VFPLAN_ONCE ImplPtr make_impl(const mesh::Surface& surface, Parameters p) {
    mesh::check(surface);
    p.band = exact_band(p, largest_of(surface.points, surface.n));
    check(p);
    if (p.ignore_axis) reject("rule exact renders a mesh in space: without an ignore_axis");
    mesh::Mesh triangles(surface);
    mesh::SmoothBody body(triangles, p.R());
    const double rise = body.rise();
    p.band += rise;
    return std::make_unique<GeometryEngine<Space, mesh::MeshRule>>(
        Space{}, p, p.R() - rise, p.band - rise, p.pace(), std::move(triangles), std::move(body),
        p);
}

/// A tick may do so many iterations, or what its budget allows, and four of them beside: the one
/// under way when the budget is spent, the check of where it ends, and the contact there.
inline double time_of(double iterations, double budget, double an_iteration) {
    return std::min(iterations * an_iteration, budget) + 4 * an_iteration;
}

/// An iteration of the robust rule looks several times at the points in its list, and at those that
/// touch one by one.
template <int D>
double robust_tick_time(const Cloud<D>& cloud, const Parameters& p) {
    constexpr double an_iteration = 6e-6;  // with its choices of planes [s]
    constexpr double a_point = 1.25e-9;    // in the list [s]
    constexpr double a_contact = 10e-9;    // [s]
    constexpr double budget = 1.3e-9 * static_cast<double>(work::motion);  // among many planes
    const ContactSurfaces<D> surfaces(p.R(), p.band);
    const double list = std::max((1 + tuned::list_margin) * p.R(), surfaces.reach());
    const double near = most_within(cloud, list + 0.75 * tuned::list_margin * p.R());
    // From R - band to the shell, on one surface: as far around the foot.
    const double inner = p.R() - p.band, outer = surfaces.touch_radius();
    const double touching = most_within(cloud, std::sqrt(outer * outer - inner * inner));
    return time_of(p.max_iterations, budget, an_iteration + a_point * near + a_contact * touching);
}

template <class Space>
double tick_time_in(Space space, const double* xyz, std::size_t n, const Parameters& p) {
    constexpr int D = Space::dimension;
    Cloud<D> cloud = make_cloud(space, xyz, n);
    if (p.rule != Rule::paper) return robust_tick_time(thinned(std::move(cloud), p).cloud, p);
    // The paper's rule gathers its list, and goes through it five times at most.
    constexpr double a_tick = 15e-6;   // [s]
    constexpr double a_point = 10e-9;  // [s]
    return a_tick + a_point * most_within(cloud, 1.05 * (p.outer_radius + p.point_radius));
}

}  // namespace detail

VFPLAN_ONCE double tick_time_bound(const double* xyz, std::size_t n, const Parameters& p) {
    check(p);
    if (p.ignore_axis) return detail::tick_time_in(Slice(*p.ignore_axis), xyz, n, p);
    return detail::tick_time_in(Space{}, xyz, n, p);
}

VFPLAN_ONCE double tick_time_bound(const std::vector<Stroke>& strokes, const Parameters& p) {
    constexpr double an_iteration = 9.5e-6;  // [s]
    constexpr double a_feature = 12.5e-9;    // [s]
    using curve::CurveMotion;
    check_radii(p);
    check(strokes);
    if (!p.ignore_axis) reject("rule exact needs an ignore_axis: it is planar");
    const curve::Curve curve(strokes, Slice(*p.ignore_axis), p.R());
    std::vector<Box<2>> boxes;
    for (std::size_t i = 0; i < curve.size(); ++i) boxes.push_back(curve[i].box);
    const double near = most_within(boxes, CurveMotion::list_reach * p.R());
    return detail::time_of(CurveMotion::max_iterations,
                           CurveMotion::a_step * CurveMotion::max_steps,
                           an_iteration + a_feature * near);
}

VFPLAN_ONCE double tick_time_bound(const mesh::Surface& surface, const Parameters& p) {
    check_radii(p);
    mesh::check(surface);
    std::vector<Box<3>> boxes;
    std::vector<std::uint32_t> steps;
    mesh::Mesh(surface).tree().visit(
        [&](const mesh::Disc& disc) {
            boxes.push_back(disc.box());
            steps.push_back(2);  // one for each disc that hangs on this one
            return true;
        },
        [&](std::uint32_t) { steps.back() += 3; });
    const double query = most_within(boxes, mesh::MeshMotion::list_reach * p.R(), steps.data());
    // A tick that has done all that it may looks once more around the proxy. One that has not done
    // enough may look twice there.
    using mesh::MeshMotion;
    const double once = MeshMotion::all_steps + query;
    const double twice = MeshMotion::enough_steps + MeshMotion::last_steps + 2 * query;
    return MeshMotion::a_step * std::max(once, twice);
}

namespace detail {

VFPLAN_ONCE bool PointNumbers::fits_in_place(std::size_t m) const noexcept {
    if (is_behind_ || base_ < min_to_edit) return false;
    return next_ - base_ + m <= PointIndex<3>::max_added(base_);
}

VFPLAN_ONCE std::vector<PendingChange> PointNumbers::edit(const std::uint32_t* remove,
                                                          std::size_t n, const double* add,
                                                          std::size_t m, const Parameters& p) {
    check_coordinates(add, m);
    check_resolved(p, add, m);
    const std::size_t added = next_ - base_;
    if ((added + m) / points_a_check > added / points_a_check) {
        std::vector<double> all_added = points_left(local_.size() - added);
        all_added.insert(all_added.end(), add, add + 3 * m);
        if (!(tick_time_bound(all_added.data(), all_added.size() / 3, p) <= max_tick_time))
            reject("add: so many points in one place that a tick would take longer than 0.3 ms");
    }
    std::vector<PendingChange> all;
    all.reserve(n + m);
    for (std::size_t i = 0; i < n; ++i) {
        const bool is_there = remove[i] < local_.size() && local_[remove[i]] != gone;
        if (!is_there || left_ + m <= n) {
            for (; i-- > 0; all.pop_back()) local_[remove[i]] = all.back().id;
            reject(is_there ? "a cloud needs at least one point"
                            : "remove: each a point that is there, once");
        }
        const std::size_t id = std::exchange(local_[remove[i]], gone);
        all.push_back({PendingChange::remove, nullptr, id, {}});
    }
    for (std::size_t i = 0; i < m; ++i) {
        all.push_back({PendingChange::add, nullptr, 0, point_at(add, i)});
        local_.push_back(next_++);
    }
    xyz_.insert(xyz_.end(), add, add + 3 * m);
    left_ = left_ + m - n;
    return all;
}

}  // namespace detail

}  // namespace vfplan::inline v1
