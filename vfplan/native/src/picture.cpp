// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What the extraction of a curve asks for each pixel: a mask's skeleton, and nearest points.
#include <bit>
#include <numeric>

#include "numpy.hpp"
#include "vfplan/base/bounds_tree.hpp"
#include "vfplan/base/vec.hpp"

namespace {

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
        std::vector<std::size_t> order(n);
        std::iota(order.begin(), order.end(), 0);
        vfplan::BoundsTree<vfplan::Box<2>> tree;
        const auto bounds_of = [&](std::size_t first, std::size_t last) {
            vfplan::Box<2> box;
            for (std::size_t i = first; i < last; ++i) box.include(place(points, order[i]));
            return box;
        };
        const auto halve = [&](std::size_t first, std::size_t last) {
            const vfplan::Box<2> box = bounds_of(first, last);
            const int axis = box.high[0] - box.low[0] > box.high[1] - box.low[1] ? 0 : 1;
            std::size_t* const begin = order.data() + first;
            std::nth_element(
                begin, begin + (last - first) / 2, order.data() + last,
                [&](std::size_t a, std::size_t b) { return points(a, axis) < points(b, axis); });
        };
        tree.build(0, n, bounds_of, halve);
        for (std::size_t k = 0; k < m; ++k) {
            const vfplan::Vec2 at = place(places, k);
            double square = vfplan::infinity, reach = square;
            std::size_t found = 0;
            tree.visit_nearest(at, reach, [&](std::size_t i) {
                const vfplan::Vec2 away = place(points, order[i]) - at;
                const double here = dot(away, away);
                if (here > square || (here == square && order[i] > found)) return;
                square = here;
                reach = std::sqrt(here);
                found = order[i];
            });
            distances.data()[k] = reach;
            rows.data()[k] = static_cast<std::int64_t>(found);
        }
    }
    return nb::make_tuple(distances, rows);
}

}  // namespace

void bind_picture(nb::module_& m) {
    m.def("thinned", &thinned, "mask"_a, "the skeleton of a mask (H, W), 1 of ink and else 0");
    m.def("nearest", &nearest, "points"_a, "places"_a,
          "of each place (M, 2) the distance to the nearest point (N, 2), and that one's row");
}
