// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Where the proxy settles on the smooth body: at R from it, as near to the HIP as its sheets allow.
#pragma once

#include "vfplan/mesh/near.hpp"
#include "vfplan/mesh/smooth.hpp"

namespace vfplan::mesh {

class Settle {
  public:
    Settle(Smooth smooth, double radius, double band)
        : smooth_(std::move(smooth)), R_(radius), low_(radius - smooth_.rise()), band_(band) {}

    std::size_t bytes() const noexcept { return smooth_.bytes(); }
    void forget() noexcept { count_ = 0; }
    int count() const noexcept { return count_; }
    const Vec3& normal() const noexcept { return sheets_[0].n; }
    /// What a proxy at x is held by.
    void hold(const Mesh& mesh, const Vec3& x, const Walls& walls) noexcept {
        count_ = 0;
        for (int j = 0; j < walls.count(); ++j) add(mesh, walls.on(j), x);
    }

    /// From x, which nothing lies nearer to than R less the rise, straight to where the HIP at h
    /// takes it; false, x as it was, where that is not free, or further from the HIP: `hold` anew.
    bool operator()(const Near& near, Vec3& x, const Vec3& h, const Vec3& start) noexcept {
        if (!(smooth_.rise() > 0)) return false;
        const double far = furthest(h, start);
        for (Vec3 y = x; !near.spent() && solve(near, x, h, y);) {
            std::uint32_t more = Mesh::none;
            if (!(norm(h - y) <= far && free(near, x, y, more))) return false;
            if (more == Mesh::none) {
                x = y;
                drop(y);
                return true;
            }
            if (count_ == most) return false;
            add(near.mesh(), more, x);
        }
        return false;
    }
    /// Up to R over the walls that a proxy at x has, where it settles on nothing.
    void lift(const Near& near, Vec3& x, const Vec3& h, const Vec3& start,
              const Walls& walls) noexcept {
        if (!(smooth_.rise() > 0)) return;
        Wall<3> w[most];
        for (int j = 0; j < walls.count(); ++j) w[j] = {walls.normal(j), R_ - walls.height(j, x)};
        const Vec3 y = x + project(h - x, w, walls.count(), band_ / 16, Walls::flattest);
        near.take_walls(walls.count());
        std::uint32_t more = Mesh::none;
        if (!(y == x) && norm(h - y) <= furthest(h, start) && free(near, x, y, more)) x = y;
    }

  private:
    static constexpr int most = Walls::most;

    /// A part of the body that may hold the proxy: its foot, with the normal towards the proxy.
    struct Sheet : Foot {
        std::uint32_t from = Mesh::none;  // the triangle that it was found by
        double side = 1;                  // of the triangles on which the proxy is
    };

    void add(const Mesh& mesh, std::uint32_t i, const Vec3& x) noexcept {
        Sheet& s = sheets_[count_++];
        s.from = s.i = i;
        s.side = dot(cross(mesh[i].ab, mesh[i].ac), x - mesh[i].a) < 0 ? -1 : 1;
    }
    bool look(const Near& near, const Vec3& y, Sheet& s) const noexcept {
        const bool found = smooth_.foot(near.mesh(), y, s.i, s);
        near.take(6 * s.steps);
        if (!found) return false;
        if (!s.edge) s.n = s.side * s.n;
        return true;
    }
    double furthest(const Vec3& h, const Vec3& start) const noexcept {
        return norm(h - start) + smooth_.rise() + band_ / 2;
    }
    bool solve(const Near& near, const Vec3& x, const Vec3& h, Vec3& y) noexcept {
        y = h;
        return count_ == 0 || one(near, x, h, y) || several(near, x, h, y);
    }
    /// On one sheet: above the HIP's own foot.
    bool one(const Near& near, const Vec3& x, const Vec3& h, Vec3& y) noexcept {
        for (int j = 0; j < count_; ++j) {
            Sheet& s = sheets_[j];
            if (!look(near, h, s) || !(dot(s.n, x - s.at) > R_ / 2)) return false;
            const Vec3 off = s.at - sheets_[0].at;
            if (dot(off, off) > band_ * band_) return false;
        }
        const Sheet& s = sheets_[0];
        y = dot(h - s.at, s.n) < R_ ? s.at + R_ * s.n : h;
        return true;
    }
    /// Between sheets, or round an edge: plane after plane.
    bool several(const Near& near, const Vec3& x, const Vec3& h, Vec3& y) noexcept {
        constexpr int turns = 12;
        y = x;
        Wall<3> walls[most];
        for (int k = 0; k < turns && !near.spent(); ++k) {
            for (int j = 0; j < count_; ++j) {
                Sheet& s = sheets_[j];
                if (!look(near, y, s)) return false;
                walls[j] = {s.n, R_ - dot(y - s.at, s.n)};
            }
            const Vec3 v = project(h - y, walls, count_, band_ / 16, Walls::flattest);
            near.take_walls(count_);
            if (!detail::keeps(v, walls, count_, band_ / 16)) return false;
            y = y + v;
            if (dot(v, v) < band_ * band_ / 64) return true;
        }
        return false;
    }

    /// Whether nothing is nearer to the way from x to y than R less the rise. `more`: a triangle
    /// whose sheet may hold the proxy at y, and is not among those known.
    bool free(const Near& near, const Vec3& x, const Vec3& y, std::uint32_t& more) const noexcept {
        const Vec3 v = y - x;
        const double length = norm(v);
        if (!(length <= R_ / 2)) return false;
        Hit hit;
        double worst = 0;
        bool blocked = false;
        near.take(near.mesh().around(x + 0.5 * v, R_ + smooth_.rise() + length / 2,
                                     [&](std::uint32_t i) noexcept {
                                         const Triangle& t = near.mesh()[i];
                                         if (blocked || behind(t, x)) return;
                                         const double d = t.distance(y);
                                         if (d < low_ + length) blocked = near.meets(i, x, v, hit);
                                         const double lacks = R_ + smooth_.rise(i) - band_ / 2 - d;
                                         if (lacks > worst && !known(i)) worst = lacks, more = i;
                                     }));
        return !blocked;
    }
    bool behind(const Triangle& t, const Vec3& x) const noexcept {
        for (int j = 0; j < count_; ++j) {
            const Sheet& s = sheets_[j];
            const double top = t.reaches(s.n);
            if (top <= dot(s.n, s.at) + band_ / 4 && dot(s.n, x) >= top + low_) return true;
        }
        return false;
    }
    bool known(std::uint32_t i) const noexcept {
        for (int j = 0; j < count_; ++j)
            if (i == sheets_[j].from || smooth_.touch(i, sheets_[j].i)) return true;
        return false;
    }
    /// Keeps what holds the proxy at y, each sheet once.
    void drop(const Vec3& y) noexcept {
        int kept = 0;
        for (int j = 0; j < count_; ++j) {
            Sheet s = sheets_[j];
            bool holds = dot(y - s.at, s.n) <= R_ + band_;
            for (int k = 0; k < kept; ++k)
                if (const Vec3 off = s.at - sheets_[k].at; dot(off, off) < band_ * band_)
                    holds = false;
            s.from = s.i;
            if (holds) sheets_[kept++] = s;
        }
        count_ = kept;
    }

    Smooth smooth_;
    double R_, low_, band_;
    Sheet sheets_[most];
    int count_ = 0;
};

}  // namespace vfplan::mesh
