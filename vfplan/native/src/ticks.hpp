// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What keeps a state from tick to tick as the bindings hold it, and ticks as they answer them.
#pragma once

#include <chrono>

#include "numpy.hpp"
#include "vfplan/engine.hpp"
#include "vfplan/governor.hpp"

template <class T>
struct Flagged : T {
    using T::T;
    std::atomic_flag busy = ATOMIC_FLAG_INIT, edited = ATOMIC_FLAG_INIT;
};
using Engine = Flagged<vfplan::Engine>;
using Guide = Flagged<vfplan::Guide>;
using Governor = Flagged<vfplan::Governor>;

// A call while another is under way is refused.
struct Use : ExclusiveUse {
    explicit Use(Guide& guide) : ExclusiveUse(guide.busy, "Guide", "guide") {}
    explicit Use(Governor& governor) : ExclusiveUse(governor.busy, "Governor", "governor") {}
    explicit Use(Engine& engine) : ExclusiveUse(engine.busy, "ProxyEngine", "engine") {
        if (engine.was_exchanged())
            throw std::runtime_error("this ProxyEngine was given to another one in exchange");
    }
};

struct TimedStep : vfplan::Step {
    double seconds = 0;
};

// What an engine or a guide answers a path, an array a member; `tick` gives the step for the number
// of a tick and its HIP. Of an engine the last array has the time of each tick [s].
template <class F>
nb::tuple answers(const Rows& hips, F&& tick) {
    const auto step = [&](std::size_t i) noexcept {
        return tick(i, vfplan::point_at(hips.data(), i));
    };
    if constexpr (std::is_same_v<decltype(step(0)), vfplan::GuideStep>) {
        using vfplan::GuideStep;
        return table(hips.shape(0), step, &GuideStep::proxy, &GuideStep::force, &GuideStep::arc,
                     &GuideStep::lateral, &GuideStep::remaining, &GuideStep::strand,
                     &GuideStep::held, &GuideStep::status);
    } else {
        const auto timed = [&](std::size_t i) noexcept {
            using clock = std::chrono::steady_clock;
            const clock::time_point before = clock::now();
            TimedStep s{step(i)};
            s.seconds = std::chrono::duration<double>(clock::now() - before).count();
            return s;
        };
        return table(hips.shape(0), timed, &TimedStep::proxy, &TimedStep::normal, &TimedStep::force,
                     &TimedStep::state, &TimedStep::status, &TimedStep::seconds);
    }
}

template <class T>
void reset(T& rendered, const vfplan::Vec3& hip) {
    const Use turn(rendered);
    rendered.reset(hip);
}

template <class T>
nb::tuple run(T& rendered, const Rows& hips) {
    const Use turn(rendered);
    return answers(
        hips, [&](std::size_t, const vfplan::Vec3& hip) noexcept { return rendered.step(hip); });
}
