// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// An engine as the bindings hold it, and ticks as they answer them.
#pragma once

#include <chrono>

#include "numpy.hpp"
#include "vfplan/engine.hpp"

// An engine keeps its proxy from tick to tick: a call while another is under way is refused.
struct Engine : vfplan::Engine {
    using vfplan::Engine::Engine;
    std::atomic_flag busy = ATOMIC_FLAG_INIT, edited = ATOMIC_FLAG_INIT;
};

struct EngineUse : ExclusiveUse {
    explicit EngineUse(Engine& engine) : ExclusiveUse(engine.busy, "ProxyEngine", "engine") {
        if (engine.was_exchanged())
            throw std::runtime_error("this ProxyEngine was given to another one in exchange");
    }
};

inline nb::tuple answer(const vfplan::Step& s) {
    auto rows = array<double>(3, 3);
    const vfplan::Vec3* from[] = {&s.proxy, &s.normal, &s.force};
    for (int i = 0; i < 3; ++i) std::memcpy(rows.data() + 3 * i, from[i]->c, sizeof from[i]->c);
    return nb::make_tuple(rows, static_cast<int>(s.state), static_cast<int>(s.status));
}

// Proxy, normal, force (T, 3), state, status (T,), and the time of each tick [s] when asked for;
// `tick` gives a Step for the number of a tick and its HIP.
template <class F>
nb::tuple ticks(const Rows& hips, bool timed, F&& tick) {
    const std::size_t n = hips.shape(0);
    auto proxy = array<double>(n, 3), normal = array<double>(n, 3), force = array<double>(n, 3);
    auto state = array<std::int8_t>(n, 1);
    auto status = array<std::uint8_t>(n, 1);
    auto seconds = array<double>(timed ? n : 0, 1);
    const double* h = hips.data();
    {
        nb::gil_scoped_release release;
        using clock = std::chrono::steady_clock;
        for (std::size_t i = 0; i < n; ++i) {
            clock::time_point before;
            if (timed) before = clock::now();
            const vfplan::Step s = tick(i, vfplan::point_at(h, i));
            if (timed)
                seconds.data()[i] = std::chrono::duration<double>(clock::now() - before).count();
            std::memcpy(proxy.data() + 3 * i, s.proxy.c, sizeof s.proxy.c);
            std::memcpy(normal.data() + 3 * i, s.normal.c, sizeof s.normal.c);
            std::memcpy(force.data() + 3 * i, s.force.c, sizeof s.force.c);
            state.data()[i] = static_cast<std::int8_t>(s.state);
            status.data()[i] = s.status;
        }
    }
    return nb::make_tuple(proxy, normal, force, state, status, seconds);
}
