// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What one tick answers.
#pragma once

#include <cstdint>

#include "vfplan/vec.hpp"

namespace vfplan {

/// The paper's state of the proxy.
enum class State : std::int8_t {
    no_neighbour = -1,
    free_motion = 0,
    in_contact = 1,
    entrenched = 2
};

/// What a tick has to say beside its result; bits, 0 when all is well.
enum Status : std::uint8_t {
    ok = 0,
    bad_hip = 1,     ///< HIP not finite or beyond 1e6 m: the proxy stayed, the force is its last;
                     ///< before the first good HIP both are 0
    inside = 2,      ///< started inside: the proxy is led out and handed to the rule
    limit = 4,       ///< the tick used up its iterations; the proxy is safe and goes on next tick
    stale_pose = 8,  ///< the moving fixture's pose is too old: its last frame stands; before the
                     ///< first pose nothing is rendered
    changing = 16,   ///< the fixture was exchanged or edited: the force is on its way to K (proxy
                     ///< - HIP)
    crossed = 32,    ///< with `inside`: no way out was found on the side where the proxy was before
                     ///< the exchange
};

/// What a rule says of a tick, in the space it works in.
template <int D>
struct Tick {
    Vec<D> normal;
    State state = State::no_neighbour;
    std::uint8_t status = ok;
};

struct Step {
    Vec3 proxy;   ///< [m]
    Vec3 normal;  ///< unit, 0 when there is none
    Vec3 force;   ///< on the hand [N]
    State state = State::no_neighbour;
    std::uint8_t status = ok;
};

}  // namespace vfplan
