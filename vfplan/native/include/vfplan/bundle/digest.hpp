// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// SHA-256 (FIPS 180-4), with the processor's own instructions where it has them.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include "vfplan/bundle/bytes.hpp"

#if (defined(__x86_64__) || defined(__i386__)) && defined(__GNUC__)
#include <cpuid.h>
#include <immintrin.h>
#define VFPLAN_SHA_NI
#endif

namespace vfplan::bundle {

using Digest = std::array<unsigned char, 32>;

namespace detail {

using ShaState = std::array<std::uint32_t, 8>;

inline constexpr std::array<std::uint32_t, 64> sha_rounds{
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
    0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
    0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
    0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
    0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
    0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
    0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};

inline void sha_blocks_plain(ShaState& state, const unsigned char* data, std::size_t blocks) {
    const auto turn = [](std::uint32_t x, int n) { return x >> n | x << (32 - n); };
    for (; blocks > 0; --blocks, data += 64) {
        std::array<std::uint32_t, 64> w{};
        for (std::size_t i = 0; i < 16; ++i) {
            for (std::size_t k = 0; k < 4; ++k) w[i] = w[i] << 8 | data[4 * i + k];
        }
        for (std::size_t i = 16; i < 64; ++i) {
            const std::uint32_t a = w[i - 15], b = w[i - 2];
            w[i] = w[i - 16] + (turn(a, 7) ^ turn(a, 18) ^ a >> 3) + w[i - 7] +
                   (turn(b, 17) ^ turn(b, 19) ^ b >> 10);
        }
        ShaState s = state;
        for (std::size_t i = 0; i < 64; ++i) {
            const std::uint32_t one = s[7] + (turn(s[4], 6) ^ turn(s[4], 11) ^ turn(s[4], 25)) +
                                      ((s[4] & s[5]) ^ (~s[4] & s[6])) + sha_rounds[i] + w[i];
            const std::uint32_t two = (turn(s[0], 2) ^ turn(s[0], 13) ^ turn(s[0], 22)) +
                                      ((s[0] & s[1]) ^ (s[0] & s[2]) ^ (s[1] & s[2]));
            s = {one + two, s[0], s[1], s[2], s[3] + one, s[4], s[5], s[6]};
        }
        for (std::size_t i = 0; i < 8; ++i) state[i] += s[i];
    }
}

#ifdef VFPLAN_SHA_NI
inline bool has_sha_ni() {
    unsigned a = 0, b = 0, c = 0, d = 0;
    constexpr unsigned ssse3_and_sse41 = 1u << 9 | 1u << 19, sha = 1u << 29;
    if (__get_cpuid(1, &a, &b, &c, &d) == 0 || (c & ssse3_and_sse41) != ssse3_and_sse41) {
        return false;
    }
    return __get_cpuid_count(7, 0, &a, &b, &c, &d) != 0 && (b & sha) != 0;
}

/// The instructions keep the state as (a b e f) and (c d g h) and do two rounds at a time.
__attribute__((target("sha,sse4.1,ssse3"))) inline void sha_blocks_ni(ShaState& state,
                                                                      const unsigned char* data,
                                                                      std::size_t blocks) {
    const auto load = [](const void* from) __attribute__((target("sse4.1"))) {
        return _mm_loadu_si128(static_cast<const __m128i*>(from));
    };
    const __m128i big_endian = _mm_set_epi64x(0x0c0d0e0f08090a0b, 0x0405060700010203);
    const __m128i cdab = _mm_shuffle_epi32(load(state.data()), 0xB1);
    const __m128i efgh = _mm_shuffle_epi32(load(state.data() + 4), 0x1B);
    __m128i abef = _mm_alignr_epi8(cdab, efgh, 8), cdgh = _mm_blend_epi16(efgh, cdab, 0xF0);
    for (; blocks > 0; --blocks, data += 64) {
        const __m128i abef_before = abef, cdgh_before = cdgh;
        __m128i w[4];
        for (int i = 0; i < 4; ++i) w[i] = _mm_shuffle_epi8(load(data + 16 * i), big_endian);
#pragma GCC unroll 16
        for (unsigned i = 0; i < 16; ++i) {
            __m128i& now = w[i % 4];
            if (i >= 4) {
                const __m128i last = w[(i + 3) % 4];
                now = _mm_add_epi32(_mm_sha256msg1_epu32(now, w[(i + 1) % 4]),
                                    _mm_alignr_epi8(last, w[(i + 2) % 4], 4));
                now = _mm_sha256msg2_epu32(now, last);
            }
            const __m128i keyed = _mm_add_epi32(now, load(sha_rounds.data() + 4 * i));
            cdgh = _mm_sha256rnds2_epu32(cdgh, abef, keyed);
            abef = _mm_sha256rnds2_epu32(abef, cdgh, _mm_shuffle_epi32(keyed, 0x0E));
        }
        abef = _mm_add_epi32(abef, abef_before);
        cdgh = _mm_add_epi32(cdgh, cdgh_before);
    }
    const __m128i feba = _mm_shuffle_epi32(abef, 0x1B), dchg = _mm_shuffle_epi32(cdgh, 0xB1);
    _mm_storeu_si128(reinterpret_cast<__m128i*>(state.data()), _mm_blend_epi16(feba, dchg, 0xF0));
    _mm_storeu_si128(reinterpret_cast<__m128i*>(state.data() + 4), _mm_alignr_epi8(dchg, feba, 8));
}
#endif

inline void sha_blocks(ShaState& state, const unsigned char* data, std::size_t blocks) {
#ifdef VFPLAN_SHA_NI
    static const bool fast = has_sha_ni();
    if (fast) return sha_blocks_ni(state, data, blocks);
#endif
    sha_blocks_plain(state, data, blocks);
}

}  // namespace detail

/// SHA-256 of bytes that come in parts.
class Sha256 {
  public:
    void update(View data) {
        length_ += data.size();
        if (held_ > 0) {
            const std::size_t some = std::min(data.size(), block_.size() - held_);
            std::copy_n(data.data(), some, block_.begin() + static_cast<std::ptrdiff_t>(held_));
            held_ += some;
            data = data.from(some);
            if (held_ < block_.size()) return;
            detail::sha_blocks(state_, block_.data(), 1);
        }
        const std::size_t blocks = data.size() / block_.size();
        detail::sha_blocks(state_, data.data(), blocks);
        const View rest = data.from(blocks * block_.size());
        std::copy(rest.begin(), rest.end(), block_.begin());
        held_ = rest.size();
    }
    Digest digest() {
        const std::uint64_t bits = 8 * length_;
        Bytes padding(1 + (119 - held_) % 64 + 8, 0);
        padding[0] = 0x80;
        for (std::size_t i = 0; i < 8; ++i) {
            padding[padding.size() - 1 - i] = static_cast<unsigned char>(bits >> (8 * i));
        }
        update(padding);
        Digest out{};
        for (std::size_t i = 0; i < out.size(); ++i) {
            out[i] = static_cast<unsigned char>(state_[i / 4] >> (24 - 8 * (i % 4)));
        }
        return out;
    }

  private:
    detail::ShaState state_{0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                            0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
    std::array<unsigned char, 64> block_{};
    std::size_t held_ = 0;
    std::uint64_t length_ = 0;
};

inline Digest sha256(View data) {
    Sha256 sum;
    sum.update(data);
    return sum.digest();
}

inline std::string to_hex(View data) {
    constexpr std::string_view digits = "0123456789abcdef";
    std::string hex;
    for (const unsigned char byte : data) {
        hex += digits[byte >> 4];
        hex += digits[byte & 15];
    }
    return hex;
}

template <std::size_t n>
View view(const std::array<unsigned char, n>& bytes) {
    return {bytes.data(), n};
}

}  // namespace vfplan::bundle
