// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The seal in front of every bundle (docs/format.md): checked before anything else.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

#include "vfplan/bundle/bytes.hpp"
#include "vfplan/bundle/digest.hpp"
#include "vfplan/bundle/finding.hpp"
#include "vfplan/bundle/schema.hpp"
#include "vfplan/bundle/text.hpp"

namespace vfplan::bundle {

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
inline constexpr std::array<std::uint32_t, 4> seal_sizes{512, 1024, 2048, 4096};
inline constexpr std::size_t head_size = 148, digest_size = 32;
inline constexpr std::uint64_t latest = 253402300799;  // 9999-12-31T23:59:59Z

inline void require(bool good, std::string_view message) {
    require(good, "corrupt.seal", "", message);
}

/// The length of the seal that a file begins with.
inline std::size_t seal_size(View data) {
    require(!data.begins(hdf5_signature), "version.seal", "",
            "has no seal; this program reads versions 1.x, which have one, and a bundle of version "
            "0.1 is brought up to date by `vfplan migrate OLD.h5 -o NEW.h5`");
    require(data.begins(magic), "is no fixture bundle: it begins with " +
                                    in_quotes(data.text().substr(0, magic.size())) + ", not " +
                                    in_quotes(magic));
    const std::string ends =
        "ends after " + std::to_string(data.size()) + " bytes, within its seal";
    require(data.size() >= seal_sizes.front(), ends);
    const auto version = number_at(data, 8, 2);
    require(version == 1, "version.seal", "",
            "seal version " + std::to_string(version) +
                "; this program reads 1: a newer vfplan wrote it, `pip install --upgrade vfplan` "
                "gets it");
    const auto size = number_at(data, 12, 4);
    require(std::find(seal_sizes.begin(), seal_sizes.end(), size) != seal_sizes.end(),
            "seal of " + std::to_string(size) + " bytes; 512, 1024, 2048 or 4096 wanted");
    require(data.size() >= size, ends);
    return static_cast<std::size_t>(size);
}

inline void read_signed(Seal& seal, View block) {
    const auto count = [&](std::size_t at) {
        return static_cast<std::size_t>(number_at(block, at, 2));
    };
    std::copy_n(block.begin() + 56, 16, seal.key_id.begin());
    std::copy_n(block.begin() + 72, 64, seal.signature.begin());
    seal.registered = number_at(block, 136, 8);
    seal.case_token = block.part(head_size, count(144)).text();
    seal.robot_serial = block.part(head_size + count(144), count(146)).text();
    for (const std::string* part : {&seal.case_token, &seal.robot_serial}) {
        require(is_utf8(*part), "the seal's texts are not UTF-8");
        require(!has_control(*part), "the seal's texts hold control characters");
    }
    require(seal.registered <= latest, "registered " + std::to_string(seal.registered) +
                                           " s after 1970; at most " + std::to_string(latest) +
                                           " allowed");
    const View body = block.first(block.size() - digest_size);
    seal.signed_message.assign(signed_domain.begin(), signed_domain.end());
    seal.signed_message.insert(seal.signed_message.end(), body.begin(), body.begin() + 72);
    seal.signed_message.insert(seal.signed_message.end(), body.begin() + 136, body.end());
}

inline Seal read_seal(View block) {
    const View body = block.first(block.size() - digest_size);
    const Digest digest = sha256(body);
    require(std::equal(digest.begin(), digest.end(), block.begin() + body.size()),
            "the seal itself is damaged: its SHA-256 differs");
    const auto flags = number_at(block, 10, 2);
    const auto end =
        static_cast<std::size_t>(head_size + number_at(block, 144, 2) + number_at(block, 146, 2));
    require(end <= body.size(), "the seal's texts do not fit into it");
    require((flags & ~std::uint64_t{1}) == 0 && body.from(end).all_zero(),
            "the seal holds something unknown");
    const auto* least = std::find_if(seal_sizes.begin(), seal_sizes.end(),
                                     [&](std::uint32_t size) { return size >= end + digest_size; });
    require(*least == block.size(), "the seal is longer than its texts need");
    Seal seal;
    seal.is_signed = flags == 1;
    seal.payload_length = number_at(block, 16, 8);
    std::copy_n(block.begin() + 24, 32, seal.digest.begin());
    if (seal.is_signed) {
        read_signed(seal, block);
    } else {
        require(body.from(56).all_zero(),
                "the seal is unsigned and yet holds what only a signature covers");
    }
    return seal;
}

}  // namespace detail

/// Checks a bundle's bytes against their seal; `payload` is set to the part behind it.
inline Seal unseal(View data, View& payload) {
    const std::size_t size = detail::seal_size(data);
    Seal seal = detail::read_seal(data.first(size));
    detail::require(seal.payload_length <= limits::payload_bytes, "unsafe.cap", "",
                    "payload of " + std::to_string(seal.payload_length) + " bytes; at most " +
                        std::to_string(limits::payload_bytes) + " allowed");
    payload = data.from(size);
    detail::require(payload.size() == seal.payload_length,
                    std::to_string(seal.payload_length) + " bytes were sealed, " +
                        std::to_string(payload.size()) + " are there");
    detail::require(sha256(payload) == seal.digest,
                    "SHA-256 differs from the sealed one: the bytes are not those written");
    return seal;
}

/// The bytes of a file of at most the size a bundle may have.
inline Bytes read_file(const std::filesystem::path& path) {
    std::error_code error;
    const std::string name = path.string();
    detail::require(std::filesystem::is_regular_file(path, error), "input", name,
                    "there is no such file, or it is not regular");
    std::ifstream file(path, std::ios::binary);
    detail::require(bool(file), "input", name, "cannot be opened");
    const std::uintmax_t size = std::filesystem::file_size(path, error);
    detail::require(size <= limits::payload_bytes + detail::seal_sizes.back(), "unsafe.cap", name,
                    "longer than a bundle may be");
    Bytes data(static_cast<std::size_t>(size));
    file.read(reinterpret_cast<char*>(data.data()), static_cast<std::streamsize>(size));
    data.resize(static_cast<std::size_t>(file.gcount()));
    return data;
}

}  // namespace vfplan::bundle
