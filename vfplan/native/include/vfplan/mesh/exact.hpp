// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Rule `exact` for a mesh: the proxy among triangles, not among samples of them.
//
// A step is the one nearest to the HIP that keeps to all planes met so far, swept anew until it
// meets no other triangle. Free space between planes is convex: no step passes through anything,
// and each brings the proxy nearer to the HIP. GuardedRule (rules/rule.hpp) checks where the proxy
// has come to.
#pragma once

#include "vfplan/mesh/smooth.hpp"
#include "vfplan/rules/rule.hpp"

namespace vfplan::inline v1::mesh {

/// How the rule moves a proxy that is outside.
class MeshMotion {
  public:
    static constexpr int dimension = 3;
    static constexpr bool rest_is_final = true;
    static constexpr int max_iterations = 16;
    /// Inner steps after which none of the three parts of a tick begins anything more, and after
    /// which the tick does not.
    static constexpr int max_steps = 4000;
    static constexpr int enough_steps = 6000;
    /// After which a tick does nothing more but to look once through what is around the proxy.
    static constexpr int all_steps = 12'000;
    /// What the last thing that a tick has begun takes beyond that at most.
    static constexpr int last_steps = 100;
    /// Time of an inner step [s], on the machine of docs/engine.md.
    static constexpr double a_step = 16e-9;
    /// How far away the triangles lie at most that a tick looks at [R].
    static constexpr double list_reach = TriangleQuery::reach;

    /// The triangles keep the proxy R less the body's rise away, and have what is left of the band.
    MeshMotion(Mesh mesh, SmoothBody body, const Parameters& p)
        : R_(p.R() - body.rise()),
          band_(p.band - body.rise()),
          neighbourhood_(p.outer_radius + p.point_radius),
          query_(std::move(mesh), R_, band_),
          planes_(R_, band_),
          body_search_(is_closed(query_.mesh()) ? &query_.mesh() : nullptr),
          body_(std::move(body), p.R(), band_) {}

    const Mesh& mesh() const noexcept { return query_.mesh(); }
    /// Inner steps of all ticks.
    std::int64_t work() const noexcept { return query_.budget().total(); }
    std::size_t bytes() const noexcept { return mesh().bytes() + body_.bytes(); }
    std::size_t cells() const noexcept { return mesh().tree().size(); }
    double distance(const Vec3& x, double reach, WorkBudget* budget) const noexcept {
        return mesh().distance(x, reach, budget);
    }
    void begin_tick() noexcept {
        query_.budget().begin_tick(max_steps, enough_steps, all_steps - last_steps);
    }
    void release() noexcept { planes_.clear(); }
    void reset() noexcept {
        release();
        body_.forget();
    }
    int iterations() const noexcept { return 1; }
    bool is_spent() const noexcept { return query_.budget().is_spent(); }
    /// Whether the tick may look once more through what is around the proxy, and not twice.
    bool is_overdrawn() const noexcept { return query_.budget().is_overdrawn(); }

    /// `before`: before a motion, where nobody asks how far away the mesh is.
    bool is_outside(const Vec3& proxy, bool before = false) noexcept {
        distance_ = before ? R_ - band_ : list_reach * R_;
        query_.nearest(proxy, distance_, planes_);
        return distance_ >= R_ - band_;
    }

    MotionEnd move(Vec3& proxy, const Vec3& hip, StallTest<3>& stall,
                   PlannedPath<3>& path) noexcept {
        settle_on_body(proxy, proxy, hip);
        if (is_settled_) {
            stall.release();
            path.record(proxy);
            return MotionEnd::settled;
        }
        query_.budget().begin(max_steps);
        const Vec3& goal = stall.goal(hip, norm(hip - proxy), 1);
        const MotionEnd end = step_to_hip(proxy, goal, path);
        if (proxy == hip) stall.release();
        return end;
    }
    /// Straight from the triangles onto the smooth body that they stand for, once the proxy rests.
    void settle(const Vec3& start, Vec3& proxy, const Vec3& hip, bool rests) noexcept {
        query_.budget().begin(max_steps);
        if (!rests) return;
        body_.hold(mesh(), proxy, planes_);
        settle_on_body(start, proxy, hip);
        if (!is_settled_) body_.lift(query_, proxy, hip, start, planes_);
    }

    RuleAnswer<3> contact(const Vec3& proxy, const Vec3& hip) noexcept {
        RuleAnswer<3> answer;
        if (distance_ <= R_ + band_) {
            answer.state = State::in_contact;
            answer.normal = planes_.count() == 1 ? planes_.normal(0) : along(proxy - hip, 1);
            if (!(dot(answer.normal, answer.normal) > 0) && !is_overdrawn())
                answer.normal = along(away_from_mesh(proxy, list_reach * R_), 1);
        } else if (is_in_neighbourhood(proxy)) {
            answer.state = State::free_motion;
        }
        if (is_settled_ && body_.count() == 1) answer.normal = body_.normal();
        return answer;
    }

    // What WayOut asks: a start may be inside of all that lies nearer to the mesh than R.

    Vec3 from_nearest(const Vec3& x) const noexcept {
        return away_from_mesh(x, R_ * (1 + tuned::reach_margin));
    }
    /// Out of what lies around the nearest triangle; nowhere yet, where the tick has no steps left.
    double exit_distance(const Vec3& y, const Vec3& direction) const noexcept {
        if (query_.budget().is_spent()) return 0;
        double distance = R_ * (1 - tuned::inside_margin);
        const std::uint32_t i = query_.nearest(y, distance);
        if (i == Mesh::none) return -infinity;
        const Triangle& t = query_.mesh()[i];
        // From beyond the end of the triangle back to the place that is R from it.
        double s = t.extent_along(direction) - dot(direction, y) + R_;
        for (int k = 0; k < 32; ++k) {
            query_.budget().spend(3);
            const Vec3 w = y + s * direction - t.nearest(y + s * direction);
            const double r = norm(w);
            const double over = r - R_;
            if (!(over > 1e-10 * R_)) break;
            s -= over * r / dot(w, direction);
        }
        return std::max(s, 0.0);
    }
    /// Whether y, with no triangle within `clear`, lies in the body; nothing where this tick may
    /// look no further.
    std::optional<bool> is_in_body(const Vec3& y, double clear) noexcept {
        return body_search_.is_inside(y, clear * (1 - 1e-9), query_.budget());
    }

  private:
    void settle_on_body(Vec3 start, Vec3& proxy, const Vec3& hip) noexcept {
        is_settled_ = body_.settle(query_, proxy, hip, start);
        if (is_settled_) distance_ = body_.count() > 0 ? 0 : infinity;
        if (!is_settled_) body_.forget();
    }
    MotionEnd step_to_hip(Vec3& proxy, const Vec3& hip, PlannedPath<3>& path) noexcept {
        for (int i = 0; i < max_iterations && !query_.budget().is_spent(); ++i) {
            const Vec3 to_hip = hip - proxy;
            const Vec3 step = round_an_edge(proxy, to_hip, free_step(proxy, to_hip));
            const double length = norm(step);
            proxy = step == to_hip ? hip : proxy + step;
            path.record(proxy);
            if (step == to_hip) return MotionEnd::rests;
            if (length < band_ / 8 && !query_.budget().is_spent()) return MotionEnd::rests;
        }
        return MotionEnd::limit;
    }

    /// The step from x that is nearest to the HIP and meets nothing. It leaves its planes.
    Vec3 free_step(const Vec3& x, const Vec3& to_hip) noexcept {
        Vec3 step = to_hip;
        const ContactPlanes before = planes_;
        planes_.clear();
        // What touched the proxy before most likely holds it again.
        for (int j = 0; j < before.count() && !query_.budget().is_spent(); ++j) {
            TriangleHit hit;
            hit.t = band_ / (norm(step) + band_);
            if (query_.meets(before.triangle(j), x, step, hit)) turn(x, to_hip, hit, step);
        }
        for (;;) {
            const TriangleHit hit = query_.sweep(x, step, planes_);
            if (hit.i == Mesh::none) return hit.t < 1 ? hit.t * step : step;
            const Vec3 tried = step;
            if (!turn(x, to_hip, hit, step)) return hit.t * tried;
        }
    }
    /// Adds a plane, while there are steps left.
    bool turn(const Vec3& x, const Vec3& to_hip, const TriangleHit& hit, Vec3& step) noexcept {
        if (query_.budget().is_spent()) return false;
        query_.spend_on_planes(planes_.count() + 1);
        return planes_.turn(x, to_hip, hit, step);
    }

    /// A step that meets one plane, further where it rounds an edge or a corner and falls away
    /// behind: at most to where it comes no nearer to the HIP.
    Vec3 round_an_edge(const Vec3& x, const Vec3& to_hip, const Vec3& step) noexcept {
        if (planes_.count() != 1 || query_.budget().is_spent()) return step;
        const Vec3 fall = planes_.first_met() * to_hip;
        const Vec3 n = planes_.normal(0);
        const Triangle& t = mesh()[planes_.triangle(0)];
        Vec3 slide = step - fall;
        int straight_sides = 0;
        for (const Vec3& side : {t.ab, t.ac, t.ac - t.ab}) {
            const double p = dot(n, side);
            const double square = dot(side, side);
            if (!(square > 0) || p * p > 1e-12 * square) continue;
            if (++straight_sides > 1) return step;  // it lies on the face, not on an edge
            slide = slide - (dot(slide, side) / square) * side;
        }
        const double left = R_ + dot(n, to_hip - fall);
        const double more = 1.9 * left > R_ ? R_ / left - 1 : 0.9;
        if (!(more > 0 && dot(slide, slide) > band_ * band_ / 64)) return step;
        const Vec3 further = step + more * slide;
        const TriangleHit hit = query_.sweep(x, further, planes_);
        return hit.i == Mesh::none && hit.t == 1 ? further : step;
    }

    bool is_in_neighbourhood(const Vec3& x) const noexcept {
        const auto is_near = [&](std::uint32_t i) noexcept {
            return mesh()[i].distance(x) < neighbourhood_;
        };
        return distance_ < neighbourhood_ || query_.finds(x, neighbourhood_, is_near);
    }
    /// From the nearest place within `reach` to x; 0 where there is none.
    Vec3 away_from_mesh(const Vec3& x, double reach) const noexcept {
        const std::uint32_t i = query_.nearest(x, reach);
        return i == Mesh::none ? Vec3{} : x - mesh()[i].nearest(x);
    }

    double R_, band_, neighbourhood_;
    TriangleQuery query_;
    ContactPlanes planes_;  // of the last step
    BodySearch body_search_;
    SmoothContact body_;
    double distance_ = infinity;  // from the mesh, where the proxy was checked last [m]
    bool is_settled_ = false;     // the proxy rests on the smooth body
};

using MeshRule = GuardedRule<MeshMotion>;

}  // namespace vfplan::inline v1::mesh
