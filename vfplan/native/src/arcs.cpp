// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Arcs along a smooth run of a measured curve, by pairs that meet with one tangent (Bolton, "Biarc
// curves", 1975), each as long as a tolerance allows.

#include "numpy.hpp"
#include "vfplan/curve/exact.hpp"

namespace {

using vfplan::Vec2;

double cross(const Vec2& a, const Vec2& b) { return a[0] * b[1] - a[1] * b[0]; }

// The bulge of the arc that leaves along a tangent and ends at the end of a chord.
double bulge_of(const Vec2& tangent, const Vec2& chord) {
    constexpr double rounding = 1e-12, widest = 3.1;  // [rad]
    const double half = std::atan2(cross(tangent, chord), dot(tangent, chord));
    const double bulge = std::tan(std::clamp(half, -widest, widest) / 2);
    return std::abs(bulge) <= rounding ? 0 : bulge;
}

struct SmoothRun {
    const Places &places, &tangents;
    double tolerance;

    // The two arcs from one place to another, which meet with one tangent. Of equal lengths d:
    // |q - d s - p - d t| = 2 d, from p with tangent t to q with tangent s.
    vfplan::Stroke biarc(std::size_t first, std::size_t last) const {
        const Vec2 p = place(places, first), t = place(tangents, first);
        const Vec2 q = place(places, last), s = place(tangents, last);
        const Vec2 chord = q - p;
        const double a = 2 * (1 - t[0] * s[0] - t[1] * s[1]);
        const double b = dot(chord, t + s), c = dot(chord, chord);
        const double d = c / (b + std::sqrt(std::max(b * b + a * c, 0.0)) + 1e-300);
        const Vec2 sum = p + q + d * (t - s), joint{sum[0] / 2, sum[1] / 2};
        return {{p[0], p[1], 0, joint[0], joint[1], 0, q[0], q[1], 0},
                {bulge_of(t, joint - p), -bulge_of(-s, joint - q), 0},
                false};
    }
    // The largest distance of the places between from the two arcs; infinite beyond a half circle.
    double error(std::size_t first, std::size_t last) const {
        const vfplan::Stroke two = biarc(first, last);
        if (std::max(std::abs(two.bulges[0]), std::abs(two.bulges[1])) > 1) return vfplan::infinity;
        const vfplan::curve::Curve curve({two}, vfplan::Slice(vfplan::Vec3{0, 0, 1}), 1);
        double largest = 0;
        for (std::size_t i = first + 1; i < last; ++i)
            largest = std::max(largest, curve.distance(place(places, i)));
        return largest;
    }
    // The last place of the longest pair of arcs from `first` within the tolerance, and its error.
    // `step` places are tried at the beginning, then twice as many each time, then half-way between
    // what fits and what does not.
    std::pair<std::size_t, double> longest_pair(std::size_t first, std::size_t step) const {
        const std::size_t end = places.shape(0) - 1;
        std::size_t fits = first + 1, fails = end + 1, last = std::min(first + step, end);
        double largest = 0;
        while (fails - fits > 1) {
            const double tried = error(first, last);
            if (tried <= tolerance) {
                fits = last;
                largest = tried;
            } else {
                fails = last;
            }
            last = fails <= end ? (fits + fails) / 2 : std::min(2 * fits - first, end);
        }
        return {fits, largest};
    }
};

// Vertices (K + 1, 2) and bulges (K,) along places (D, 2) with unit tangents (D, 2), and their
// error. `step`: how many places the first pair is tried with.
nb::tuple arcs_along(const Places& places, const Places& tangents, double tolerance,
                     std::size_t step) {
    if (places.shape(0) == 0 || tangents.shape(0) != places.shape(0))
        throw std::invalid_argument("vfplan: a tangent for each place is wanted");
    const SmoothRun run{places, tangents, tolerance};
    const Vec2 start = place(places, 0);
    std::vector<double> vertices{start[0], start[1]}, bulges;
    double largest = 0;
    for (std::size_t first = 0; first + 1 < places.shape(0);) {
        const auto [last, error] = run.longest_pair(first, std::max<std::size_t>(step, 2));
        const vfplan::Stroke two = run.biarc(first, last);
        const Vec2 end = place(places, last);
        vertices.insert(vertices.end(), {two.vertices[3], two.vertices[4], end[0], end[1]});
        for (const double bulge : {two.bulges[0], two.bulges[1]})
            bulges.push_back(std::clamp(bulge, -1.0, 1.0));
        largest = std::max(largest, error);
        step = last - first;
        first = last;
    }
    const std::size_t n = bulges.size();
    return nb::make_tuple(array(std::move(vertices), {n + 1, 2}), array(std::move(bulges), {n}),
                          largest);
}

}  // namespace

void bind_arcs(nb::module_& m) {
    m.def("arcs_along", &arcs_along, "places"_a, "tangents"_a, "tolerance"_a, "step"_a,
          "vertices, bulges and error of the arcs along a smooth run");
}
