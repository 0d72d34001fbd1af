// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The seal behind a bundle, and the SHA-256 that it holds.
#pragma once

#include <filesystem>
#include <fstream>

#include "vfplan/bundle/schema.hpp"
#include "vfplan/bundle/types.hpp"

namespace vfplan::bundle {

// SHA-256 (FIPS 180-4).

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

inline void add_block(ShaState& state, const Bytes& block) {
    const auto turn = [](std::uint32_t x, int n) { return x >> n | x << (32 - n); };
    std::array<std::uint32_t, 64> w{};
    for (std::size_t i = 0; i < 64; ++i) w[i / 4] = w[i / 4] << 8 | block[i];
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

}  // namespace detail

/// SHA-256 of bytes that come in parts, of which no more than a block is held.
class Sha256 {
  public:
    void add(const void* from, std::size_t size) {
        length_ += size;
        View data(static_cast<const unsigned char*>(from), size);
        while (!data.empty()) {
            const View part = data.first(std::min(64 - block_.size(), data.size()));
            block_.insert(block_.end(), part.begin(), part.end());
            data = data.from(part.size());
            if (block_.size() < 64) return;
            detail::add_block(state_, block_);
            block_.clear();
        }
    }
    Digest digest() {
        // Behind the data: a bit, zeros, and the number of bits in all, to the end of a block.
        Bytes end((119 - block_.size()) % 64 + 1);
        end.front() = 0x80;
        for (int shift = 56; shift >= 0; shift -= 8)
            end.push_back(static_cast<unsigned char>(8 * length_ >> shift));
        add(end.data(), end.size());
        Digest out{};
        for (std::size_t i = 0; i < out.size(); ++i)
            out[i] = static_cast<unsigned char>(state_[i / 4] >> (24 - 8 * (i % 4)));
        return out;
    }

  private:
    detail::ShaState state_{0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                            0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
    Bytes block_;  // less than 64
    std::uint64_t length_ = 0;
};

inline Digest sha256(View data) {
    Sha256 sum;
    sum.add(data.data(), data.size());
    return sum.digest();
}

inline std::string to_hex(View data) {
    std::string hex;
    for (const unsigned char byte : data) hex += hex_of(byte);
    return hex;
}

// The seal behind every bundle (docs/format.md, section 4): checked before anything else.

namespace detail {

inline constexpr std::string_view seal_magic = "VFPLSEAL";
inline constexpr std::string_view tail_magic = "VFPLTAIL";
inline constexpr std::string_view signed_domain{"vfplan bundle seal 2\0", 21};
inline constexpr std::array<std::uint32_t, 4> seal_sizes{512, 1024, 2048, 4096};
inline constexpr std::uint64_t seal_version = 2;
inline constexpr std::size_t superblock_size = 48;
inline constexpr std::size_t head_size = 148;          // of a seal, before its texts
inline constexpr std::size_t tail_size = 48;           // of a seal, behind them
inline constexpr std::uint64_t latest = 253402300799;  // 9999-12-31T23:59:59Z

inline void require(bool good, Sentence wrong) { require(good, "corrupt.seal", "", wrong); }

/// The seal that a file ends in: it is there, and says of the file's length what is true.
inline View find_seal(View data) {
    detail::require(!data.begins(seal_magic), "version.seal", "",
                    {"has its seal in front, as versions 1.0 and 1.1 had it"}, "Plan it anew");
    detail::require(data.begins(hdf5_signature), "corrupt.seal", "",
                    {"is no fixture bundle: it does not begin as an HDF5 file does"},
                    "Give a bundle that `vfplan plan` or `vfplan import` wrote");
    const bool is_result = data.text().substr(0, 1 << 16).find("vfplan-result") != data.text().npos;
    require(
        data.size() >= superblock_size + seal_sizes.front() &&
            data.from(data.size() - tail_magic.size()).text() == tail_magic,
        {is_result ? "is a result of `vfplan replay`, and no fixture bundle"
                   : "has no seal: the file was cut, or opened for writing by another program"});
    const auto size = static_cast<std::size_t>(number_at(data, data.size() - 16, 4));
    require(std::find(seal_sizes.begin(), seal_sizes.end(), size) != seal_sizes.end(),
            {"has a seal of ", size, " bytes; 512, 1024, 2048 or 4096 wanted"});
    require(size + superblock_size <= data.size(),
            {"has a seal that is as long as the whole file"});
    const View seal = data.from(data.size() - size);
    require(seal.begins(seal_magic),
            {"has a seal that does not begin ", size, " bytes before the file's end, as it says"});
    const auto version = number_at(seal, 8, 2);
    require(version == seal_version, "version.seal", "",
            {"has a seal of version ", version, "; this program reads 2"},
            "Get a program that reads it: pip install --upgrade vfplan");
    const auto payload = number_at(seal, 16, 8);
    require(number_at(seal, 12, 4) == size && number_at(seal, size - 12, 4) == 0,
            {"has a seal that says two lengths of itself"});
    require(payload == data.size() - size,
            {"has ", data.size() - size, " bytes before its seal, which covers ", payload});
    require(payload % 8 == 0, {"has a sealed part that is no multiple of 8 bytes long"});
    require(payload <= limits::payload_bytes, "unsafe.cap", "",
            {"has a payload of ", payload, " bytes; at most ", limits::payload_bytes, " allowed"});
    return seal;
}

/// What a seal of a length that it may have says. Its texts lie within it, nothing follows them,
/// and it is no longer than they need.
inline Seal read_seal(View block) {
    const View body = block.first(block.size() - tail_size);
    const auto count = [&](std::size_t at) {
        return static_cast<std::size_t>(number_at(body, at, 2));
    };
    const std::size_t flags = count(10), robot = head_size + count(144), end = robot + count(146);
    require(end <= body.size(), {"has a seal into which its texts do not fit"});
    const auto* shortest = std::ranges::lower_bound(seal_sizes, end + tail_size);
    require(*shortest == block.size(), {"has a seal that is longer than its texts need"});
    require(flags <= 3 && body.from(end).all_zero(), {"has a seal that holds something unknown"});
    require(std::ranges::equal(sha256(body), block.part(body.size(), 32)),
            {"has a damaged seal: its SHA-256 differs"});
    Seal seal;
    seal.is_signed = (flags & 1) != 0;
    seal.despite_findings = (flags & 2) != 0;
    require(seal.is_signed || !seal.despite_findings,
            {"has an unsigned seal that is yet signed in spite of findings"});
    require(seal.is_signed || body.from(56).all_zero(),
            {"has an unsigned seal that holds what only a signature covers"});
    std::copy_n(body.begin() + 24, 32, seal.digest.begin());
    if (!seal.is_signed) return seal;
    std::copy_n(body.begin() + 56, 16, seal.key_id.begin());
    std::copy_n(body.begin() + 72, 64, seal.signature.begin());
    seal.signed_at = number_at(body, 136, 8);
    seal.case_token = body.part(head_size, count(144)).text();
    seal.robot_serial = body.part(robot, count(146)).text();
    for (const std::string* part : {&seal.case_token, &seal.robot_serial}) {
        require(is_utf8(*part), {"has texts in its seal that are not UTF-8"});
        require(!has_control(*part), {"has texts in its seal that hold control characters"});
    }
    require(seal.signed_at <= latest,
            {"was signed ", seal.signed_at, " s after 1970; at most ", latest, " allowed"});
    // Everything but the signature itself, and the tail, which repeats what is known.
    seal.signed_message.assign(signed_domain.begin(), signed_domain.end());
    seal.signed_message.insert(seal.signed_message.end(), body.begin(), body.begin() + 72);
    seal.signed_message.insert(seal.signed_message.end(), body.begin() + 136, body.end());
    return seal;
}

}  // namespace detail

/// Checks a bundle's bytes against the seal that they end in; `payload` is set to what it seals.
inline Seal unseal(View data, View& payload) {
    const View block = detail::find_seal(data);
    Seal seal = detail::read_seal(block);
    payload = data.first(data.size() - block.size());
    detail::require(sha256(payload) == seal.digest,
                    {"has another SHA-256 than the sealed one: the bytes are not those written"});
    return seal;
}

/// The bytes of a file of at most the size a bundle may have.
inline Bytes read_file(const std::filesystem::path& path) {
    std::error_code error;
    const std::string name = path.string();
    detail::require(std::filesystem::is_regular_file(path, error), "input", name,
                    {"is no regular file, or not there"});
    std::ifstream file(path, std::ios::binary);
    detail::require(bool(file), "input", name, {"cannot be opened"}, "Check its permissions");
    const std::uintmax_t size = std::filesystem::file_size(path, error);
    detail::require(size <= limits::payload_bytes + detail::seal_sizes.back(), "unsafe.cap", name,
                    {"is longer than a bundle may be"});
    Bytes data(static_cast<std::size_t>(size));
    file.read(reinterpret_cast<char*>(data.data()), static_cast<std::streamsize>(size));
    data.resize(static_cast<std::size_t>(file.gcount()));
    return data;
}

}  // namespace vfplan::bundle
