// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// How long a tick may take, from counts alone, before the first tick.
//
// A rule counts what it does in a tick and stops at a budget, which is a half to two thirds of
// `max_tick_time`; the proxy is safe then and goes on in the next tick (status `limit`). What no
// budget cuts is the iteration under way: it looks through the points, features or triangles around
// one place to the end. Among triangles it is cut too, and what is left is the look around the
// place where the tick ends. So these have to be few enough together. All times are those of the
// machine of docs/engine.md, which tests/engine/test_worst_tick.py measures.
#pragma once

#include "vfplan/engine.hpp"
