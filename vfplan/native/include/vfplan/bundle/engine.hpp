// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// From a bundle to what renders it, in one call: to an engine, or to a guide.
//
//     vfplan::Engine engine(vfplan::bundle::read_fixture("fixture.h5"));
//     vfplan::Guide guide = vfplan::bundle::make_guide(vfplan::bundle::read_fixture("guided.h5"));
#pragma once

#include "vfplan/bundle/types.hpp"
#include "vfplan/engine.hpp"
#include "vfplan/guide.hpp"
#include "vfplan/tick_time.hpp"
#if !defined(VFPLAN_COMPILED) || defined(VFPLAN_COMPILING)
#include "vfplan/bundle/fixture.hpp"
#endif

namespace vfplan::inline v1 {

namespace bundle {

/// The rule nearest to the truth: exact where lines and arcs across an axis are known of what is
/// forbidden, and for a mesh in space with so few triangles that a tick is short enough
/// (docs/make_mesh.py).
inline Rule best_rule(const Fixture& fixture) {
    if (!fixture.pieces_of(false).empty()) return Rule::exact;
    const bool is_mesh = !fixture.mesh.empty() && !fixture.guidance && fixture.rendering &&
                         !fixture.rendering->ignore_axis;
    if (!is_mesh) return Rule::robust;
    const double time = tick_time_bound(fixture.surface(), *fixture.rendering);
    return time <= max_tick_time ? Rule::exact : Rule::robust;
}

/// Table I as the bundle holds it, for its best rule or another one; the paper's keeps its own
/// band. Throws std::invalid_argument for a fixture without rendering.
inline Parameters parameters(const Fixture& fixture, std::optional<Rule> asked = std::nullopt) {
    const Rule rule = asked ? *asked : best_rule(fixture);
    if (!fixture.rendering)
        reject("the fixture is in frame " + fixture.frame +
               " and without rendering parameters. Make a fixture of a curve: vfplan register");
    Parameters p = *fixture.rendering;
    if (rule == Rule::paper) p.band = Parameters{}.band;
    p.outer_radius = 2 * p.contact_radius;
    p.rule = rule;
    return p;
}

/// Throws std::invalid_argument where a tick may take longer than a loop of 1 kHz can wait.
inline void check_work(const Fixture& fixture, const Parameters& p) {
    double time;
    if (p.rule != Rule::exact) {
        // Of a fixture that guides all points, so that there is one where every stroke guides.
        const std::vector<double> points = fixture.guidance ? fixture.points : fixture.forbidden();
        time = tick_time_bound(points.data(), points.size() / 3, p);
    } else if (!fixture.mesh.empty()) {
        time = tick_time_bound(fixture.surface(), p);
    } else {
        time = tick_time_bound(fixture.pieces_of(false), p);
    }
    if (time <= max_tick_time) return;
    reject("a tick may take " + six_digits(1e6 * time) + " us, at most " +
           six_digits(1e6 * max_tick_time) +
           " us are given at 1 kHz: too many points or pieces around one place. Give fewer points "
           "there, or Use::replay.");
}

/// The forbidden region: by its lines and arcs, its triangles, or its points, of a mesh samples.
inline Engine region_of(const Fixture& fixture, const Parameters& p) {
    if (p.rule == Rule::exact && !fixture.mesh.empty()) return {fixture.surface(), p};
    if (p.rule == Rule::exact) return {fixture.pieces_of(false), p};
    const std::vector<double> points = fixture.forbidden();
    Engine engine(points.data(), points.size() / 3, p);
    if (!fixture.mesh.empty()) engine.set_skin(fixture.surface());
    return engine;
}

/// The same of a fixture that is nothing else. One that guides is not: std::invalid_argument.
inline Engine make_engine(const Fixture& fixture, const Parameters& p, Use use) {
    if (fixture.guidance)
        reject(
            "the fixture guides. Make its guide with make_guide, and an engine of what forbidden() "
            "gives.");
    if (use == Use::real_time) check_work(fixture, p);
    return region_of(fixture, p);
}

/// The guide of a fixture with guidance, which takes hold once the tip is in its tube. Throws
/// std::invalid_argument where there is none, or its tube runs into itself.
inline Guide make_guide(const Fixture& fixture, double period = 1e-3) {
    if (!fixture.guidance)
        reject(
            "the fixture has no guidance. Plan one with a guide, or make an Engine of this one.");
    Guidance p = *fixture.guidance;
    p.period = period;
    if (fixture.rendering) p.ignore_axis = fixture.rendering->ignore_axis;
    if (p.ignore_axis && !fixture.pieces.empty()) return {fixture.pieces_of(true), p};
    std::size_t first = 0;
    std::vector<std::size_t> counts;
    std::vector<bool> closed;
    for (std::size_t i = 0; i < fixture.strokes.size(); ++i) {
        const StrokeRange& s = fixture.strokes[i];
        if (p.stroke && static_cast<std::size_t>(*p.stroke) != i) continue;
        if (counts.empty()) first = s.first;
        counts.push_back(s.count);
        closed.push_back(s.closed);
    }
    return {fixture.points.data() + 3 * first, counts, closed, p};
}

}  // namespace bundle

#if !defined(VFPLAN_COMPILED) || defined(VFPLAN_COMPILING)
VFPLAN_ONCE Engine::Engine(const bundle::Fixture& fixture, std::optional<Rule> rule, Use use)
    : Engine(bundle::make_engine(fixture, bundle::parameters(fixture, rule), use)) {}
#endif

}  // namespace vfplan::inline v1
