// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// How long a tick may take, from counts alone, before the first tick.
//
// A rule counts what it does in a tick and stops at a budget, which is a half to two thirds of
// `max_tick_time`; the proxy is safe then and goes on in the next tick (status `limit`). What no
// budget cuts is the iteration under way: it looks through the points, features or triangles around
// one place to the end. So these have to be few enough together. All times are those of the machine
// of docs/engine.md, which tests/engine/test_worst_tick.py measures.
#pragma once

#include "vfplan/curve/pieces.hpp"
#include "vfplan/mesh/triangles.hpp"
#include "vfplan/parameters.hpp"

namespace vfplan::inline v1 {

/// Time [s] that a tick among n points takes at most. Throws std::invalid_argument, as the others.
VFPLAN_COMPILED_ONCE double tick_time_bound(const double* xyz, std::size_t n, const Parameters& p);
/// The same of rule exact among lines and arcs.
VFPLAN_COMPILED_ONCE double tick_time_bound(const std::vector<Stroke>& strokes,
                                            const Parameters& p);
/// The same of rule exact among triangles.
VFPLAN_COMPILED_ONCE double tick_time_bound(const mesh::Surface& surface, const Parameters& p);

}  // namespace vfplan::inline v1

#ifndef VFPLAN_COMPILED
#include "vfplan/engine.inl"
#endif
