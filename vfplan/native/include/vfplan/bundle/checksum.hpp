// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The checksum behind each piece of an HDF5 file's metadata: Jenkins' lookup3. The seal covers
// those bytes already, but libhdf5 does not open a file whose checksums are wrong, and no reader is
// to take what another one refuses.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "vfplan/bundle/bytes.hpp"

namespace vfplan::bundle::detail {

/// Whether a checksum that differs is refused: always, but for fuzzers, which would not get past.
#ifdef FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION
inline constexpr bool sums_count = false;
#else
inline constexpr bool sums_count = true;
#endif

/// Bob Jenkins' hash of 2006 over bytes, begun with 0.
inline std::uint32_t lookup3(View data) {
    const auto turn = [](std::uint32_t x, int n) { return x << n | x >> (32 - n); };
    std::uint32_t a = 0xdeadbeefu + static_cast<std::uint32_t>(data.size()), b = a, c = a;
    const auto add = [&](View part) {
        std::array<std::uint32_t, 3> word{};
        for (std::size_t i = 0; i < part.size(); ++i) {
            word[i / 4] += static_cast<std::uint32_t>(part[i]) << (8 * (i % 4));
        }
        a += word[0], b += word[1], c += word[2];
    };
    for (; data.size() > 12; data = data.from(12)) {
        add(data.first(12));
        a = (a - c) ^ turn(c, 4), c += b;
        b = (b - a) ^ turn(a, 6), a += c;
        c = (c - b) ^ turn(b, 8), b += a;
        a = (a - c) ^ turn(c, 16), c += b;
        b = (b - a) ^ turn(a, 19), a += c;
        c = (c - b) ^ turn(b, 4), b += a;
    }
    if (data.size() == 0) return c;
    add(data);
    c = (c ^ b) - turn(b, 14);
    a = (a ^ c) - turn(c, 11);
    b = (b ^ a) - turn(a, 25);
    c = (c ^ b) - turn(b, 16);
    a = (a ^ c) - turn(c, 4);
    b = (b ^ a) - turn(a, 14);
    return (c ^ b) - turn(b, 24);
}

}  // namespace vfplan::bundle::detail
