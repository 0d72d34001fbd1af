// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Rule `exact` for a mesh: the proxy among triangles, not among samples of them.
//
// A step is the one nearest to the HIP that keeps to all walls met so far, swept anew until it
// meets no other triangle. Free space between walls is convex: no step passes through anything, and
// each brings the proxy nearer to the HIP.
#pragma once

#include <utility>

#include "vfplan/mesh/smooth.hpp"
#include "vfplan/parameters.hpp"
#include "vfplan/rules/start_inside.hpp"

namespace vfplan::mesh {

/// What a start may be inside of: all that lies nearer to the mesh than R.
class Bands {
  public:
    explicit Bands(double radius) noexcept : R_(radius) {}

    Vec3 from_nearest(const Near& near, const Vec3& x) const noexcept {
        double least = R_ * (1 + 1e-6);
        const auto i = near.nearest(x, least);
        return i == Mesh::none ? Vec3{} : x - near.mesh()[i].nearest(x);
    }
    /// Out of what lies around the nearest triangle; nowhere yet, where the tick has no steps left.
    double out(const Near& near, const Vec3& y, const Vec3& d) const noexcept {
        if (near.spent()) return 0;
        double least = R_ * (1 - 1e-9);
        const auto i = near.nearest(y, least);
        if (i == Mesh::none) return -never;
        const Triangle& t = near.mesh()[i];
        double s = t.reaches(d) - dot(d, y) + R_;  // beyond the end, and back to it
        for (int k = 0; k < 32; ++k) {
            near.take(3);
            const Vec3 w = y + s * d - t.nearest(y + s * d);
            const double r = norm(w), over = r - R_;
            if (!(over > 1e-10 * R_)) break;
            s -= over * r / dot(w, d);
        }
        return std::max(s, 0.0);
    }

  private:
    double R_;
};

class ExactRule {
  public:
    static constexpr int dimension = 3;
    /// Of R: what a file's single precision, and roundings, may let the proxy sink.
    static constexpr double finest = 1e-5;
    static constexpr double tolerance = 1e-11;  // of R: what roundings leave of a plane
    static constexpr int most_iterations = 16;
    static constexpr int most_steps = 4000;  // inner ones, of each of a tick's three parts
    static constexpr double list_reach = Near::reach;  // of R

    static double band(const Parameters& p, const Surface& s) noexcept {
        double most = 0;
        for (std::size_t i = 0; i < 3 * s.n; ++i) most = std::max(most, std::abs(s.points[i]));
        const double rounding = std::numeric_limits<double>::epsilon() * most;
        return std::max(finest * p.R(), roundings_a_band * rounding);
    }

    /// The triangles hold the proxy off by R less the body's rise: what the band has of it.
    ExactRule(Mesh mesh, Smooth smooth, const Parameters& p)
        : R_(p.R() - smooth.rise()),
          band_(p.band - smooth.rise()),
          outer_(p.outer_radius + p.point_radius),
          near_(std::move(mesh), R_, band_),
          walls_(R_, band_),
          settle_(std::move(smooth), p.R(), band_),
          entrance_(Bands(R_), R_) {}

    void reset() noexcept {
        entrance_.reset();
        rests_ = false;
        walls_.clear();
        settle_.forget();
    }
    /// As a reset, but a proxy that is inside is led out from where it is.
    void go_on(const Passage<3>* before) noexcept {
        reset();
        entrance_.go_on(before);
    }
    std::size_t bytes() const noexcept { return near_.bytes() + settle_.bytes(); }
    std::size_t cells() const noexcept { return mesh().boxes(); }
    double distance(const Vec3& x) const noexcept {
        double least = never;
        int steps = 0;  // of no tick
        mesh().nearest(x, least, steps);
        return least;
    }

    /// One servo loop.
    Tick<3> operator()(Vec3& proxy, const Vec3& hip) noexcept {
        near_.grant(most_steps);
        const auto clear = [&]() noexcept {
            double least = R_ - band_;
            return near_.nearest(proxy, least) == Mesh::none;
        };
        if (!entrance_.outside(near_, proxy, hip, clear)) {
            walls_.clear();
            rests_ = false;
            return entrance_.tick();
        }
        if (rests_ && hip == hip_) return last_;
        hip_ = hip;
        if (!entrance_.taking_over() && settle_(near_, proxy, hip, proxy))
            return last_ = settled(proxy, hip);
        const Vec3 start = proxy;
        near_.grant(most_steps);
        Tick<3> tick;
        const bool taking_over = entrance_.taking_over();
        Leash<3> leash{};
        if (taking_over) leash = entrance_.leash(proxy, hip);
        const End end = go(proxy, hip, taking_over ? &leash : nullptr);
        if (taking_over && entrance_.goes_on(end == End::leash, end == End::limit))
            tick.status = inside;
        if (end == End::limit) tick.status |= limit;
        double near = near_.nearest(proxy, walls_);
        if (!(near >= R_ - band_)) {  // cannot happen; if it does, stay where it was safe
            proxy = start;
            walls_.clear();
            near = near_.nearest(proxy, walls_);
            tick.status |= limit;
            entrance_.hold(near >= R_ - band_);
        }
        rests_ = tick.status == ok;
        near_.grant(most_steps);
        settle_.hold(mesh(), proxy, walls_);
        if (rests_ && settle_(near_, proxy, hip, start)) return last_ = settled(proxy, hip);
        settle_.forget();
        if (rests_) settle_.lift(near_, proxy, hip, start, walls_);
        describe(proxy, hip, near, tick);
        return last_ = tick;
    }

  private:
    enum class End { rest, leash, limit };

    const Mesh& mesh() const noexcept { return near_.mesh(); }

    /// From x towards the HIP at h.
    End go(Vec3& x, const Vec3& h, const Leash<3>* leash) noexcept {
        for (int i = 0; i < most_iterations && !near_.spent(); ++i) {
            const Vec3 u = h - x, v = rounds(x, u, step(x, u));
            const double length = norm(v);
            const double most =
                leash && length > 0 ? (*leash)(x, (1 / length) * v, length) : length;
            x = most < length ? x + (most / length) * v : v == u ? h : x + v;
            if (most < length) return End::leash;
            if (v == u || (length < band_ / 8 && !near_.spent())) return End::rest;
        }
        return End::limit;
    }

    /// The step from x that is nearest to u and meets nothing; it leaves its walls.
    Vec3 step(const Vec3& x, const Vec3& u) noexcept {
        Vec3 v = u;
        const Walls before = walls_;
        walls_.clear();
        for (int j = 0; j < before.count() && !near_.spent();
             ++j) {  // what touches it most likely holds it again
            Hit hit;
            hit.t = band_ / (norm(v) + band_);
            if (near_.meets(before.on(j), x, v, hit)) turn(x, u, hit, v);
        }
        for (;;) {
            const Hit hit = near_.sweep(x, v, walls_);
            if (hit.i == Mesh::none) return v;
            const Vec3 tried = v;
            if (!turn(x, u, hit, v)) return hit.t * tried;
        }
    }

    /// Another wall, while there are steps left.
    bool turn(const Vec3& x, const Vec3& u, const Hit& hit, Vec3& v) noexcept {
        if (near_.spent()) return false;
        near_.take_walls(walls_.count() + 1);
        return walls_.turn(x, u, hit, v);
    }

    /// The step v, which meets one wall, further where it rounds an edge or a corner and falls off
    /// behind: to where it comes no nearer to the HIP at most.
    Vec3 rounds(const Vec3& x, const Vec3& u, const Vec3& v) noexcept {
        if (walls_.count() != 1 || near_.spent()) return v;
        const Vec3 fall = walls_.met() * u, n = walls_.normal(0);
        const Triangle& t = mesh()[walls_.on(0)];
        Vec3 slide = v - fall;
        int straight = 0;
        for (const Vec3& side : {t.ab, t.ac, t.ac - t.ab}) {
            const double p = dot(n, side), square = dot(side, side);
            if (!(square > 0) || p * p > 1e-12 * square) continue;
            if (++straight > 1) return v;  // its face
            slide = slide - (dot(slide, side) / square) * side;
        }
        const double left = R_ + dot(n, u - fall);
        const double more = 1.9 * left > R_ ? R_ / left - 1 : 0.9;
        if (!(more > 0 && dot(slide, slide) > band_ * band_ / 64)) return v;
        const Vec3 further = v + more * slide;
        return near_.sweep(x, further, walls_).i == Mesh::none ? further : v;
    }

    Tick<3> settled(const Vec3& x, const Vec3& hip) noexcept {
        Tick<3> tick;
        rests_ = true;
        describe(x, hip, settle_.count() > 0 ? 0 : never, tick);
        if (settle_.count() == 1) tick.normal = settle_.normal();
        return tick;
    }
    void describe(const Vec3& x, const Vec3& hip, double near, Tick<3>& tick) noexcept {
        if (near <= R_ + band_) {
            tick.state = State::in_contact;
            tick.normal = walls_.count() == 1 ? walls_.normal(0) : along(x - hip, 1);
            if (!(dot(tick.normal, tick.normal) > 0)) tick.normal = away(x);
            return;
        }
        double least = outer_;
        if (near < outer_ || (seen_ < mesh().size() && mesh()[seen_].distance(x) < outer_))
            tick.state = State::free_motion;
        else if ((seen_ = near_.nearest(x, least)) != Mesh::none)
            tick.state = State::free_motion;
    }
    Vec3 away(const Vec3& x) const noexcept {
        double least = Near::reach * R_;
        const auto i = near_.nearest(x, least);
        return i == Mesh::none ? Vec3{} : along(x - mesh()[i].nearest(x), 1);
    }

    double R_, band_, outer_;
    Near near_;
    Walls walls_;  // of the last step
    Settle settle_;
    Entrance<3, const Near, Bands> entrance_;
    Vec3 hip_;
    std::uint32_t seen_ = Mesh::none;  // lay near a free proxy
    Tick<3> last_;
    bool rests_ = false;
};

}  // namespace vfplan::mesh
