// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The loops of points.hpp, compiled for each width: points.hpp includes this, with
// VFPLAN_COMPILED only in engine.cpp.
#pragma once

// Define VFPLAN_NARROW to compile the baseline only, in a third of the time; the bits are the same.
#if defined(__x86_64__) && !defined(VFPLAN_NARROW)
#include <immintrin.h>
#define VFPLAN_WIDE
#endif

namespace vfplan::inline v1 {

namespace detail {

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"

#define VFPLAN_LANES 2
#define VFPLAN_TARGET
namespace lanes2 {
#include "vfplan/cloud/kernels.inl"
}

#ifdef VFPLAN_WIDE
#define VFPLAN_LANES 4
#define VFPLAN_TARGET target("avx2")
namespace lanes4 {
#include "vfplan/cloud/kernels.inl"
}

#define VFPLAN_LANES 8
#define VFPLAN_TARGET target("avx2,avx512f,avx512dq,avx512vl")
namespace lanes8 {
#include "vfplan/cloud/kernels.inl"
}
#endif

#pragma GCC diagnostic pop

template <int D>
Kernels<D> kernels_of([[maybe_unused]] Width width) noexcept {
#ifdef VFPLAN_WIDE
    if (width == Width::eight) return lanes8::table<D>();
    if (width == Width::four) return lanes4::table<D>();
#endif
    return lanes2::table<D>();
}

}  // namespace detail

/// The widest the processor at hand can run.
VFPLAN_ONCE Width widest() noexcept {
#ifdef VFPLAN_WIDE
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
        return Width::eight;
    if (__builtin_cpu_supports("avx2")) return Width::four;
#endif
    return Width::two;
}

VFPLAN_ONCE void use_width(Width width) noexcept {
    width = std::min(width, widest());
    // By name: g++'s ThreadSanitizer does not see what a call writes into its result.
    const Kernels<2> in_plane = detail::kernels_of<2>(width);
    const Kernels<3> in_space = detail::kernels_of<3>(width);
    kernels<2> = in_plane;
    kernels<3> = in_space;
}
VFPLAN_ONCE void choose_kernels() noexcept {
    [[maybe_unused]] static const bool once = [] {
        if (!kernels<2>.gather) use_width(widest());
        return true;
    }();
}

}  // namespace vfplan::inline v1
