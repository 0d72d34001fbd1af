// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What the engine asks of a compiler, said where it fails.
#pragma once

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error \
    "vfplan: built with -ffast-math or -ffinite-math-only, a NaN would become a force: leave them out"
#endif
#if !defined(__GNUC__)
#error "vfplan: needs vector extensions: build with g++, clang or MinGW"
#endif

#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>

namespace vfplan {

/// Throws; in a program without exceptions, prints the reason and aborts.
template <class Error = std::invalid_argument>
[[noreturn]] inline void reject(const std::string& why) {
#ifdef __cpp_exceptions
    throw Error("vfplan: " + why);
#else
    std::fprintf(stderr, "vfplan: %s\n", why.c_str());
    std::abort();
#endif
}

}  // namespace vfplan
