// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The seal in front of every bundle (docs/format.md): checked before a byte reaches libhdf5.
#pragma once

#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "vfplan/hdf5/error.hpp"
#include "vfplan/hdf5/schema.hpp"
#include "vfplan/hdf5/text.hpp"

namespace vfplan::hdf5 {

using Bytes = std::vector<unsigned char>;
using Digest = std::array<unsigned char, 32>;

inline Digest sha256(std::span<const unsigned char> data) {
    Digest digest{};
    unsigned int length = 0;
    if (EVP_Digest(data.data(), data.size(), digest.data(), &length, EVP_sha256(), nullptr) != 1) {
        throw BundleError("corrupt.seal", "", "SHA-256 is not available");
    }
    return digest;
}

inline std::string to_hex(std::span<const unsigned char> data) {
    constexpr std::string_view digits = "0123456789abcdef";
    std::string hex;
    for (const unsigned char byte : data) {
        hex += digits[byte >> 4];
        hex += digits[byte & 15];
    }
    return hex;
}

/// What a bundle's user block says about its payload.
struct Seal {
    std::uint64_t payload_length = 0;
    Digest digest{};
    bool is_signed = false;
    std::array<unsigned char, 16> key_id{};
    std::array<unsigned char, 64> signature{};
    std::string case_token;        // empty: not given
    std::string robot_serial;      // empty: not given
    std::uint64_t registered = 0;  // seconds since 1970 UTC; 0: not given
    Bytes signed_message;          // what the signature covers
};

namespace detail {

inline constexpr std::string_view magic = "VFPLSEAL";
inline constexpr std::string_view signed_domain{"vfplan bundle seal 1\0", 21};
inline constexpr std::string_view hdf5_signature = "\x89HDF\r\n\x1a\n";
inline constexpr std::size_t head_size = 148, digest_size = 32, least_block = 512;
inline constexpr std::uint64_t latest = 253402300799;  // 9999-12-31T23:59:59Z

template <class T>
T little_endian(std::span<const unsigned char> block, std::size_t offset) {
    T value = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i) {
        value |= static_cast<T>(static_cast<T>(block[offset + i]) << (8 * i));
    }
    return value;
}

inline bool all_zero(std::span<const unsigned char> data) {
    return std::all_of(data.begin(), data.end(), [](unsigned char c) { return c == 0; });
}

inline bool begins(std::span<const unsigned char> data, std::string_view text) {
    return data.size() >= text.size() &&
           std::equal(text.begin(), text.end(), data.begin(),
                      [](char a, unsigned char b) { return static_cast<unsigned char>(a) == b; });
}

inline void check_start(std::span<const unsigned char> data) {
    if (begins(data, hdf5_signature)) {
        throw BundleError("version.seal", "",
                          "has no seal; this program reads versions 1.x, which have one, and a "
                          "bundle of version 0.1 is brought up to date by `vfplan migrate OLD.h5 "
                          "-o NEW.h5`");
    }
    if (!begins(data, magic)) throw BundleError("corrupt.seal", "", "is no fixture bundle");
    if (data.size() < least_block) {
        throw BundleError("corrupt.seal", "", "ends within its seal");
    }
    const auto version = little_endian<std::uint16_t>(data, 8);
    if (version != 1) {
        throw BundleError("version.seal", "",
                          "seal version " + std::to_string(version) +
                              "; this program reads 1: a newer vfplan wrote it, `pip install "
                              "--upgrade vfplan` gets it");
    }
}

inline void parse_texts(Seal& seal, std::span<const unsigned char> block, std::size_t n_case,
                        std::size_t n_serial) {
    const auto* text = reinterpret_cast<const char*>(block.data()) + head_size;
    seal.case_token.assign(text, n_case);
    seal.robot_serial.assign(text + n_case, n_serial);
    for (const std::string& part : {seal.case_token, seal.robot_serial}) {
        if (!is_utf8(part)) throw BundleError("corrupt.seal", "", "the seal's texts are not UTF-8");
    }
    if (has_control(seal.case_token) || has_control(seal.robot_serial)) {
        throw BundleError("corrupt.seal", "", "the seal's texts hold control characters");
    }
    if (seal.registered > latest) {
        throw BundleError("corrupt.seal", "", "registered after the year 9999");
    }
}

inline Seal parse_block(std::span<const unsigned char> block) {
    const auto body = block.first(block.size() - digest_size);
    const Digest digest = sha256(body);
    if (!std::equal(digest.begin(), digest.end(), block.end() - digest_size)) {
        throw BundleError("corrupt.seal", "", "the seal itself is damaged: its SHA-256 differs");
    }
    const auto flags = little_endian<std::uint16_t>(block, 10);
    const std::size_t n_case = little_endian<std::uint16_t>(block, 144);
    const std::size_t n_serial = little_endian<std::uint16_t>(block, 146);
    const std::size_t end = head_size + n_case + n_serial;
    if (end > body.size()) {
        throw BundleError("corrupt.seal", "", "the seal's texts do not fit into it");
    }
    if ((flags & ~1u) != 0 || !all_zero(body.subspan(end))) {
        throw BundleError("corrupt.seal", "", "the seal holds something unknown");
    }
    Seal seal;
    seal.is_signed = (flags & 1u) != 0;
    seal.payload_length = little_endian<std::uint64_t>(block, 16);
    std::copy_n(block.begin() + 24, 32, seal.digest.begin());
    if (!seal.is_signed) {
        if (!all_zero(body.subspan(56))) {
            throw BundleError("corrupt.seal", "",
                              "the seal is unsigned and yet holds what only a signature covers");
        }
        return seal;
    }
    std::copy_n(block.begin() + 56, 16, seal.key_id.begin());
    std::copy_n(block.begin() + 72, 64, seal.signature.begin());
    seal.registered = little_endian<std::uint64_t>(block, 136);
    parse_texts(seal, block, n_case, n_serial);
    seal.signed_message.assign(signed_domain.begin(), signed_domain.end());
    seal.signed_message.insert(seal.signed_message.end(), body.begin(), body.begin() + 72);
    seal.signed_message.insert(seal.signed_message.end(), body.begin() + 136, body.end());
    return seal;
}

}  // namespace detail

/// Checks a bundle's bytes against their seal; `payload` is set to the part behind it.
inline Seal unseal(std::span<unsigned char> data, std::span<unsigned char>& payload) {
    detail::check_start(data);
    const auto length = detail::little_endian<std::uint32_t>(data, 12);
    if (length != 512 && length != 1024 && length != 2048 && length != 4096) {
        throw BundleError("corrupt.seal", "", "seal of " + std::to_string(length) + " bytes");
    }
    if (data.size() < length) throw BundleError("corrupt.seal", "", "ends within its seal");
    Seal seal = detail::parse_block(data.first(length));
    if (seal.payload_length > limits::payload_bytes) {
        throw BundleError("unsafe.cap", "",
                          "payload of " + std::to_string(seal.payload_length) + " bytes");
    }
    payload = data.subspan(length);
    if (payload.size() != seal.payload_length) {
        throw BundleError("corrupt.seal", "",
                          std::to_string(seal.payload_length) + " bytes were sealed, " +
                              std::to_string(payload.size()) + " are there");
    }
    if (sha256(payload) != seal.digest) {
        throw BundleError("corrupt.seal", "",
                          "SHA-256 differs from the sealed one: the bytes are not those written");
    }
    return seal;
}

/// The bytes of a file of at most the size a bundle may have.
inline Bytes read_file(const std::filesystem::path& path) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error)) {
        throw BundleError("input", path.string(), "there is no such file, or it is not regular");
    }
    std::ifstream file(path, std::ios::binary);
    if (!file) throw BundleError("input", path.string(), "cannot be opened");
    const std::uintmax_t size = std::filesystem::file_size(path, error);
    if (size > limits::payload_bytes + 4096) {
        throw BundleError("unsafe.cap", path.string(), "longer than a bundle may be");
    }
    Bytes data(size);
    file.read(reinterpret_cast<char*>(data.data()), static_cast<std::streamsize>(size));
    data.resize(static_cast<std::size_t>(file.gcount()));
    return data;
}

}  // namespace vfplan::hdf5
