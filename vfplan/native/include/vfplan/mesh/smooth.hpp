// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The smooth body that a mesh's facets stand for. Across a slight edge normals go over into each
// other, so that a proxy that follows them feels no facet; a sharp edge stays one.
#pragma once

#include <algorithm>
#include <utility>

#include "vfplan/mesh/triangles.hpp"

namespace vfplan::mesh {

/// Where the body lies under a place: the nearest place of it, the unit normal there.
struct Foot {
    Vec3 at, n;
    std::uint32_t i = Mesh::none;  ///< the triangle
    bool edge = false;             ///< a sharp one, or the border
    int steps = 0;                 ///< of Newton's method, to find it
};

class Smooth {
  public:
    static constexpr double slight = 0.866;    // the cosine of the sharpest edge that is smoothed
    static constexpr double most_rise = 0.05;  // of R: how far the body may be from its triangles

    Smooth(const Mesh& mesh, double radius) : bends_(mesh.size()), most_(most_rise * radius) {
        link(mesh);
        for (bool more = true; more;) {
            gather(mesh);
            more = false;
            for (std::uint32_t i = 0; i < bends_.size(); ++i) more |= bend(mesh, i);
        }
        for (const Bend& b : bends_) rise_ = std::max(rise_, b.most);
    }

    /// How far the body is from the triangles at most [m]; 0 where no edge is smoothed.
    double rise() const noexcept { return rise_; }
    double rise(std::uint32_t i) const noexcept { return bends_[i].most; }
    std::size_t bytes() const noexcept { return bends_.capacity() * sizeof(Bend); }
    /// Whether two triangles lie round a common corner of the body.
    bool touch(std::uint32_t i, std::uint32_t j) const noexcept {
        for (const std::uint32_t a : bends_[i].fan)
            for (const std::uint32_t b : bends_[j].fan)
                if (a == b) return true;
        return false;
    }

    /// The body's place on whose normal y lies, looked for from triangle i on; on an edge the
    /// nearest one. False where none is found.
    bool foot(const Mesh& mesh, const Vec3& y, std::uint32_t i, Foot& foot) const noexcept {
        constexpr int most = 64;
        foot.steps = 0;
        for (int k = 0; k < most; ++k) {
            double b[3];
            if (!place(mesh[i], bends_[i], y, b, foot)) return false;
            foot.i = i;
            int out = -1, wall = -1;
            for (int side = 0; side < 3; ++side) {
                const double over = b[(side + 2) % 3];
                if (over >= -1e-9) continue;
                int& which = bends_[i].beside[side] == Mesh::none ? wall : out;
                if (which < 0 || over < b[(which + 2) % 3]) which = side;
            }
            if (out < 0) {
                if (wall >= 0) on_edge(mesh[i], wall, y, foot);
                return true;
            }
            i = bends_[i].beside[out];
        }
        return false;
    }

  private:
    struct Bend {
        std::array<Vec3, 3> n;  // of the body, at the corners
        std::array<double, 3>
            rise{};  // of it over side k, from corner k to the next: of its middle, times 4
        double most = 0;
        std::array<std::uint32_t, 3> beside{Mesh::none, Mesh::none, Mesh::none};  // across side k
        std::array<std::uint32_t, 3> fan{};  // of the triangles round each corner, one of them
    };

    static Vec3 corner(const Triangle& t, int k) noexcept {
        return k == 0 ? t.a : k == 1 ? t.a + t.ab : t.a + t.ac;
    }

    /// Newton's method for y = place + height n, n linear between the corners' normals.
    static bool place(const Triangle& t, const Bend& e, const Vec3& y, double (&b)[3],
                      Foot& foot) noexcept {
        const Vec3 over = cross(t.ab, t.ac), w = y - t.a, u = e.n[1] - e.n[0], v = e.n[2] - e.n[0];
        const double area = dot(over, over);
        if (!(area > 0)) return false;
        double p = dot(cross(w, t.ac), over) / area, q = dot(cross(t.ab, w), over) / area;
        double h = dot(w, over) / std::sqrt(area);
        for (int k = 0; k < 12; ++k, ++foot.steps) {
            const Vec3 n = e.n[0] + p * u + q * v;
            const Vec3 off = w - p * t.ab - q * t.ac - h * n;
            const Vec3 s = t.ab + h * u, r = t.ac + h * v;
            const Vec3 sr = cross(s, r);
            const double det = dot(sr, n);
            if (!(det * det > 1e-2 * area)) return false;
            const double dp = dot(cross(off, r), n) / det, dq = dot(cross(s, off), n) / det;
            p += dp, q += dq, h += dot(sr, off) / det;
            if (std::abs(dp) + std::abs(dq) < 1e-9) {
                const Vec3 m = e.n[0] + p * u + q * v;
                b[0] = 1 - p - q, b[1] = p, b[2] = q;
                foot.n = along(m, 1);
                foot.at =
                    t.a + p * t.ab + q * t.ac +
                    (b[0] * b[1] * e.rise[0] + b[1] * b[2] * e.rise[1] + b[2] * b[0] * e.rise[2]) *
                        foot.n;
                foot.edge = false;
                return true;
            }
        }
        return false;
    }
    static void on_edge(const Triangle& t, int side, const Vec3& y, Foot& foot) noexcept {
        const Vec3 from = corner(t, side), way = corner(t, (side + 1) % 3) - from;
        const double share = dot(y - from, way) / dot(way, way);
        foot.at = from + std::min(std::max(share, 0.0), 1.0) * way;
        foot.n = along(y - foot.at, 1);
        foot.edge = true;
    }

    /// Two triangles with one side, the same one up, and hardly an edge between.
    void link(const Mesh& mesh) {
        struct Side {
            std::uint32_t from, to, i, k;
            auto key() const { return std::array{std::min(from, to), std::max(from, to), i, k}; }
            bool operator<(const Side& s) const { return key() < s.key(); }
        };
        std::vector<Side> sides;
        for (std::uint32_t i = 0; i < mesh.size(); ++i)
            for (std::uint32_t k = 0; k < 3; ++k)
                sides.push_back({mesh.face(i)[k], mesh.face(i)[(k + 1) % 3], i, k});
        std::sort(sides.begin(), sides.end());
        for (std::size_t j = 0, last; j < sides.size(); j = last) {
            const Side &s = sides[j], &t = sides[std::min(j + 1, sides.size() - 1)];
            for (last = j; last < sides.size() && sides[last].key()[0] == s.key()[0] &&
                           sides[last].key()[1] == s.key()[1];)
                ++last;
            if (last - j == 2 && s.from == t.to && s.to != s.from && even(mesh, s.i, t.i)) {
                bends_[s.i].beside[s.k] = t.i;
                bends_[t.i].beside[t.k] = s.i;
            }
        }
    }
    bool even(const Mesh& mesh, std::uint32_t i, std::uint32_t j) const {
        const Triangle &s = mesh[i], &t = mesh[j];
        const Vec3 a = cross(s.ab, s.ac), b = cross(t.ab, t.ac);
        const double c = dot(a, b), both = norm(a) * norm(b);
        return c > slight * both || (c > 0.3 * both && std::min(slim(s), slim(t)) < most_ / 100);
    }
    static double slim(const Triangle& t) {
        return norm(cross(t.ab, t.ac)) / std::sqrt(std::max({t.aa, t.bb, t.aa + t.bb - 2 * t.cc}));
    }

    /// The triangles round a corner that no edge parts; of each such fan the body's normal.
    void gather(const Mesh& mesh) {
        std::vector<std::uint32_t> fan(3 * bends_.size());
        for (std::uint32_t c = 0; c < fan.size(); ++c) fan[c] = c;
        const auto root = [&](std::uint32_t c) {
            while (fan[c] != c) c = fan[c] = fan[fan[c]];
            return c;
        };
        for (std::uint32_t i = 0; i < bends_.size(); ++i)
            for (std::uint32_t k = 0; k < 3; ++k)
                if (const std::uint32_t j = bends_[i].beside[k]; j != Mesh::none)
                    for (const std::uint32_t at : {k, (k + 1) % 3})
                        for (std::uint32_t l = 0; l < 3; ++l)
                            if (mesh.face(j)[l] == mesh.face(i)[at])
                                fan[root(3 * i + at)] = root(3 * j + l);
        for (std::uint32_t c = 0; c < fan.size(); ++c) bends_[c / 3].fan[c % 3] = root(c);
        std::vector<Vec3> normal(fan.size());
        for (std::uint32_t c = 0; c < fan.size(); ++c) {  // of a ball, its own (Max, 1999)
            const Vec3 p = side(mesh, c, 1), q = side(mesh, c, 2);
            const double squares = dot(p, p) * dot(q, q);
            if (squares > 0) normal[root(c)] = normal[root(c)] + (1 / squares) * cross(p, q);
        }
        for (Vec3& n : normal) n = along(n, 1);
        for (int k = 0; k < 8; ++k) even_out(mesh, normal);
        for (Bend& b : bends_)
            for (int k = 0; k < 3; ++k) b.n[k] = normal[b.fan[k]];
    }
    /// From corner c of all to the next of its triangle, or the one after.
    static Vec3 side(const Mesh& mesh, std::uint32_t c, int further) {
        const int k = static_cast<int>(c % 3);
        return corner(mesh[c / 3], (k + further) % 3) - corner(mesh[c / 3], k);
    }
    /// Where a body bends evenly, the normals at a side's ends lean equally from across it: half
    /// way there, by what all sides ask for.
    void even_out(const Mesh& mesh, std::vector<Vec3>& normal) const {
        std::vector<Vec3> lean(normal.size());
        std::vector<double> weight(normal.size());
        for (std::uint32_t c = 0; c < normal.size(); ++c)
            for (const int further : {1, 2}) {
                const std::uint32_t f = bends_[c / 3].fan[c % 3];
                const Vec3 s = side(mesh, c, further);
                const Vec3 both = normal[f] + normal[bends_[c / 3].fan[(c % 3 + further) % 3]];
                const double square = dot(s, s);
                if (!(square > 0)) continue;
                lean[f] = lean[f] + (dot(s, both) / (square * square)) * s;
                weight[f] += 1 / square;
            }
        for (std::uint32_t f = 0; f < normal.size(); ++f)
            if (weight[f] > 0) normal[f] = along(normal[f] - (0.5 / weight[f]) * lean[f], 1);
    }
    /// How far the body rises over a triangle; one that it would leave has edges all around. True
    /// where it had not.
    bool bend(const Mesh& mesh, std::uint32_t i) {
        Bend& b = bends_[i];
        const Triangle& t = mesh[i];
        const Vec3 up = along(cross(t.ab, t.ac), 1);
        const double least = slim(t) < most_ / 100 ? 0.3 : slight;
        bool fits = true;
        b.most = 0;
        for (int k = 0; k < 3; ++k) {
            const int l = (k + 1) % 3;
            b.rise[k] = dot(corner(t, l) - corner(t, k), b.n[l] - b.n[k]) / 2;
            b.most = std::max(b.most, std::abs(b.rise[k]) / 3);
            fits = fits && dot(b.n[k], up) > least;
        }
        if (fits && b.most <= most_) return false;
        bool cut = false;
        for (int k = 0; k < 3; ++k)
            if (const std::uint32_t j = std::exchange(b.beside[k], Mesh::none); j != Mesh::none) {
                std::replace(bends_[j].beside.begin(), bends_[j].beside.end(), i, Mesh::none);
                cut = true;
            }
        return cut;
    }

    std::vector<Bend> bends_;
    double most_, rise_ = 0;
};

}  // namespace vfplan::mesh
