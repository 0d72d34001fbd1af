// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A drawn line as it is handed to the engine: lines and arcs from vertex to vertex, as DXF has
// them. Two pieces share their vertex, so a stroke has no gap.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include "vfplan/cloud.hpp"

namespace vfplan {

/// Lines and arcs from vertex to vertex. A bulge is tan(sweep / 4): 0 for a line, positive where
/// the arc turns left, seen with the ignored axis pointing to the viewer; at most a half circle.
struct Stroke {
    std::vector<double> vertices;  ///< x y z of each in turn [m]
    std::vector<double> bulges;    ///< of the piece from each vertex to the next; one each
    bool closed = false;           ///< the last piece leads back to the first vertex
};

/// Throws std::invalid_argument on strokes that no engine takes.
inline void check(const std::vector<Stroke>& strokes) {
    const auto must = [](bool holds, const char* what) {
        if (!holds) reject(what);
    };
    must(!strokes.empty(), "a curve needs at least one stroke");
    for (const Stroke& s : strokes) {
        must(!s.vertices.empty() && s.vertices.size() % 3 == 0,
             "a stroke needs at least one vertex, of three coordinates");
        must(s.bulges.size() == s.vertices.size() / 3, "a stroke needs a bulge a vertex");
        for (double c : s.vertices)
            must(std::abs(c) <= largest_coordinate, "vertices must be within 1e6 m");
        for (double b : s.bulges) must(std::abs(b) <= 1, "bulges must be from -1 to 1");
    }
}

}  // namespace vfplan
