// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   const auto fixture = vfplan::bundle::read_fixture("fixture.h5");
//
// Reads a fixture bundle into plain arrays, with the standard library alone. Load, copy, swap:
// nothing of this belongs into a control loop. Calls from several threads do not meet.
#pragma once

#include <functional>

#include "vfplan/bundle/content.hpp"
#include "vfplan/bundle/seal.hpp"
#if !defined(VFPLAN_COMPILED) || defined(VFPLAN_COMPILING)
#include "vfplan/bundle/checks.hpp"
#endif

namespace vfplan::bundle {

/// The whole content of a bundle, by path, and its seal.
struct Bundle {
    Content content;
    Seal seal;
};

/// Everything in a payload, checked; `file_length` is that of the bundle with its seal. Of a bundle
/// whose seal holds, also that the seal says what the content does.
///
/// Findings that are strict throw BundleError at the first error. Others collect what there is, and
/// the content is what could be read. What is defined below, with VFPLAN_COMPILED only
/// vfplan/engine.cpp compiles.
VFPLAN_ONCE Content read_payload(View payload, std::uint64_t file_length, Findings& findings,
                                 const Seal* seal = nullptr);

/// Checks seal, structure and every rule; `check_seal` looks at the seal before the rest is read.
/// Throws BundleError.
using CheckSeal = std::function<void(const Seal&)>;
VFPLAN_ONCE Bundle read_bundle(View data, const CheckSeal& check_seal = {});

/// Every finding of a bundle's bytes; it is sound when none is an error.
VFPLAN_ONCE std::vector<Finding> examine(View data);

/// The fixture of a checked bundle; moves the points out of it.
VFPLAN_ONCE Fixture to_fixture(Bundle bundle);

/// What `read` gives of a file's bytes; errors name the file.
template <class Read>
auto of_file(const std::filesystem::path& path, const Read& read) {
    try {
        const Bytes data = read_file(path);
        return read(View(data));
    } catch (const BundleError& error) {
        std::string where = path.string();
        if (!error.where.empty() && error.where != where) where += ":" + error.where;
        throw BundleError({error.code, where, error.message});
    }
}

#if !defined(VFPLAN_COMPILED) || defined(VFPLAN_COMPILING)
namespace detail {

/// A signature says of itself whether it was given in spite of what was found, and is for the case
/// that the bundle is for.
inline void check_what_is_signed(const Seal& seal, const Content& content, Findings& findings) {
    const std::size_t open = count_unanswered(content);
    const Value* own_case = content.find("/@case");
    if (own_case != nullptr && own_case->string() != seal.case_token) {
        findings.error("unsafe.case", "/@case",
                       {"is ", Quoted{own_case->string()}, ", and the bundle is signed for ",
                        Quoted{seal.case_token}},
                       "Sign it again for its own case: vfplan sign");
    }
    const bool is_reviewed = content.has_group("/review"), despite = open > 0 || !is_reviewed;
    findings.require(despite == seal.despite_findings, "unsafe.findings", "/findings",
                     {"are unanswered ", open, " times, with ", is_reviewed ? "a" : "no",
                      " review beside them, and the seal says otherwise"},
                     "Sign it again: `vfplan sign`, with --despite-findings where they stay open");
}

inline Guidance guidance_of(const Content& content) {
    Guidance g;
    g.radius = content.number("/guidance@radius_m");
    g.stiffness = content.number("/guidance@stiffness_n_per_m");
    if (content.at("/guidance@ends").string() == "open") g.ends = Ends::open;
    g.lead_force = content.number("/guidance@lead_force_n", g.lead_force);
    g.lead_speed = content.number("/guidance@lead_speed_m_s", g.lead_speed);
    g.stroke = content.integer("/guidance@stroke");
    return g;
}

inline Rendering rendering_of(const Content& content) {
    Rendering r;
    r.stiffness = point_at(content.at("/rendering/stiffness").f8.data(), 0);
    r.contact_radius = content.number("/rendering@contact_radius_m");
    r.band = content.number("/rendering@band_m");
    r.point_radius = content.number("/rendering@point_radius_m");
    r.max_iterations = content.integer("/rendering@max_iterations").value_or(r.max_iterations);
    if (const Value* axis = content.find("/rendering/ignore_axis"))
        r.ignore_axis = point_at(axis->f8.data(), 0);
    return r;
}

}  // namespace detail

VFPLAN_ONCE Content read_payload(View payload, std::uint64_t file_length, Findings& findings,
                                 const Seal* seal) {
    Content content;
    findings.collect([&] {
        content = detail::Reader(payload, file_length, findings).read();
        check(content, findings);
        if (seal != nullptr && seal->is_signed && findings.sound())
            detail::check_what_is_signed(*seal, content, findings);
    });
    return content;
}

VFPLAN_ONCE Bundle read_bundle(View data, const CheckSeal& check_seal) {
    View payload;
    Bundle bundle{{}, unseal(data, payload)};
    if (check_seal) check_seal(bundle.seal);
    Findings findings(true);
    bundle.content = read_payload(payload, data.size(), findings, &bundle.seal);
    return bundle;
}

VFPLAN_ONCE std::vector<Finding> examine(View data) {
    Findings findings(false);
    findings.collect([&] {
        View payload;
        const Seal seal = unseal(data, payload);
        read_payload(payload, data.size(), findings, &seal);
    });
    return findings.all();
}

VFPLAN_ONCE Fixture to_fixture(Bundle bundle) {
    Content& content = bundle.content;
    Fixture fixture;
    fixture.frame = content.at("/@frame").string();
    fixture.id = content.at("/@id").string();
    fixture.created_utc = content.at("/provenance@created_utc").string();
    if (const Value* own_case = content.find("/@case")) fixture.case_id = own_case->string();
    if (const Value* tool = content.find("/registration@tool")) fixture.tool = tool->string();
    fixture.points = content.take("/points").f8;
    if (content.has("/sigma")) fixture.sigma = content.take("/sigma").f8;
    if (content.has("/rendering/stiffness")) {
        fixture.rendering = detail::rendering_of(content);
        fixture.certified = content.at("/leak@certified").u1.front() != 0;
    }
    if (content.has("/curve/stroke")) fixture.strokes = detail::strokes_of(content);
    if (content.has("/guidance@radius_m")) fixture.guidance = detail::guidance_of(content);
    if (const Value* radius = content.find("/mesh@sample_radius_m"))
        fixture.sample_radius = radius->number();
    if (content.has("/mesh/triangles")) fixture.mesh = content.take("/mesh/triangles").i4;
    if (content.has("/pieces/vertices")) fixture.pieces = detail::pieces_of(content);
    fixture.findings_unanswered = count_unanswered(content);
    fixture.reviewed = content.has_group("/review");
    fixture.seal = std::move(bundle.seal);
    return fixture;
}

VFPLAN_ONCE Fixture read_fixture(const std::filesystem::path& path) {
    return of_file(path, [](View data) { return to_fixture(read_bundle(data)); });
}
#endif

}  // namespace vfplan::bundle
