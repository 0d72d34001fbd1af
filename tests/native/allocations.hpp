// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Counts what a program takes from the heap and gives back, a thread each: a loop may do neither.
// Include it once, in the file that has main.
#pragma once

#include <cstdlib>
#include <new>

static thread_local long allocations = 0;

// Out of line, else g++ takes the two for a pair that does not match.
[[gnu::noinline]] void* operator new(std::size_t n) {
    ++allocations;
    if (void* p = std::malloc(n ? n : 1)) return p;
    throw std::bad_alloc();
}
// A stable sort asks in this way, and lets go in the usual one.
[[gnu::noinline]] void* operator new(std::size_t n, const std::nothrow_t&) noexcept {
    ++allocations;
    return std::malloc(n ? n : 1);
}
[[gnu::noinline]] void* operator new(std::size_t n, std::align_val_t line) {
    ++allocations;
    const auto step = static_cast<std::size_t>(line);
    if (void* p = std::aligned_alloc(step, (n + step) / step * step)) return p;
    throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* p) noexcept {
    ++allocations;
    std::free(p);
}
[[gnu::noinline]] void operator delete(void* p, std::align_val_t) noexcept { operator delete(p); }
[[gnu::noinline]] void operator delete(void* p, std::size_t) noexcept { operator delete(p); }
[[gnu::noinline]] void operator delete(void* p, std::size_t, std::align_val_t) noexcept {
    operator delete(p);
}
