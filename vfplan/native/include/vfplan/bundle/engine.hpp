// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// From a bundle to an engine, in one call:
//
//     vfplan::Engine engine(vfplan::bundle::read_fixture("fixture.h5"));
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "vfplan/bundle/fixture.hpp"
#include "vfplan/engine.hpp"
#include "vfplan/tick_time.hpp"

namespace vfplan {

namespace bundle {

/// The fixture's mesh; it stays the fixture's.
inline mesh::Surface surface(const Fixture& fixture) { return fixture.surface(); }

inline Parameters parameters(const Fixture& fixture, std::optional<Rule> asked = std::nullopt);

/// The rule nearest to the truth: exact where lines and arcs across an axis are known of what is
/// forbidden, and for a mesh in space that `by_triangles` says so of.
inline Rule best_rule(const Fixture& fixture) {
    if (!fixture.pieces_of(false).empty()) return Rule::exact;
    const bool mesh = !fixture.mesh.empty() && !fixture.guidance && fixture.rendering &&
                      !fixture.rendering->ignore_axis;
    return mesh && by_triangles(surface(fixture), parameters(fixture, Rule::exact)) ? Rule::exact
                                                                                    : Rule::robust;
}

/// Table I as the bundle holds it, for its best rule or another one; the paper's keeps its own
/// band. Throws std::invalid_argument for a fixture without rendering.
inline Parameters parameters(const Fixture& fixture, std::optional<Rule> asked) {
    const Rule rule = asked ? *asked : best_rule(fixture);
    if (!fixture.rendering)
        reject("frame " + fixture.frame +
               " without rendering parameters: `vfplan register` makes a fixture of a curve");
    const Rendering& r = *fixture.rendering;
    Parameters p;
    p.contact_radius = r.contact_radius;
    p.band = rule == Rule::paper ? p.band : r.band;
    p.point_radius = r.point_radius;
    p.outer_radius = 2 * r.contact_radius;
    for (int k = 0; k < 3; ++k) p.stiffness[k] = r.stiffness[static_cast<std::size_t>(k)];
    if (r.ignore_axis)
        p.ignore_axis = Vec3{{(*r.ignore_axis)[0], (*r.ignore_axis)[1], (*r.ignore_axis)[2]}};
    if (r.max_iterations) p.max_iterations = *r.max_iterations;
    p.rule = rule;
    return p;
}

/// Throws std::invalid_argument where a tick of `work` [s] is longer than a loop of 1 kHz can wait.
inline void check_tick_time(double work) {
    if (work > max_tick_time)
        reject("a tick may take " + six_digits(1e6 * work) + " us, at most " +
               six_digits(1e6 * max_tick_time) +
               " us are given: too many points or pieces around one place, or "
               "max_iterations too "
               "high; Use::replay takes it");
}

/// Throws std::invalid_argument where a tick may take longer than a loop of 1 kHz can wait.
inline void check_work(const Fixture& fixture, const Parameters& p) {
    if (p.rule != Rule::exact) {
        // Of a fixture that guides all points, so that there is one where every stroke guides.
        const std::vector<double> points = fixture.guidance ? fixture.points : fixture.forbidden();
        check_tick_time(tick_time_bound(points.data(), points.size() / 3, p));
    } else if (!fixture.mesh.empty()) {
        check_tick_time(tick_time_bound(surface(fixture), p));
    } else {
        check_tick_time(tick_time_bound(fixture.pieces_of(false), p));
    }
}

/// By its lines and arcs, its triangles, or its points, of a mesh samples. One that guides is no
/// forbidden region, or not all of it: std::invalid_argument.
inline Engine make_engine(const Fixture& fixture, const Parameters& p, Use use) {
    if (fixture.guidance)
        reject(
            "the fixture guides: vfplan/bundle/guide.hpp makes the guide, and of forbidden() "
            "an engine is made");
    if (p.rule != Rule::exact) {
        const std::vector<double> points = fixture.forbidden();
        if (use == Use::real_time) {
            check_tick_time(tick_time_bound(points.data(), points.size() / 3, p));
        }
        return {points.data(), points.size() / 3, p};
    }
    if (use == Use::real_time) check_work(fixture, p);
    if (!fixture.mesh.empty()) return {surface(fixture), p};
    return {fixture.pieces, p};
}

}  // namespace bundle

inline Engine::Engine(const bundle::Fixture& fixture, std::optional<Rule> rule, Use use)
    : Engine(bundle::make_engine(fixture, bundle::parameters(fixture, rule), use)) {}

}  // namespace vfplan
