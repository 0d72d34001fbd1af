// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The guide that a bundle asks for.
#pragma once

#include "vfplan/bundle/fixture.hpp"
#include "vfplan/guide.hpp"

namespace vfplan::bundle {

/// The guide of a fixture with guidance, which takes hold once the tip is in its tube. Throws
/// std::invalid_argument where there is none, or its tube runs into itself.
inline Guide make_guide(const Fixture& fixture) {
    if (!fixture.guidance) throw std::invalid_argument("vfplan: the fixture has no guidance");
    const Guidance& g = *fixture.guidance;
    GuideParameters p;
    p.radius = g.radius;
    p.stiffness = g.stiffness;
    p.ends = g.open ? Ends::open : Ends::stop;
    p.hold = Hold::on_entry;
    p.cut_bends = true;  // who planned it was told
    p.lead_force = g.lead_force;
    p.lead_speed = g.lead_speed;
    if (fixture.rendering && fixture.rendering->ignore_axis) {
        const auto& a = *fixture.rendering->ignore_axis;
        p.ignore_axis = Vec3{{a[0], a[1], a[2]}};
    }
    if (p.ignore_axis && !fixture.pieces.empty()) return {fixture.pieces_of(true), p};
    std::size_t first = 0;
    std::vector<std::size_t> counts;
    std::vector<bool> closed;
    for (std::size_t i = 0; i < fixture.strokes.size(); ++i) {
        const Stroke& s = fixture.strokes[i];
        if (g.stroke && static_cast<std::size_t>(*g.stroke) != i) continue;
        if (counts.empty()) first = s.first;
        counts.push_back(s.count);
        closed.push_back(s.closed);
    }
    return {fixture.points.data() + 3 * first, counts, closed, p};
}

}  // namespace vfplan::bundle
