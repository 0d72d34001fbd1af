// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The rules and the bundle reader compiled once, for sources that include them with VFPLAN_COMPILED
// defined. Without exceptions there is no reader.
#ifndef VFPLAN_COMPILED
#define VFPLAN_COMPILED
#endif
#define VFPLAN_COMPILING
#include "vfplan/engine.hpp"

#include "vfplan/cloud/band.hpp"

// What they declare:
#include "vfplan/engine.inl"

#ifdef __cpp_exceptions
#include "vfplan/controller.hpp"
#include "vfplan/controller.inl"
#endif
