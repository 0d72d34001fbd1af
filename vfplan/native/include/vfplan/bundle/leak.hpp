// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The leak certificate: whether the proxy could pass between two samples of the fixture
// (docs/format.md, section 5). The proxy's centre keeps `reach` = R - band
// from every point. It cannot cross a segment whose ends are at most 2 reach apart, nor a triangle
// no place of which is farther than reach from the nearest corner. Of bare points nothing follows:
// how they connect is not in the file. With an ignored axis everything is measured across it.
#pragma once

#include "vfplan/bundle/content.hpp"
#include "vfplan/mesh/triangles.hpp"

namespace vfplan::bundle::detail {

/// What a certificate is about; the arrays stay their owner's.
struct CertifiedShape {
    std::span<const double> points;           // x y z of each in turn [m]
    Vec3 axis;                                // the ignored one, or 0
    std::span<const std::int32_t> stroke;     // of each point of a curve, or nothing
    std::span<const std::uint8_t> closed;     // whether each stroke is
    std::span<const std::int32_t> triangles;  // three rows of points each, or nothing
    double sample_radius = infinity;          // as far as a reader takes samples of a mesh [m]

    /// Between two points, across the ignored axis [m].
    [[nodiscard]] double distance(std::size_t i, std::size_t j) const {
        const double* xyz = points.data();
        return norm(across(point_at(xyz, i), axis) - across(point_at(xyz, j), axis));
    }
};

/// What follows from a shape and the reach of its proxy.
struct Certificate {
    const char* kind = "cloud";     // or "curve", or "mesh"
    double largest = 0;             // opening between samples [m]; of a cloud nothing is known
    double limit = infinity;        // the largest opening that holds the proxy back [m]
    std::vector<std::size_t> rows;  // the points around the largest opening

    /// An opening of this size between these points is there; of equal ones the first counts.
    void widen(double size, std::initializer_list<std::size_t> around) {
        if (!(size > largest)) return;
        largest = size;
        rows = around;
    }
    /// Whether it is known that the proxy passes nowhere.
    [[nodiscard]] bool holds() const { return limit < infinity && largest <= limit; }
};

/// The widest gap between neighbours along the strokes. Of equal gaps it is the first in the order
/// of the points, and those that close a stroke come behind all others.
inline void find_largest_gap(const CertifiedShape& shape, Certificate& certificate) {
    certificate.rows = {0, 0};
    const auto measure = [&](std::size_t i, std::size_t j) {
        certificate.widen(shape.distance(i, j), {i, j});
    };
    const std::span<const std::int32_t> stroke = shape.stroke;
    for (std::size_t i = 1; i < stroke.size(); ++i)
        if (stroke[i] == stroke[i - 1]) measure(i - 1, i);
    for (std::size_t first = 0, i = 1; i <= stroke.size(); ++i) {
        if (i < stroke.size() && stroke[i] == stroke[i - 1]) continue;
        if (shape.closed[static_cast<std::size_t>(stroke[i - 1])] != 0) measure(i - 1, first);
        first = i;
    }
}

/// How far a place of the mesh may be from the nearest sample: of the samples in the file, or of
/// those that a reader takes where it renders points.
inline void find_largest_cover(const CertifiedShape& shape, Certificate& certificate) {
    const auto corner = [&](std::size_t i) { return static_cast<std::size_t>(shape.triangles[i]); };
    certificate.rows = {corner(0), corner(1), corner(2)};
    for (std::size_t i = 0; i + 2 < shape.triangles.size(); i += 3) {
        const std::size_t a = corner(i), b = corner(i + 1), c = corner(i + 2);
        certificate.widen(mesh::covering_radius(
                              {shape.distance(a, b), shape.distance(b, c), shape.distance(c, a)}),
                          {a, b, c});
    }
    certificate.largest = std::min(certificate.largest, shape.sample_radius);
}

/// The certificate of a shape whose rows and strokes are known to be there.
inline Certificate certify(const CertifiedShape& shape, double reach) {
    Certificate certificate;
    if (!shape.triangles.empty()) {
        certificate.kind = "mesh";
        certificate.limit = reach;
        find_largest_cover(shape, certificate);
    } else if (!shape.stroke.empty()) {
        certificate.kind = "curve";
        certificate.limit = 2 * reach;
        find_largest_gap(shape, certificate);
    }
    return certificate;
}

/// The radius R of what is rendered [m].
inline double radius_of(const Content& content) {
    return content.number("/rendering@contact_radius_m") +
           content.number("/rendering@point_radius_m");
}

inline CertifiedShape certified_shape(const Content& content) {
    CertifiedShape shape;
    shape.points = content.at("/points").f8;
    if (const Value* axis = content.find("/rendering/ignore_axis"))
        shape.axis = point_at(axis->f8.data(), 0);
    if (content.has("/curve/stroke")) {
        shape.stroke = content.at("/curve/stroke").i4;
        shape.closed = content.at("/curve/closed").u1;
    }
    if (content.has("/mesh/triangles")) shape.triangles = content.at("/mesh/triangles").i4;
    shape.sample_radius = content.number("/mesh@sample_radius_m", infinity);
    return shape;
}

inline void check_leak(const Content& content, Findings& findings) {
    findings.require(content.has_group("/rendering") == content.has_group("/leak"), "corrupt.leak",
                     "/leak", {"is there without /rendering, or missing beside it"},
                     "Write both or neither");
    const std::string& found = content.at("/leak@kind").string();
    const double reach = radius_of(content) - content.number("/rendering@band_m");
    const Certificate certificate = certify(certified_shape(content), reach);
    const std::string_view kind = certificate.kind;
    if (found != kind)
        return findings.error("corrupt.leak", "/leak@kind",
                              {"is ", Quoted{found}, "; ", Quoted{kind}, " wanted"});
    const bool is_cloud = kind == "cloud";
    const double limit = content.number("/leak@limit_m", 0);
    const double largest = content.number("/leak@largest_m");
    const bool holds = !is_cloud && largest <= limit;
    if (is_cloud) {
        findings.require(!content.has("/leak@limit_m"), "corrupt.leak", "/leak@limit_m",
                         {"is there, and the fixture is a cloud"},
                         "Leave it out: how points connect is not known");
    } else {
        const auto compare = [&](std::string_view path, double found, double wanted) {
            findings.require(std::abs(found - wanted) <= 1e-9 * std::max(wanted, 1e-3),
                             "corrupt.leak", path, {"is ", found, "; the fixture gives ", wanted});
        };
        compare("/leak@limit_m", limit, certificate.limit);
        compare("/leak@largest_m", largest, certificate.largest);
        const std::vector<double>& at = content.at("/leak/place").f8;
        findings.require(
            holds, "unsafe.leak", "/leak",
            {"the fixture leaks between samples: an opening of ", six_digits(largest), " m at (",
             six_digits(at[0]), ", ", six_digits(at[1]), ", ", six_digits(at[2]), "); at most ",
             six_digits(limit), " m holds the proxy back"},
            "Add points there, or take a larger radius");
    }
    const bool says = content.at("/leak@certified").u1.front() != 0;
    findings.require(says == holds, "corrupt.leak", "/leak@certified",
                     {"is ", says, "; ", holds, " wanted"});
}

}  // namespace vfplan::bundle::detail
