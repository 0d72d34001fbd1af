// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   const auto fixture = vfplan::hdf5::read_fixture("fixture.h5");
//
// Reads a fixture bundle into plain arrays. Load, copy, swap: nothing of this belongs into a
// control loop. libhdf5 is not thread-safe as most systems build it: read from one thread.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "vfplan/hdf5/content.hpp"
#include "vfplan/hdf5/error.hpp"
#include "vfplan/hdf5/parse.hpp"
#include "vfplan/hdf5/rules.hpp"
#include "vfplan/hdf5/seal.hpp"
#include "vfplan/hdf5/trust.hpp"

namespace vfplan::hdf5 {

/// How the robot shall render the fixture; SI units.
struct Rendering {
    std::array<double, 3> stiffness{};                      // N/m
    double contact_radius = 0, band = 0, point_radius = 0;  // m
    std::optional<std::array<double, 3>> ignore_axis;       // unit vector
    std::optional<int> max_iterations;                      // of a tick; else the engine's own
};

/// What a controller needs of a bundle, as plain arrays.
struct Fixture {
    std::string frame;
    std::string id;
    std::vector<double> points;  // x0 y0 z0 x1 y1 z1 ... [m], pixels in the frame image
    std::vector<double> sigma;   // one a point, or empty
    std::optional<Rendering> rendering;
    bool certified = false;  // no proxy of this radius passes between samples
    std::string created_utc;
    Seal seal;

    [[nodiscard]] std::size_t size() const { return points.size() / 3; }
};

/// The whole content of a bundle, by path, and its seal.
struct Bundle {
    Content content;
    Seal seal;
};

/// Checks seal, signature if trust demands one, HDF5 structure and every rule.
///
/// The bytes must stay as they are during the call. Throws BundleError.
inline Bundle read_bundle(std::span<unsigned char> data, const Trust* trust = nullptr) {
    std::span<unsigned char> payload;
    Bundle bundle{{}, unseal(data, payload)};
    if (trust != nullptr) require_signature(bundle.seal, *trust);
    bundle.content = parse(payload);
    check(bundle.content);
    return bundle;
}

/// The fixture of a checked bundle; moves the points out of it.
inline Fixture to_fixture(Bundle bundle) {
    Content& content = bundle.content;
    Fixture fixture;
    fixture.frame = content.at("/@frame").string();
    fixture.id = content.at("/@id").string();
    fixture.created_utc = content.at("/provenance@created_utc").string();
    fixture.points = content.take("/points").f8;
    if (content.has("/sigma")) fixture.sigma = content.take("/sigma").f8;
    if (content.has("/rendering/stiffness")) {
        Rendering rendering;
        std::copy_n(content.at("/rendering/stiffness").f8.begin(), 3, rendering.stiffness.begin());
        rendering.contact_radius = content.at("/rendering@contact_radius_m").number();
        rendering.band = content.at("/rendering@band_m").number();
        rendering.point_radius = content.at("/rendering@point_radius_m").number();
        if (const Value* axis = content.find("/rendering/ignore_axis")) {
            rendering.ignore_axis = {axis->f8[0], axis->f8[1], axis->f8[2]};
        }
        if (const Value* most = content.find("/rendering@max_iterations")) {
            rendering.max_iterations = most->i4.front();
        }
        fixture.rendering = rendering;
        fixture.certified = content.at("/leak@certified").u1.front() != 0;
    }
    fixture.seal = std::move(bundle.seal);
    return fixture;
}

/// Reads a bundle; either the whole of it is sound or BundleError is thrown.
///
/// With `trust`, the bundle must be signed by one of its keys for its case and robot.
inline Fixture read_fixture(const std::filesystem::path& path, const Trust* trust = nullptr) {
    Bytes data = read_file(path);
    return to_fixture(read_bundle(data, trust));
}

}  // namespace vfplan::hdf5
