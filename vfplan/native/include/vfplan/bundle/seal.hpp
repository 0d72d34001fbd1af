// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The seal behind every bundle (docs/format.md, section 4): checked before anything else.
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

/// What the seal behind a bundle's payload, its HDF5 file, says.
struct Seal {
    std::uint64_t payload_length = 0;
    Digest digest{};  // SHA-256 of the payload
    bool is_signed = false;
    bool despite_findings = false;  // signed with open findings, or without a review
    std::array<unsigned char, 16> key_id{};
    std::array<unsigned char, 64> signature{};
    std::string case_token;       // empty: not given
    std::string robot_serial;     // empty: not given
    std::uint64_t signed_at = 0;  // seconds since 1970 UTC; 0: not given
    Bytes signed_message;         // what the signature covers
};

namespace detail {

inline constexpr std::string_view seal_magic = "VFPLSEAL";
inline constexpr std::string_view tail_magic = "VFPLTAIL";
inline constexpr std::string_view signed_domain{"vfplan bundle seal 2\0", 21};
inline constexpr std::string_view hdf5_signature = "\x89HDF\r\n\x1a\n";
inline constexpr std::array<std::uint32_t, 4> seal_sizes{512, 1024, 2048, 4096};
inline constexpr std::uint64_t seal_version = 2;
inline constexpr std::size_t superblock_size = 48;
inline constexpr std::size_t head_size = 148;          // of a seal, before its texts
inline constexpr std::size_t tail_size = 48;           // of a seal, behind them
inline constexpr std::uint64_t latest = 253402300799;  // 9999-12-31T23:59:59Z

inline void require(bool good, std::string_view message) {
    require(good, "corrupt.seal", "", message);
}

/// Says why a file that does not end in a seal is no bundle of this version.
[[noreturn]] inline void refuse_unsealed(View data) {
    if (data.begins(seal_magic)) {
        throw BundleError(
            "version.seal", "",
            "has its seal in front, as versions 1.0 and 1.1 had it; this program reads "
            "versions 2.x, and `vfplan migrate OLD.h5 -o NEW.h5` brings it up to date");
    }
    if (data.begins(hdf5_signature)) {
        throw BundleError(
            "corrupt.seal", "",
            "its seal is missing: the file was cut, or opened for writing by another "
            "program. Only version 0.1 had no seal; `vfplan migrate OLD.h5 -o NEW.h5` "
            "brings such a bundle up to date");
    }
    throw BundleError("corrupt.seal", "",
                      "is no fixture bundle: it begins with " +
                          in_quotes(data.text().substr(0, hdf5_signature.size())) +
                          ", not as an HDF5 file does");
}

/// The seal that a file ends in: it is there, and says of the file's length what is true.
inline View find_seal(View data) {
    if (!data.begins(hdf5_signature) || data.size() < superblock_size + seal_sizes.front() ||
        data.from(data.size() - tail_magic.size()).text() != tail_magic) {
        refuse_unsealed(data);
    }
    const auto size = static_cast<std::size_t>(number_at(data, data.size() - 16, 4));
    require(std::find(seal_sizes.begin(), seal_sizes.end(), size) != seal_sizes.end(),
            "seal of " + std::to_string(size) + " bytes; 512, 1024, 2048 or 4096 wanted");
    require(size + superblock_size <= data.size(), "its seal is as long as the whole file");
    const View seal = data.from(data.size() - size);
    require(seal.begins(seal_magic), "its seal does not begin " + std::to_string(size) +
                                         " bytes before the file's end, as it says");
    const auto version = number_at(seal, 8, 2);
    require(version == seal_version, "version.seal", "",
            "seal version " + std::to_string(version) +
                "; this program reads 2: a newer vfplan wrote it, `pip install --upgrade vfplan` "
                "gets it");
    const auto payload = number_at(seal, 16, 8);
    require(number_at(seal, 12, 4) == size && number_at(seal, size - 12, 4) == 0,
            "its seal says two lengths of itself");
    require(payload == data.size() - size, std::to_string(payload) + " bytes were sealed, " +
                                               std::to_string(data.size() - size) + " are there");
    require(payload % 8 == 0, "the sealed part is no multiple of 8 bytes long");
    require(payload <= limits::payload_bytes, "unsafe.cap", "",
            "payload of " + std::to_string(payload) + " bytes; at most " +
                std::to_string(limits::payload_bytes) + " allowed");
    return seal;
}

/// The texts lie within the seal, nothing follows them, and it is no longer than they need.
inline void check_texts(View seal) {
    const auto end =
        static_cast<std::size_t>(head_size + number_at(seal, 144, 2) + number_at(seal, 146, 2));
    const std::size_t room = seal.size() - tail_size;
    require(end <= room, "the seal's texts do not fit into it");
    const auto* least = std::find_if(seal_sizes.begin(), seal_sizes.end(),
                                     [&](std::uint32_t size) { return size >= end + tail_size; });
    require(*least == seal.size(), "the seal is longer than its texts need");
    const auto flags = number_at(seal, 10, 2);
    require((flags & ~std::uint64_t{3}) == 0 && seal.part(end, room - end).all_zero(),
            "the seal holds something unknown");
}

inline void read_signed(Seal& seal, View block) {
    const auto count = [&](std::size_t at) {
        return static_cast<std::size_t>(number_at(block, at, 2));
    };
    std::copy_n(block.begin() + 56, 16, seal.key_id.begin());
    std::copy_n(block.begin() + 72, 64, seal.signature.begin());
    seal.signed_at = number_at(block, 136, 8);
    seal.case_token = block.part(head_size, count(144)).text();
    seal.robot_serial = block.part(head_size + count(144), count(146)).text();
    for (const std::string* part : {&seal.case_token, &seal.robot_serial}) {
        require(is_utf8(*part), "the seal's texts are not UTF-8");
        require(!has_control(*part), "the seal's texts hold control characters");
    }
    require(seal.signed_at <= latest, "signed " + std::to_string(seal.signed_at) +
                                          " s after 1970; at most " + std::to_string(latest) +
                                          " allowed");
    // Everything but the signature itself, and the tail, which repeats what is known.
    const View body = block.first(block.size() - tail_size);
    seal.signed_message.assign(signed_domain.begin(), signed_domain.end());
    seal.signed_message.insert(seal.signed_message.end(), body.begin(), body.begin() + 72);
    seal.signed_message.insert(seal.signed_message.end(), body.begin() + 136, body.end());
}

inline Seal read_seal(View block) {
    check_texts(block);
    const View body = block.first(block.size() - tail_size);
    const Digest digest = sha256(body);
    require(std::equal(digest.begin(), digest.end(), block.begin() + body.size()),
            "the seal itself is damaged: its SHA-256 differs");
    Seal seal;
    const auto flags = number_at(block, 10, 2);
    seal.is_signed = (flags & 1) != 0;
    seal.despite_findings = (flags & 2) != 0;
    require(seal.is_signed || !seal.despite_findings,
            "the seal is unsigned and yet signed in spite of findings");
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

/// Checks a bundle's bytes against the seal that they end in; `payload` is set to what it seals.
inline Seal unseal(View data, View& payload) {
    const View block = detail::find_seal(data);
    Seal seal = detail::read_seal(block);
    payload = data.first(data.size() - block.size());
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
