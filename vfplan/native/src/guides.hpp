// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A guide as the bindings hold it, and ticks as they answer them.
#pragma once

#include "numpy.hpp"
#include "vfplan/guide.hpp"

struct Guide : vfplan::Guide {
    using vfplan::Guide::Guide;
    std::atomic_flag busy = ATOMIC_FLAG_INIT;
};

struct GuideUse : ExclusiveUse {
    explicit GuideUse(Guide& guide) : ExclusiveUse(guide.busy, "Guide", "guide") {}
};

// Proxy, force (T, 3), arc, lateral, remaining (T,), strand, held, status (T,); `tick` gives a
// GuideStep for the number of a tick and its HIP.
template <class F>
nb::tuple guided(const Rows& hips, F&& tick) {
    const std::size_t n = hips.shape(0);
    auto proxy = array<double>(n, 3), force = array<double>(n, 3);
    auto arc = array<double>(n, 1), lateral = array<double>(n, 1), remaining = array<double>(n, 1);
    auto strand = array<std::int32_t>(n, 1);
    auto held = array<bool>(n, 1);
    auto status = array<std::uint8_t>(n, 1);
    {
        nb::gil_scoped_release release;
        const double* h = hips.data();
        for (std::size_t i = 0; i < n; ++i) {
            const vfplan::GuideStep s = tick(i, vfplan::point_at(h, i));
            std::memcpy(proxy.data() + 3 * i, s.proxy.c, sizeof s.proxy.c);
            std::memcpy(force.data() + 3 * i, s.force.c, sizeof s.force.c);
            arc.data()[i] = s.arc;
            lateral.data()[i] = s.lateral;
            remaining.data()[i] = s.remaining;
            strand.data()[i] = static_cast<std::int32_t>(s.strand);
            held.data()[i] = s.held;
            status.data()[i] = s.status;
        }
    }
    return nb::make_tuple(proxy, force, arc, lateral, remaining, strand, held, status);
}
