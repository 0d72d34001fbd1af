// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// How long a tick may take, from a fixture and its rendering alone, before the first tick.
//
// Two figures are known. One follows from counts: iterations, and the points, features or triangles
// that lie together, each with the time that it costs. A tick among real shapes takes up to eighty
// times less, for it seldom uses its iterations. So the bound that an engine is held to comes from
// a search: HIPs are led about where the geometry is most laborious, the work of each tick is
// counted, and the bound is 3 us and 2.2 times the most that was found.
// tests/engine/test_worst_tick.py holds it against measured ticks of fixtures of every kind. All
// times are those of the machine of docs/engine.md. The search is `most_work_found` in
// engine_impl.hpp.
#pragma once

#include <vector>

#include "vfplan/curve/pieces.hpp"
#include "vfplan/engine.hpp"
#include "vfplan/mesh/triangles.hpp"
#include "vfplan/parameters.hpp"

namespace vfplan {

/// Time [s] that a tick among n points takes at most: 3 us and 2.2 times the most that a search
/// finds, or `proven_tick_time` where that is less or where a tick may use more than 32 iterations.
/// It is for HIPs of up to 3 m/s: one that jumps also costs what lies along its way. Throws
/// std::invalid_argument, as all these functions do.
VFPLAN_COMPILED_ONCE double tick_time_bound(const double* xyz, std::size_t n, const Parameters& p);
/// The same of rule exact among lines and arcs.
VFPLAN_COMPILED_ONCE double tick_time_bound(const std::vector<Stroke>& strokes,
                                            const Parameters& p);
/// The same of rule exact among triangles.
VFPLAN_COMPILED_ONCE double tick_time_bound(const mesh::Surface& surface, const Parameters& p);

/// Time [s] that a tick takes by what it may have to look at: all its iterations, at the place
/// where most lies together. It follows from the counts, and is much too careful.
VFPLAN_COMPILED_ONCE double proven_tick_time(const double* xyz, std::size_t n, const Parameters& p);
VFPLAN_COMPILED_ONCE double proven_tick_time(const std::vector<Stroke>& strokes,
                                             const Parameters& p);
/// The inner steps that the rule grants, and the triangles that lie together, which a part of a
/// tick looks through to the end.
VFPLAN_COMPILED_ONCE double proven_tick_time(const mesh::Surface& surface, const Parameters& p);

/// Whether a mesh is rendered best by its triangles: nearer to the truth than by its points
/// (docs/make_mesh.py), if a tick is proven to be short enough.
inline bool by_triangles(const mesh::Surface& surface, const Parameters& p) {
    return proven_tick_time(surface, p) <= max_tick_time;
}

}  // namespace vfplan
