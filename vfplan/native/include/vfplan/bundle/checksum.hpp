// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The two checksums of an HDF5 file: Jenkins' lookup3 behind metadata, Fletcher's behind chunks.
#pragma once

#include <algorithm>
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

/// Fletcher's checksum as libhdf5 has it: over 16-bit words, big-endian, modulo 65535, where a sum
/// of 0 comes from zeros only.
///
/// Exchanging the bytes of all words multiplies both sums by 256 modulo 65535, which exchanges
/// their bytes: so the words are read little-endian, and weighted instead of summed up twice,
/// which a compiler can do for many words at once.
inline std::uint32_t fletcher32(View data) {
    constexpr std::size_t most = 256;  // words for which no sum leaves 32 bits
    std::uint64_t sum = 0, twice = 0;
    const auto add = [&](const unsigned char* at, std::size_t words) {
        std::uint32_t once = 0, weighted = 0;
        for (std::size_t i = 0; i < words; ++i) {
            const std::uint32_t word = at[2 * i] | static_cast<std::uint32_t>(at[2 * i + 1]) << 8;
            once += word;
            weighted += static_cast<std::uint32_t>(words - i) * word;
        }
        twice = (twice + words * sum + weighted) % 65535;
        sum = (sum + once) % 65535;
    };
    const bool zeros = data.all_zero();
    const std::size_t words = data.size() / 2;
    std::size_t i = 0;
    for (; i + most <= words; i += most) add(data.data() + 2 * i, most);
    add(data.data() + 2 * i, words - i);
    if (data.size() % 2 != 0) {
        const std::array<unsigned char, 2> last{data[data.size() - 1], 0};
        add(last.data(), 1);
    }
    const auto folded = [&](std::uint64_t x) {
        const auto s = static_cast<std::uint32_t>(x == 0 && !zeros ? 65535 : x);
        return (s & 0xFF) << 8 | s >> 8;
    };
    return folded(twice) << 16 | folded(sum);
}

}  // namespace vfplan::bundle::detail
