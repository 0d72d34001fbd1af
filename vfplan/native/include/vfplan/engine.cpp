// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The rules compiled once, for sources that include vfplan/engine.hpp with VFPLAN_COMPILED defined.
#ifndef VFPLAN_COMPILED
#define VFPLAN_COMPILED
#endif
#include "vfplan/engine.hpp"

#include "vfplan/tick_time.hpp"

// What they declare:
#include "vfplan/engine_impl.hpp"
