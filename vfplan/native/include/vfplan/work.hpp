// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Names that the bundle's headers still use.
#pragma once

#include <utility>

#include "vfplan/tick_time.hpp"

namespace vfplan {

template <class... Args>
double tick_work(const Args&... args) {
    return tick_time_bound(args...);
}
inline constexpr double most_tick_work = max_tick_time;

}  // namespace vfplan
