// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What a program gets of a bundle, as plain data: the fixture and its seal.
#pragma once

#include <filesystem>

#include "vfplan/bundle/bytes.hpp"
#include "vfplan/curve/pieces.hpp"
#include "vfplan/mesh/surface.hpp"
#include "vfplan/parameters.hpp"

namespace vfplan::bundle {

using Digest = std::array<unsigned char, 32>;

/// What the seal behind a bundle's payload, its HDF5 file, says.
struct Seal {
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

/// A stroke of the drawn curve: `count` points from the `first` on.
struct StrokeRange {
    std::size_t first = 0, count = 0;
    bool closed = false;
};

/// How the robot shall render the fixture: the bundle has stiffness, radii, band, ignored axis and
/// iterations. vfplan/bundle/engine.hpp completes it for a rule.
using Rendering = Parameters;

/// The strokes that guide, and how. vfplan/bundle/engine.hpp makes a vfplan::Guide of it.
struct Guidance : GuideParameters {
    std::optional<int> stroke;  // the only one that guides, the others are forbidden; else all do

    Guidance() {
        hold = Hold::on_entry;
        cut_bends = true;  // who planned it was told
    }
    bool operator==(const Guidance&) const = default;
};

/// What a controller needs of a bundle, as plain arrays.
struct Fixture {
    std::string frame;
    std::string id;
    std::vector<double> points;        // x0 y0 z0 x1 y1 z1 ... [m], pixels in the frame image
    std::vector<double> sigma;         // one a point, or empty
    std::vector<StrokeRange> strokes;  // empty: a cloud, or a surface
    std::optional<Rendering> rendering;
    std::optional<Guidance> guidance;
    bool certified = false;  // no proxy of this radius passes between samples
    std::string created_utc;
    std::string case_id;  // the case that it is for; empty where nobody said so
    std::string tool;     // that touched the markers; empty where nobody said so
    // Lines and arcs, a stroke each; none where unknown. Rule exact renders these: who changes the
    // points changes them too, because after reading nothing checks that they agree.
    std::vector<Stroke> pieces;
    std::vector<std::int32_t> mesh;  // numbers of three points a triangle, or empty
    // How far a place of the mesh may be from a sample where points are rendered [m]; without it
    // the points are the samples.
    std::optional<double> sample_radius;
    std::size_t findings_unanswered = 0;  // doubts of the planning that nobody has answered
    bool reviewed = false;                // a person looked at the plan and approved it
    Seal seal;

    [[nodiscard]] std::size_t size() const { return points.size() / 3; }

    /// The mesh as arrays that stay the fixture's.
    [[nodiscard]] vfplan::mesh::Surface surface() const {
        return {points.data(), size(), mesh.data(), mesh.size() / 3};
    }
    /// The points that a forbidden region is made of, and that edits number: none where every
    /// stroke guides. A mesh that says how densely it is to be sampled gives its corners and,
    /// behind them, samples of its triangles; std::invalid_argument if they are more than
    /// mesh::max_samples.
    [[nodiscard]] std::vector<double> forbidden() const {
        if (sample_radius) return vfplan::mesh::sampled(surface(), *sample_radius).points;
        if (!guidance) return points;
        if (!guidance->stroke) return {};
        const StrokeRange& guides = strokes[static_cast<std::size_t>(*guidance->stroke)];
        std::vector<double> left = points;
        const auto from = left.begin() + std::ptrdiff_t(3 * guides.first);
        left.erase(from, from + std::ptrdiff_t(3 * guides.count));
        return left;
    }
    /// The lines and arcs of the strokes that guide, or of those that forbid.
    [[nodiscard]] std::vector<Stroke> pieces_of(bool guide) const {
        std::vector<Stroke> some;
        for (std::size_t i = 0; i < pieces.size(); ++i) {
            const bool guides =
                guidance && (!guidance->stroke || std::size_t(*guidance->stroke) == i);
            if (guides == guide) some.push_back(pieces[i]);
        }
        return some;
    }
};

/// Reads a bundle; either the whole of it is sound or BundleError is thrown.
///
/// What is known of it is that it is whole, undamaged and within the format's rules; not who made
/// it, for which patient, or when. vfplan/bundle/trust.hpp has the same for who demands a
/// signature.
VFPLAN_ONCE Fixture read_fixture(const std::filesystem::path& path);

}  // namespace vfplan::bundle
