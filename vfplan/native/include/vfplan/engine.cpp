// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The rules and the bundle reader compiled once, for sources that include them with VFPLAN_COMPILED
// defined. Without exceptions there is no reader.
#ifndef VFPLAN_COMPILED
#define VFPLAN_COMPILED
#endif
#include "vfplan/engine.hpp"

#include "vfplan/tick_time.hpp"

// What they declare:
#include "vfplan/engine.inl"

#ifdef __cpp_exceptions
#include "vfplan/controller.hpp"
#include "vfplan/controller.inl"

vfplan::bundle::Content vfplan::bundle::read_payload(View payload, std::uint64_t file_length,
                                                     Findings& findings) {
    return detail::read_and_check(payload, file_length, findings);
}
#endif
