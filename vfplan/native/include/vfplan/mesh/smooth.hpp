// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The smooth body that a mesh's facets stand for. Across a slight edge normals go over into each
// other, so that a proxy that follows them feels no facet; a sharp edge stays one.
#pragma once

#include "vfplan/mesh/query.hpp"

namespace vfplan::inline v1::mesh {

/// A side of a triangle: the rows of its ends, the lower first, the triangle, and its number there.
using Side = std::array<std::uint32_t, 4>;

/// All sides, those of the same ends one after the other.
inline std::vector<Side> sorted_sides(const Mesh& mesh) {
    std::vector<Side> sides;
    for (std::uint32_t i = 0; i < mesh.size(); ++i)
        for (std::uint32_t k = 0; k < 3; ++k) {
            const auto [low, high] = std::minmax(mesh.face(i)[k], mesh.face(i)[(k + 1) % 3]);
            sides.push_back({low, high, i, k});
        }
    std::sort(sides.begin(), sides.end());
    return sides;
}
/// Whether two triangles that have a side, and no third one, have the same side up.
inline bool are_partners(const Mesh& mesh, const std::vector<Side>& sides, std::size_t j) {
    const auto has_ends = [&](std::size_t k) {
        return k < sides.size() && sides[k][0] == sides[j][0] && sides[k][1] == sides[j][1];
    };
    const auto from = [&](const Side& side) { return mesh.face(side[2])[side[3]]; };
    return sides[j][0] != sides[j][1] && has_ends(j + 1) && !has_ends(j + 2) && !has_ends(j - 1) &&
           from(sides[j]) != from(sides[j + 1]);
}
/// Whether each side is one of two triangles that have the same side up.
inline bool is_closed(const Mesh& mesh) {
    const std::vector<Side> sides = sorted_sides(mesh);
    for (std::size_t j = 0; j < sides.size(); j += 2)
        if (!are_partners(mesh, sides, j)) return false;
    return true;
}

/// The place of the body under another place.
struct FacetFoot {
    Vec3 at;                       ///< the nearest place of the body
    Vec3 n;                        ///< the body's unit normal there
    std::uint32_t i = Mesh::none;  ///< the triangle that it lies over
    bool edge = false;             ///< whether it lies on a sharp edge, or on the border
    int steps = 0;                 ///< steps of Newton's method that found it
};

class SmoothBody {
  public:
    /// The cosine of the sharpest edge that is smoothed.
    static constexpr double slight = 0.866;
    /// How far the body may be from its triangles, as a share of R.
    static constexpr double max_rise_share = 0.05;

    SmoothBody(const Mesh& mesh, double radius)
        : facets_(mesh.size()), max_rise_(max_rise_share * radius) {
        link(mesh);
        for (bool has_changed = true; has_changed;) {
            gather_normals(mesh);
            has_changed = false;
            for (std::uint32_t i = 0; i < facets_.size(); ++i) has_changed |= set_rise(mesh, i);
        }
        for (const FacetShape& b : facets_) rise_ = std::max(rise_, b.max_rise);
    }

    /// How far the body is from the triangles at most [m]; 0 where no edge is smoothed.
    double rise() const noexcept { return rise_; }
    double rise(std::uint32_t i) const noexcept { return facets_[i].max_rise; }
    /// Number of facets that are too coarse to be smoothed: the body would be more than R / 20 from
    /// them. The proxy feels them as they are.
    std::size_t coarse_facets() const noexcept { return coarse_facets_; }
    /// How far the body would be from the coarsest of them [m]; 0 where there is none.
    double coarsest_sagitta() const noexcept { return coarsest_sagitta_; }
    std::size_t bytes() const noexcept { return facets_.capacity() * sizeof(FacetShape); }
    /// Whether two triangles meet in a corner at which the body is smooth.
    bool touch(std::uint32_t i, std::uint32_t j) const noexcept {
        const auto &a = facets_[i].fan, &b = facets_[j].fan;
        return std::find_first_of(a.begin(), a.end(), b.begin(), b.end()) != a.end();
    }

    /// Finds the place of the body on whose normal y lies, or the nearest place of a sharp edge.
    ///
    /// The search begins over triangle i. It goes on over the triangle beside it where the place
    /// lies beyond a side. Returns false where it finds none within 64 triangles, or has no steps
    /// left to look.
    bool foot(const TriangleQuery& query, const Vec3& y, std::uint32_t i,
              FacetFoot& foot) const noexcept {
        constexpr int max_triangles = 64;
        const Mesh& mesh = query.mesh();
        for (int k = 0; k < max_triangles && !query.budget().is_spent(); ++k) {
            double b[3];
            foot.steps = 0;
            const bool has_place = place(mesh[i], facets_[i], y, b, foot);
            query.budget().spend(6 * std::max(foot.steps, 1));
            if (!has_place) return false;
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
    /// The shape of the body over one triangle. Side k leads from corner k to the next one.
    struct FacetShape {
        std::array<Vec3, 3> n;               // the body's normals at the corners
        std::array<double, 3> rise{};        // 4 times its height over the middle of side k [m]
        double max_rise = 0;                 // its largest height over the triangle [m]
        std::array<std::uint32_t, 3> fan{};  // names the fan of triangles around each corner
        // The triangle across side k, where the body is smooth there.
        std::array<std::uint32_t, 3> beside{Mesh::none, Mesh::none, Mesh::none};
    };

    static Vec3 corner(const Triangle& t, int k) noexcept {
        return k == 0 ? t.a : k == 1 ? t.a + t.ab : t.a + t.ac;
    }

    /// Solves y = place + height n by Newton's method, where n goes linearly from corner to corner.
    /// `b` becomes the shares of the corners in the place. Returns false where it does not
    /// converge.
    static bool place(const Triangle& t, const FacetShape& e, const Vec3& y, double (&b)[3],
                      FacetFoot& foot) noexcept {
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
    /// Puts the foot at the place of a side that is nearest to y.
    static void on_edge(const Triangle& t, int side, const Vec3& y, FacetFoot& foot) noexcept {
        const Vec3 from = corner(t, side), way = corner(t, (side + 1) % 3) - from;
        const double share = dot(y - from, way) / dot(way, way);
        foot.at = from + std::min(std::max(share, 0.0), 1.0) * way;
        foot.n = along(y - foot.at, 1);
        foot.edge = true;
    }

    /// Links pairs of triangles that share a side between which the body is smooth: both have the
    /// same side up, no third triangle has the side, and the edge between them is hardly one.
    void link(const Mesh& mesh) {
        const std::vector<Side> sides = sorted_sides(mesh);
        for (std::size_t j = 0; j < sides.size(); ++j) {
            if (!are_partners(mesh, sides, j)) continue;
            const auto [low, high, i, k] = sides[j];
            const auto [same_low, same_high, other, l] = sides[j + 1];
            if (!is_smooth_edge(mesh, i, other)) continue;
            facets_[i].beside[k] = other;
            facets_[other].beside[l] = i;
        }
    }
    /// Whether the body is smooth between two triangles. A sharper edge is allowed beside a sliver,
    /// whose normal says little.
    bool is_smooth_edge(const Mesh& mesh, std::uint32_t i, std::uint32_t j) const {
        const Triangle &s = mesh[i], &t = mesh[j];
        const Vec3 a = cross(s.ab, s.ac), b = cross(t.ab, t.ac);
        const double c = dot(a, b), both = norm(a) * norm(b);
        return c > slight * both ||
               (c > 0.3 * both && std::min(height_of(s), height_of(t)) < max_rise_ / 100);
    }
    /// The height of a triangle over its longest side [m].
    static double height_of(const Triangle& t) {
        return norm(cross(t.ab, t.ac)) / std::sqrt(std::max({t.aa, t.bb, t.aa + t.bb - 2 * t.cc}));
    }

    /// Collects the fans, which are the triangles around a corner that no sharp edge parts, and
    /// gives each fan the body's normal at its corner.
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
        // These weights give the exact normal where the corners lie on a ball (Max, 1999).
        for (std::uint32_t c = 0; c < fan.size(); ++c) {
            const Vec3 p = side(mesh, c, 1), q = side(mesh, c, 2);
            const double squares = dot(p, p) * dot(q, q);
            if (squares > 0) normal[root(c)] = normal[root(c)] + (1 / squares) * cross(p, q);
        }
        for (Vec3& n : normal) n = along(n, 1);
        for (int k = 0; k < 8; ++k) relax_normals(mesh, normal);
        for (FacetShape& b : facets_)
            for (int k = 0; k < 3; ++k) b.n[k] = normal[b.fan[k]];
    }
    /// The vector from corner c, of the corners of all triangles, to the first or the second one
    /// after it in its triangle.
    static Vec3 side(const Mesh& mesh, std::uint32_t c, int further) {
        const int k = static_cast<int>(c % 3);
        return corner(mesh[c / 3], (k + further) % 3) - corner(mesh[c / 3], k);
    }
    /// Moves the normals towards those of a body that bends evenly. There the normals at both ends
    /// of a side lean by the same angle. Each normal goes half of the way that its sides ask for.
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
    /// Computes how far the body rises over a triangle. One that is too coarse, or too far from its
    /// normals, gets sharp edges all around. Returns whether it has lost a smooth side by that.
    bool set_rise(const Mesh& mesh, std::uint32_t i) {
        FacetShape& b = facets_[i];
        const Triangle& t = mesh[i];
        const Vec3 up = along(cross(t.ab, t.ac), 1);
        const double least = height_of(t) < max_rise_ / 100 ? 0.3 : slight;
        bool fits = true;
        b.max_rise = 0;
        for (int k = 0; k < 3; ++k) {
            const int l = (k + 1) % 3;
            b.rise[k] = dot(corner(t, l) - corner(t, k), b.n[l] - b.n[k]) / 2;
            b.max_rise = std::max(b.max_rise, std::abs(b.rise[k]) / 3);
            fits = fits && dot(b.n[k], up) > least;
        }
        if (fits && b.max_rise <= max_rise_) return false;
        if (fits) {
            ++coarse_facets_;
            coarsest_sagitta_ = std::max(coarsest_sagitta_, b.max_rise);
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
    double max_rise_, rise_ = 0;
    std::size_t coarse_facets_ = 0;
    double coarsest_sagitta_ = 0;
};

/// Where the proxy settles on the smooth body: R from it, as near to the HIP as its sheets allow.
class SmoothContact {
  public:
    SmoothContact(SmoothBody body, double radius, double band)
        : body_(std::move(body)), R_(radius), low_(radius - body_.rise()), band_(band) {}

    std::size_t bytes() const noexcept { return body_.bytes(); }
    void forget() noexcept { count_ = 0; }
    int count() const noexcept { return count_; }
    const Vec3& normal() const noexcept { return sheets_[0].n; }
    /// Begins with the sheets over the triangles that hold a proxy at x.
    void hold(const Mesh& mesh, const Vec3& x, const ContactPlanes& planes) noexcept {
        count_ = 0;
        for (int j = 0; j < planes.count(); ++j) add(mesh, planes.triangle(j), x);
    }

    /// Moves a proxy at x straight to where the HIP at h takes it on the body. Nothing may lie
    /// nearer to x than R less the rise. Returns false, and leaves x as it was, where the way is
    /// not free or would lead further from the HIP. Then `hold` has to be called anew.
    bool settle(const TriangleQuery& query, Vec3& x, const Vec3& h, const Vec3& start) noexcept {
        if (!(body_.rise() > 0)) return false;
        const double max_left = max_distance(h, start);
        for (Vec3 y = x; !query.budget().is_spent() && solve(query, x, h, y);) {
            std::uint32_t missing = Mesh::none;
            if (!(norm(h - y) <= max_left && is_free(query, x, y, missing))) return false;
            if (missing == Mesh::none) {
                x = y;
                drop_others(y);
                return true;
            }
            if (count_ == max_sheets) return false;
            add(query.mesh(), missing, x);
        }
        return false;
    }
    /// Lifts a proxy that settles on nothing from its planes up to R over them.
    void lift(const TriangleQuery& query, Vec3& x, const Vec3& h, const Vec3& start,
              const ContactPlanes& planes) noexcept {
        if (!(body_.rise() > 0) || query.budget().is_spent()) return;
        ContactPlane<3> w[max_sheets];
        for (int j = 0; j < planes.count(); ++j)
            w[j] = {planes.normal(j), R_ - planes.height(j, x)};
        const Vec3 y =
            x + nearest_step(h - x, w, planes.count(), band_ / 16, ContactPlanes::flattest);
        query.spend_on_planes(planes.count());
        std::uint32_t missing = Mesh::none;
        if (!(y == x) && norm(h - y) <= max_distance(h, start) && is_free(query, x, y, missing))
            x = y;
    }

  private:
    static constexpr int max_sheets = ContactPlanes::max_planes;

    /// A part of the body that may hold the proxy: its foot, with the normal towards the proxy.
    struct BodySheet : FacetFoot {
        std::uint32_t from = Mesh::none;  // the triangle by which it was found
        double side = 1;                  // -1 where the proxy is below the triangles
    };

    void add(const Mesh& mesh, std::uint32_t i, const Vec3& x) noexcept {
        BodySheet& s = sheets_[count_++];
        s.from = s.i = i;
        s.side = dot(cross(mesh[i].ab, mesh[i].ac), x - mesh[i].a) < 0 ? -1 : 1;
    }
    bool find_foot(const TriangleQuery& query, const Vec3& y, BodySheet& s) const noexcept {
        if (!body_.foot(query, y, s.i, s)) return false;
        if (!s.edge) s.n = s.side * s.n;
        return true;
    }
    /// How far from the HIP the proxy may end [m]: a tick must not take it further away.
    double max_distance(const Vec3& h, const Vec3& start) const noexcept {
        return norm(h - start) + body_.rise() + band_ / 2;
    }
    /// Finds the place y that is nearest to the HIP and R from the sheets known so far.
    bool solve(const TriangleQuery& query, const Vec3& x, const Vec3& h, Vec3& y) noexcept {
        y = h;
        return count_ == 0 || on_one_sheet(query, x, h, y) || on_several_sheets(query, x, h, y);
    }
    /// With one sheet the place lies above the HIP's own foot.
    bool on_one_sheet(const TriangleQuery& query, const Vec3& x, const Vec3& h, Vec3& y) noexcept {
        for (int j = 0; j < count_; ++j) {
            BodySheet& s = sheets_[j];
            if (!find_foot(query, h, s) || !(dot(s.n, x - s.at) > R_ / 2)) return false;
            const Vec3 off = s.at - sheets_[0].at;
            if (dot(off, off) > band_ * band_) return false;
            // At a sharp edge two sheets have one foot, and above one of them is inside the other.
            if (R_ - dot(R_ * sheets_[0].n - off, s.n) > body_.rise() + band_) return false;
        }
        const BodySheet& s = sheets_[0];
        y = dot(h - s.at, s.n) < R_ ? s.at + R_ * s.n : h;
        return true;
    }
    /// Between sheets, or round an edge, Newton's method takes the plane of each sheet's foot.
    bool on_several_sheets(const TriangleQuery& query, const Vec3& x, const Vec3& h,
                           Vec3& y) noexcept {
        constexpr int turns = 12;
        y = x;
        ContactPlane<3> planes[max_sheets];
        for (int k = 0; k < turns && !query.budget().is_spent(); ++k) {
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

    /// Whether nothing is nearer to the way from x to y than R less the rise. `missing` becomes the
    /// triangle that comes nearest to y, where its sheet is not among those known.
    bool is_free(const TriangleQuery& query, const Vec3& x, const Vec3& y,
                 std::uint32_t& missing) const noexcept {
        const Vec3 v = y - x;
        const double length = norm(v);
        if (!(length <= R_ / 2)) return false;
        TriangleHit hit;
        double worst = 0;
        const auto blocks = [&](std::uint32_t i) noexcept {
            const Triangle& t = query.mesh()[i];
            if (is_behind_a_sheet(t, x)) return false;
            const double d = t.distance(y);
            const double lacks = R_ + body_.rise(i) - band_ / 2 - d;
            if (lacks > worst && !is_known(i)) worst = lacks, missing = i;
            return d < low_ + length && query.meets(i, x, v, hit);
        };
        return !query.finds(x + 0.5 * v, R_ + body_.rise() + length / 2, blocks);
    }
    /// Whether a known sheet parts a triangle from x, so that it is in nobody's way.
    bool is_behind_a_sheet(const Triangle& t, const Vec3& x) const noexcept {
        return std::any_of(sheets_, sheets_ + count_, [&](const BodySheet& s) {
            const double top = t.extent_along(s.n);
            return top <= dot(s.n, s.at) + band_ / 4 && dot(s.n, x) >= top + low_;
        });
    }
    /// Whether a triangle lies under one of the sheets.
    bool is_known(std::uint32_t i) const noexcept {
        return std::any_of(sheets_, sheets_ + count_,
                           [&](const BodySheet& s) { return i == s.from || body_.touch(i, s.i); });
    }
    /// Keeps the sheets that hold the proxy at y, each once.
    void drop_others(const Vec3& y) noexcept {
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
    BodySheet sheets_[max_sheets];
    int count_ = 0;
};

}  // namespace vfplan::inline v1::mesh
