// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The loops of kernels.hpp, compiled for each width: kernels.hpp includes this, with VFPLAN_COMPILED
// only in engine.cpp.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__)
#include <immintrin.h>
#define VFPLAN_X86 1
#else
#define VFPLAN_X86 0
#endif
// Define VFPLAN_NARROW to compile the baseline only, in a third of the time; the bits are the same.
#if VFPLAN_X86 && !defined(VFPLAN_NARROW)
#define VFPLAN_WIDE 1
#else
#define VFPLAN_WIDE 0
#endif

namespace vfplan::inline v1 {

namespace detail {

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
#endif

#define VFPLAN_PRAGMA(...) _Pragma(#__VA_ARGS__)
#if defined(__clang__)
#define VFPLAN_BEGIN(features) \
    VFPLAN_PRAGMA(clang attribute push(__attribute__((target(features))), apply_to = function))
#define VFPLAN_END VFPLAN_PRAGMA(clang attribute pop)
#else
#define VFPLAN_BEGIN(features) \
    VFPLAN_PRAGMA(GCC push_options) VFPLAN_PRAGMA(GCC target(features, "prefer-vector-width=512"))
#define VFPLAN_END VFPLAN_PRAGMA(GCC pop_options)
#endif

#define VFPLAN_LANES 2
namespace lanes2 {
#include "vfplan/cloud/kernels.inl"
}
#undef VFPLAN_LANES

#if VFPLAN_WIDE
VFPLAN_BEGIN("avx2")
#define VFPLAN_LANES 4
namespace lanes4 {
#include "vfplan/cloud/kernels.inl"
}
#undef VFPLAN_LANES
VFPLAN_END

VFPLAN_BEGIN("avx2,avx512f,avx512dq,avx512vl")
#define VFPLAN_LANES 8
namespace lanes8 {
#include "vfplan/cloud/kernels.inl"
}
#undef VFPLAN_LANES
VFPLAN_END
#endif
#undef VFPLAN_PRAGMA
#undef VFPLAN_BEGIN
#undef VFPLAN_END

#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

}  // namespace detail

/// The widest the processor at hand can run.
VFPLAN_COMPILED_ONCE Width widest() noexcept {
#if VFPLAN_WIDE
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
        return Width::eight;
    if (__builtin_cpu_supports("avx2")) return Width::four;
#endif
    return Width::two;
}

/// The loops for a width; one that the processor lacks falls back to the widest it has.
template <int D>
Kernels<D> kernels(Width width) noexcept {
    const Width available = widest();
    if (width == Width::automatic || static_cast<int>(width) > static_cast<int>(available))
        width = available;
#if VFPLAN_WIDE
    if (width == Width::eight) return detail::lanes8::table<D>();
    if (width == Width::four) return detail::lanes4::table<D>();
#endif
    return detail::lanes2::table<D>();
}

}  // namespace vfplan::inline v1
