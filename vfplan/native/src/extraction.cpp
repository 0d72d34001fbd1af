// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What the extraction of a curve asks for: a mask's skeleton, nearest points, and arcs along a
// smooth run by pairs that meet with one tangent (Bolton, "Biarc curves", 1975), each as long as a
// tolerance allows.
#include <bit>

#include "numpy.hpp"
#include "vfplan/curve/exact.hpp"

namespace {

using vfplan::Vec2;

using Mask = nb::ndarray<const std::uint8_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// A pixel's neighbours are counted counter-clockwise from the right; the code of its surroundings
// has a bit for each that is set.
constexpr int right = 0, above = 2, left = 4, below = 6;

// For each code, into how many pieces a pixel's removal parts its neighbours, where one of the four
// closest is empty: S. Yokoi's number of connectivity.
constexpr auto pieces_by_code = [] {
    std::array<int, 256> pieces{};
    for (unsigned code = 0; code < 256; ++code) {
        const auto empty = [code](int k) { return (code >> (k % 8) & 1) == 0; };
        for (const int k : {right, above, left, below})
            pieces[code] += empty(k) && !(empty(k + 1) && empty(k + 2));
    }
    return pieces;
}();

// Thins the pixels of a picture, the outermost excepted, to their skeleton. T.-C. Lee, R. L.
// Kashyap and C.-N. Chu, "Building skeleton models via 3-D medial surface/axis thinning
// algorithms", CVGIP 56 (1994), in the plane.
void thin(std::uint8_t* pixels, std::ptrdiff_t rows, std::ptrdiff_t columns) {
    const std::array<std::ptrdiff_t, 8> step{1,  1 - columns, -columns, -columns - 1,
                                             -1, columns - 1, columns,  columns + 1};
    const auto code_of = [&](std::ptrdiff_t at) {
        unsigned code = 0;
        for (int k = 0; k < 8; ++k) code |= unsigned{pixels[at + step[k]] != 0} << k;
        return code;
    };
    std::vector<std::ptrdiff_t> ink, candidates;
    for (std::ptrdiff_t row = 1; row < rows - 1; ++row)
        for (std::ptrdiff_t at = row * columns + 1; at < (row + 1) * columns - 1; ++at)
            if (pixels[at]) ink.push_back(at);
    for (bool changed = true; changed;) {
        changed = false;
        for (const int side : {above, below, right, left}) {
            candidates.clear();
            for (const auto at : ink) {
                if (!pixels[at] || pixels[at + step[side]]) continue;
                const unsigned code = code_of(at);
                const bool is_end = std::popcount(code) == 1;
                if (pieces_by_code[code] == 1 && !is_end) candidates.push_back(at);
            }
            // One after the other: once its neighbours are gone a pixel may hold others together.
            for (const auto at : candidates) {
                if (pieces_by_code[code_of(at)] > 1) continue;
                pixels[at] = 0;
                changed = true;
            }
        }
        std::erase_if(ink, [&](std::ptrdiff_t at) { return !pixels[at]; });
    }
}

nb::ndarray<nb::numpy, std::uint8_t> thinned(const Mask& mask) {
    auto bone = array<std::uint8_t>(mask.shape(0), mask.shape(1));
    std::copy_n(mask.data(), mask.size(), bone.data());
    const nb::gil_scoped_release release;
    thin(bone.data(), static_cast<std::ptrdiff_t>(mask.shape(0)),
         static_cast<std::ptrdiff_t>(mask.shape(1)));
    return bone;
}

// Each place's distance to the nearest point, and that point's row: the first of several.
nb::tuple nearest(const Places& points, const Places& places) {
    const std::size_t n = points.shape(0), m = places.shape(0);
    if (n == 0) throw std::invalid_argument("vfplan: the nearest of no points");
    auto distances = array<double>(m, 1);
    auto rows = array<std::int64_t>(m, 1);
    {
        const nb::gil_scoped_release release;
        vfplan::BoundsTree<vfplan::Box<2>> tree;
        tree.build(n, [&](std::size_t i) {
            const Vec2 at = place(points, i);
            return vfplan::Box<2>{at, at};
        });
        for (std::size_t k = 0; k < m; ++k) {
            const Vec2 at = place(places, k);
            double square = vfplan::infinity, reach = square;
            std::size_t found = 0;
            tree.visit_nearest(at, reach, [&](std::size_t i) {
                const Vec2 away = place(points, i) - at;
                const double here = dot(away, away);
                if (here > square || (here == square && i > found)) return;
                square = here;
                reach = std::sqrt(here);
                found = i;
            });
            distances.data()[k] = reach;
            rows.data()[k] = static_cast<std::int64_t>(found);
        }
    }
    return nb::make_tuple(distances, rows);
}

// The bulge of the arc that leaves along a tangent and ends at the end of a chord.
double bulge_of(const Vec2& tangent, const Vec2& chord) {
    constexpr double rounding = 1e-12, widest = 3.1;  // [rad]
    const double half = std::atan2(dot(vfplan::left(tangent), chord), dot(tangent, chord));
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

void bind_extraction(nb::module_& m) {
    m.def("thinned", &thinned, "mask"_a, "the skeleton of a mask (H, W), 1 of ink and else 0");
    m.def("nearest", &nearest, "points"_a, "places"_a,
          "of each place (M, 2) the distance to the nearest point (N, 2), and that one's row");
    m.def("arcs_along", &arcs_along, "places"_a, "tangents"_a, "tolerance"_a, "step"_a,
          "vertices, bulges and error of the arcs along a smooth run");
}
