// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Where an HDF5 file begins: a plain superblock, as `h5py` writes it for a bundle.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>

#include "vfplan/bundle/header.hpp"

namespace vfplan::bundle::detail {

/// The address of the root, from a payload's first 48 bytes: a plain superblock of HDF5 1.10.
inline std::uint64_t root_address(File& file, View data) {
    const auto must = [](bool good, const std::string& why) {
        require(good, "corrupt.hdf5", "", why);
    };
    must(data.begins("\x89HDF\r\n\x1a\n"), "no HDF5 file: the signature is missing");
    must(data.size() >= 48, "is too short for an HDF5 file");
    must((data[8] == 2 || data[8] == 3) && data[9] == 8 && data[10] == 8 && data[11] == 0,
         "superblock of another version or other sizes");
    file.claim_checked(0, 48, "");
    must(number_at(data, 20, 8) == nowhere, "the superblock has an extension");
    // Relative to the payload, or to the bundle with its seal in front: libhdf5 takes either.
    constexpr std::array<std::uint64_t, 5> bases{0, 512, 1024, 2048, 4096};
    const auto base = number_at(data, 12, 8), end = number_at(data, 28, 8) - base;
    must(std::find(bases.begin(), bases.end(), base) != bases.end(),
         "the superblock has another base address");
    must(end == data.size(), "the superblock claims " + std::to_string(end) + " bytes, " +
                                 std::to_string(data.size()) + " are there");
    return number_at(data, 36, 8);
}

}  // namespace vfplan::bundle::detail
