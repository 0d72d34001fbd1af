// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What the headers ask of a compiler, how they say that it is missing, and what all of them may use
// of the standard library: each other header includes only what it uses beside, and what the
// headers that it includes do not.
#pragma once

#if !defined(__cpp_concepts)
#error "vfplan: needs C++20: compile with -std=c++20, by g++ 11 or clang 14 or later"
// No file has this name. It ends the compilation here, before the many errors that would follow.
#include "vfplan/needs_cpp20"
#endif
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error \
    "vfplan: built with -ffast-math or -ffinite-math-only, a NaN would become a force: leave them out"
#endif
#if !defined(__GNUC__)
#error "vfplan: needs vector extensions: build with g++, clang or MinGW"
#endif

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

/// Stands before a function that engine.inl or controller.inl defines. With
/// VFPLAN_COMPILED it is compiled in engine.cpp alone, without it in each source file.
#ifdef VFPLAN_COMPILED
#define VFPLAN_ONCE
#else
#define VFPLAN_ONCE inline
#endif

/// All names stand in a namespace of their version, so that two versions in one program do not mix.
namespace vfplan::inline v1 {
namespace bundle::detail {}
namespace detail {}
}  // namespace vfplan::inline v1
