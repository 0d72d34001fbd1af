// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Lines and arcs as NumPy holds them.
#pragma once

#include "numpy.hpp"
#include "vfplan/curve/pieces.hpp"

inline std::vector<vfplan::Stroke> strokes(const Rows& vertices, const Numbers& bulges,
                                           const Ids& stroke, const Flags& closed) {
    if (bulges.shape(0) != vertices.shape(0) || stroke.shape(0) != vertices.shape(0))
        throw std::invalid_argument("vfplan: a bulge and a stroke a vertex");
    std::vector<vfplan::Stroke> all(closed.shape(0));
    for (std::size_t s = 0; s < all.size(); ++s) all[s].closed = closed(s) != 0;
    for (std::size_t i = 0; i < vertices.shape(0); ++i) {
        vfplan::Stroke& s = all.at(static_cast<std::size_t>(stroke(i)));
        s.vertices.insert(s.vertices.end(), {vertices(i, 0), vertices(i, 1), vertices(i, 2)});
        s.bulges.push_back(bulges(i));
    }
    return all;
}
