// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// How fast the force may grow or turn after a start inside, an exchange or an edit: escape.hpp
// keeps to it on the way out, handover.hpp until the rule has taken over.
#pragma once

#include <algorithm>
#include <cmath>

#include "vfplan/vec.hpp"

namespace vfplan {

/// Of R, a tick: how fast the force may change besides following the HIP.
inline constexpr double ramp = 1.0 / 256;

/// A ball that holds the proxy for one tick. Its middle is where the proxy would be had it gone
/// with the HIP, its radius what K times it may add to the force, or turn it by.
template <int D>
struct Leash {
    Vec<D> middle;
    double radius;

    /// The part of [0, length] from x, in the ball, along the unit vector `way` that stays in it.
    double operator()(const Vec<D>& x, const Vec<D>& way, double length) const noexcept {
        const Vec<D> w = x - middle;
        const double b = dot(w, way), c = dot(w, w) - radius * radius;
        return std::clamp(std::sqrt(std::max(0.0, b * b - c)) - b, 0.0, length);
    }
};

}  // namespace vfplan
