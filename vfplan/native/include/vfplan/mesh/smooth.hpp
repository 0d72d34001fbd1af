// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The smooth body that a mesh's facets stand for. Across a slight edge normals go over into each
// other, so that a proxy that follows them feels no facet; a sharp edge stays one.
#pragma once

#include <algorithm>
#include <utility>

#include "vfplan/mesh/query.hpp"
#include "vfplan/mesh/triangles.hpp"

namespace vfplan::mesh {

/// Where the body lies under a place: the nearest place of it, the unit normal there.
struct Foot {
    Vec3 at, n;
    std::uint32_t i = Mesh::none;  ///< the triangle
    bool edge = false;             ///< a sharp one, or the border
    int steps = 0;                 ///< of Newton's method, to find it
};

class SmoothBody {
  public:
    static constexpr double slight = 0.866;    // the cosine of the sharpest edge that is smoothed
    static constexpr double most_rise = 0.05;  // of R: how far the body may be from its triangles

    SmoothBody(const Mesh& mesh, double radius) : facets_(mesh.size()), most_(most_rise * radius) {
        link(mesh);
        for (bool has_changed = true; has_changed;) {
            gather_normals(mesh);
            has_changed = false;
            for (std::uint32_t i = 0; i < facets_.size(); ++i) has_changed |= set_rise(mesh, i);
        }
        for (const FacetShape& b : facets_) rise_ = std::max(rise_, b.most);
    }

    /// How far the body is from the triangles at most [m]; 0 where no edge is smoothed.
    double rise() const noexcept { return rise_; }
    double rise(std::uint32_t i) const noexcept { return facets_[i].most; }
    /// Number of facets that are too coarse to be smoothed: the body would be more than R / 20 from
    /// them. The proxy feels them as they are.
    std::size_t coarse_facets() const noexcept { return coarse_facets_; }
    /// How far the body would be from the coarsest of them [m]; 0 where there is none.
    double coarsest_sagitta() const noexcept { return coarsest_sagitta_; }
    std::size_t bytes() const noexcept { return facets_.capacity() * sizeof(FacetShape); }
    /// Whether two triangles lie round a common corner of the body.
    bool touch(std::uint32_t i, std::uint32_t j) const noexcept {
        for (const std::uint32_t a : facets_[i].fan)
            for (const std::uint32_t b : facets_[j].fan)
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
            if (!place(mesh[i], facets_[i], y, b, foot)) return false;
            foot.i = i;
            int out = -1, border = -1;
            for (int side = 0; side < 3; ++side) {
                const double over = b[(side + 2) % 3];
                if (over >= -1e-9) continue;
                int& which = facets_[i].beside[side] == Mesh::none ? border : out;
                if (which < 0 || over < b[(which + 2) % 3]) which = side;
            }
            if (out < 0) {
                if (border >= 0) on_edge(mesh[i], border, y, foot);
                return true;
            }
            i = facets_[i].beside[out];
        }
        return false;
    }

  private:
    struct FacetShape {
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
    static bool place(const Triangle& t, const FacetShape& e, const Vec3& y, double (&b)[3],
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
            if (last - j == 2 && s.from == t.to && s.to != s.from &&
                is_smooth_edge(mesh, s.i, t.i)) {
                facets_[s.i].beside[s.k] = t.i;
                facets_[t.i].beside[t.k] = s.i;
            }
        }
    }
    bool is_smooth_edge(const Mesh& mesh, std::uint32_t i, std::uint32_t j) const {
        const Triangle &s = mesh[i], &t = mesh[j];
        const Vec3 a = cross(s.ab, s.ac), b = cross(t.ab, t.ac);
        const double c = dot(a, b), both = norm(a) * norm(b);
        return c > slight * both ||
               (c > 0.3 * both && std::min(height_of(s), height_of(t)) < most_ / 100);
    }
    static double height_of(const Triangle& t) {
        return norm(cross(t.ab, t.ac)) / std::sqrt(std::max({t.aa, t.bb, t.aa + t.bb - 2 * t.cc}));
    }

    /// The triangles round a corner that no edge parts; of each such fan the body's normal.
    void gather_normals(const Mesh& mesh) {
        std::vector<std::uint32_t> fan(3 * facets_.size());
        for (std::uint32_t c = 0; c < fan.size(); ++c) fan[c] = c;
        const auto root = [&](std::uint32_t c) {
            while (fan[c] != c) c = fan[c] = fan[fan[c]];
            return c;
        };
        for (std::uint32_t i = 0; i < facets_.size(); ++i)
            for (std::uint32_t k = 0; k < 3; ++k)
                if (const std::uint32_t j = facets_[i].beside[k]; j != Mesh::none)
                    for (const std::uint32_t at : {k, (k + 1) % 3})
                        for (std::uint32_t l = 0; l < 3; ++l)
                            if (mesh.face(j)[l] == mesh.face(i)[at])
                                fan[root(3 * i + at)] = root(3 * j + l);
        for (std::uint32_t c = 0; c < fan.size(); ++c) facets_[c / 3].fan[c % 3] = root(c);
        std::vector<Vec3> normal(fan.size());
        for (std::uint32_t c = 0; c < fan.size(); ++c) {  // of a ball, its own (Max, 1999)
            const Vec3 p = side(mesh, c, 1), q = side(mesh, c, 2);
            const double squares = dot(p, p) * dot(q, q);
            if (squares > 0) normal[root(c)] = normal[root(c)] + (1 / squares) * cross(p, q);
        }
        for (Vec3& n : normal) n = along(n, 1);
        for (int k = 0; k < 8; ++k) relax_normals(mesh, normal);
        for (FacetShape& b : facets_)
            for (int k = 0; k < 3; ++k) b.n[k] = normal[b.fan[k]];
    }
    /// From corner c of all to the next of its triangle, or the one after.
    static Vec3 side(const Mesh& mesh, std::uint32_t c, int further) {
        const int k = static_cast<int>(c % 3);
        return corner(mesh[c / 3], (k + further) % 3) - corner(mesh[c / 3], k);
    }
    /// Where a body bends evenly, the normals at a side's ends lean equally from across it: half
    /// way there, by what all sides ask for.
    void relax_normals(const Mesh& mesh, std::vector<Vec3>& normal) const {
        std::vector<Vec3> lean(normal.size());
        std::vector<double> weight(normal.size());
        for (std::uint32_t c = 0; c < normal.size(); ++c)
            for (const int further : {1, 2}) {
                const std::uint32_t f = facets_[c / 3].fan[c % 3];
                const Vec3 s = side(mesh, c, further);
                const Vec3 both = normal[f] + normal[facets_[c / 3].fan[(c % 3 + further) % 3]];
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
    bool set_rise(const Mesh& mesh, std::uint32_t i) {
        FacetShape& b = facets_[i];
        const Triangle& t = mesh[i];
        const Vec3 up = along(cross(t.ab, t.ac), 1);
        const double least = height_of(t) < most_ / 100 ? 0.3 : slight;
        bool fits = true;
        b.most = 0;
        for (int k = 0; k < 3; ++k) {
            const int l = (k + 1) % 3;
            b.rise[k] = dot(corner(t, l) - corner(t, k), b.n[l] - b.n[k]) / 2;
            b.most = std::max(b.most, std::abs(b.rise[k]) / 3);
            fits = fits && dot(b.n[k], up) > least;
        }
        if (fits && b.most <= most_) return false;
        if (fits) {
            ++coarse_facets_;
            coarsest_sagitta_ = std::max(coarsest_sagitta_, b.most);
        }
        bool cut = false;
        for (int k = 0; k < 3; ++k)
            if (const std::uint32_t j = std::exchange(b.beside[k], Mesh::none); j != Mesh::none) {
                std::replace(facets_[j].beside.begin(), facets_[j].beside.end(), i, Mesh::none);
                cut = true;
            }
        return cut;
    }

    std::vector<FacetShape> facets_;
    double most_, rise_ = 0;
    std::size_t coarse_facets_ = 0;
    double coarsest_sagitta_ = 0;
};

// Where the proxy settles on the smooth body: at R from it, as near to the HIP as its sheets allow.

class SmoothContact {
  public:
    SmoothContact(SmoothBody body, double radius, double band)
        : body_(std::move(body)), R_(radius), low_(radius - body_.rise()), band_(band) {}

    std::size_t bytes() const noexcept { return body_.bytes(); }
    void forget() noexcept { count_ = 0; }
    int count() const noexcept { return count_; }
    const Vec3& normal() const noexcept { return sheets_[0].n; }
    /// What a proxy at x is held by.
    void hold(const Mesh& mesh, const Vec3& x, const ContactPlanes& planes) noexcept {
        count_ = 0;
        for (int j = 0; j < planes.count(); ++j) add(mesh, planes.triangle(j), x);
    }

    /// From x, which nothing lies nearer to than R less the rise, straight to where the HIP at h
    /// takes it; false, x as it was, where that is not free, or further from the HIP: `hold` anew.
    bool settle(const TriangleQuery& query, Vec3& x, const Vec3& h, const Vec3& start) noexcept {
        if (!(body_.rise() > 0)) return false;
        const double far = furthest(h, start);
        for (Vec3 y = x; !query.is_budget_spent() && solve(query, x, h, y);) {
            std::uint32_t missing = Mesh::none;
            if (!(norm(h - y) <= far && free(query, x, y, missing))) return false;
            if (missing == Mesh::none) {
                x = y;
                drop(y);
                return true;
            }
            if (count_ == most) return false;
            add(query.mesh(), missing, x);
        }
        return false;
    }
    /// Up to R over the planes that a proxy at x has, where it settles on nothing.
    void lift(const TriangleQuery& query, Vec3& x, const Vec3& h, const Vec3& start,
              const ContactPlanes& planes) noexcept {
        if (!(body_.rise() > 0)) return;
        ContactPlane<3> w[most];
        for (int j = 0; j < planes.count(); ++j)
            w[j] = {planes.normal(j), R_ - planes.height(j, x)};
        const Vec3 y =
            x + nearest_step(h - x, w, planes.count(), band_ / 16, ContactPlanes::flattest);
        query.spend_on_planes(planes.count());
        std::uint32_t missing = Mesh::none;
        if (!(y == x) && norm(h - y) <= furthest(h, start) && free(query, x, y, missing)) x = y;
    }

  private:
    static constexpr int most = ContactPlanes::max_planes;

    /// A part of the body that may hold the proxy: its foot, with the normal towards the proxy.
    struct BodySheet : Foot {
        std::uint32_t from = Mesh::none;  // the triangle that it was found by
        double side = 1;                  // of the triangles on which the proxy is
    };

    void add(const Mesh& mesh, std::uint32_t i, const Vec3& x) noexcept {
        BodySheet& s = sheets_[count_++];
        s.from = s.i = i;
        s.side = dot(cross(mesh[i].ab, mesh[i].ac), x - mesh[i].a) < 0 ? -1 : 1;
    }
    bool find_foot(const TriangleQuery& query, const Vec3& y, BodySheet& s) const noexcept {
        const bool found = body_.foot(query.mesh(), y, s.i, s);
        query.spend(6 * s.steps);
        if (!found) return false;
        if (!s.edge) s.n = s.side * s.n;
        return true;
    }
    double furthest(const Vec3& h, const Vec3& start) const noexcept {
        return norm(h - start) + body_.rise() + band_ / 2;
    }
    bool solve(const TriangleQuery& query, const Vec3& x, const Vec3& h, Vec3& y) noexcept {
        y = h;
        return count_ == 0 || on_one_sheet(query, x, h, y) || on_several_sheets(query, x, h, y);
    }
    /// On one sheet: above the HIP's own foot.
    bool on_one_sheet(const TriangleQuery& query, const Vec3& x, const Vec3& h, Vec3& y) noexcept {
        for (int j = 0; j < count_; ++j) {
            BodySheet& s = sheets_[j];
            if (!find_foot(query, h, s) || !(dot(s.n, x - s.at) > R_ / 2)) return false;
            const Vec3 off = s.at - sheets_[0].at;
            if (dot(off, off) > band_ * band_) return false;
        }
        const BodySheet& s = sheets_[0];
        y = dot(h - s.at, s.n) < R_ ? s.at + R_ * s.n : h;
        return true;
    }
    /// Between sheets, or round an edge: plane after plane.
    bool on_several_sheets(const TriangleQuery& query, const Vec3& x, const Vec3& h,
                           Vec3& y) noexcept {
        constexpr int turns = 12;
        y = x;
        ContactPlane<3> planes[most];
        for (int k = 0; k < turns && !query.is_budget_spent(); ++k) {
            for (int j = 0; j < count_; ++j) {
                BodySheet& s = sheets_[j];
                if (!find_foot(query, y, s)) return false;
                planes[j] = {s.n, R_ - dot(y - s.at, s.n)};
            }
            const Vec3 v = nearest_step(h - y, planes, count_, band_ / 16, ContactPlanes::flattest);
            query.spend_on_planes(count_);
            if (!detail::keeps_to(v, planes, count_, band_ / 16)) return false;
            y = y + v;
            if (dot(v, v) < band_ * band_ / 64) return true;
        }
        return false;
    }

    /// Whether nothing is nearer to the way from x to y than R less the rise. `missing`: a triangle
    /// whose sheet may hold the proxy at y, and is not among those known.
    bool free(const TriangleQuery& query, const Vec3& x, const Vec3& y,
              std::uint32_t& missing) const noexcept {
        const Vec3 v = y - x;
        const double length = norm(v);
        if (!(length <= R_ / 2)) return false;
        TriangleHit hit;
        double worst = 0;
        bool blocked = false;
        query.spend(query.mesh().around(x + 0.5 * v, R_ + body_.rise() + length / 2,
                                        [&](std::uint32_t i) noexcept {
                                            const Triangle& t = query.mesh()[i];
                                            if (blocked || behind(t, x)) return;
                                            const double d = t.distance(y);
                                            if (d < low_ + length)
                                                blocked = query.meets(i, x, v, hit);
                                            const double lacks = R_ + body_.rise(i) - band_ / 2 - d;
                                            if (lacks > worst && !known(i))
                                                worst = lacks, missing = i;
                                        }));
        return !blocked;
    }
    bool behind(const Triangle& t, const Vec3& x) const noexcept {
        for (int j = 0; j < count_; ++j) {
            const BodySheet& s = sheets_[j];
            const double top = t.extent_along(s.n);
            if (top <= dot(s.n, s.at) + band_ / 4 && dot(s.n, x) >= top + low_) return true;
        }
        return false;
    }
    bool known(std::uint32_t i) const noexcept {
        for (int j = 0; j < count_; ++j)
            if (i == sheets_[j].from || body_.touch(i, sheets_[j].i)) return true;
        return false;
    }
    /// Keeps what holds the proxy at y, each sheet once.
    void drop(const Vec3& y) noexcept {
        int kept = 0;
        for (int j = 0; j < count_; ++j) {
            BodySheet s = sheets_[j];
            bool holds = dot(y - s.at, s.n) <= R_ + band_;
            for (int k = 0; k < kept; ++k)
                if (const Vec3 off = s.at - sheets_[k].at; dot(off, off) < band_ * band_)
                    holds = false;
            s.from = s.i;
            if (holds) sheets_[kept++] = s;
        }
        count_ = kept;
    }

    SmoothBody body_;
    double R_, low_, band_;
    BodySheet sheets_[most];
    int count_ = 0;
};

}  // namespace vfplan::mesh
