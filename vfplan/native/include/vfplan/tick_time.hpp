// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// How much a tick may have to look at: a bound that a cloud, or a curve, and its rendering give
// before the first tick.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "vfplan/base/vec.hpp"
#include "vfplan/cloud/density.hpp"
#include "vfplan/cloud/grid.hpp"
#include "vfplan/cloud/points.hpp"
#include "vfplan/curve/exact.hpp"
#include "vfplan/mesh/exact.hpp"
#include "vfplan/parameters.hpp"
#include "vfplan/rules/constants.hpp"
#include "vfplan/rules/contacts.hpp"

namespace vfplan {

/// Time [s] that a tick of the robust rule takes at most, by what it has to look at: in each
/// iteration the points in its list, and those that touch, one by one. The three times are those
/// of the machine of docs/engine.md; tests/engine/test_worst_tick.py holds random fixtures to it.
template <class S>
double tick_time_bound(const S& space, const double* xyz, std::size_t n, const Parameters& p) {
    constexpr double an_iteration = 2.5e-6, a_point = 1e-9, a_contact = 8e-9;  // [s]
    constexpr double beside = 16;  // iterations: what a tick does beside them
    constexpr int D = S::dimension;
    const auto cloud = thinned(make_cloud(space, xyz, n), p).cloud;
    const ContactSurfaces<D> surfaces(kernels<D>(Width::automatic), p.R(), p.band);
    const double list = std::max((1 + tuned::list_margin) * p.R(), surfaces.reach());
    const double near = most_within(cloud, list + 0.75 * tuned::list_margin * p.R());
    // From R - band to the shell, on one surface: as far around the foot.
    const double inner = p.R() - p.band, outer = surfaces.touch_radius();
    const double touching = most_within(cloud, std::sqrt(outer * outer - inner * inner));
    return (p.max_iterations + beside) * (an_iteration + a_point * near + a_contact * touching);
}

inline double tick_time_bound(const double* xyz, std::size_t n, const Parameters& p) {
    check(p);
    if (p.ignore_axis) return tick_time_bound(Slice(*p.ignore_axis), xyz, n, p);
    return tick_time_bound(Space{}, xyz, n, p);
}

/// Time [s] that a tick of rule exact takes at most, by the features in its list; as above.
inline double tick_time_bound(const std::vector<Stroke>& strokes, const Parameters& p) {
    constexpr double an_iteration = 7.5e-6, a_feature = 10e-9;  // [s]
    check(strokes);
    if (!p.ignore_axis) reject("rule exact needs an ignore_axis: it is planar");
    const curve::Curve curve(strokes, Slice(*p.ignore_axis), p.R());
    std::vector<Box<2>> boxes;
    for (std::size_t i = 0; i < curve.size(); ++i) boxes.push_back(curve[static_cast<int>(i)].box);
    const double near = most_within(boxes, curve::CurveRule::list_reach * p.R());
    return curve::CurveRule::max_iterations * (an_iteration + a_feature * near);
}

/// Likewise for a mesh: the inner steps that its rule grants, and the triangles that lie together,
/// which a part of a tick looks through to the end.
inline double tick_time_bound(const mesh::Surface& s, const Parameters& p) {
    constexpr double a_step = 16e-9;  // [s]
    constexpr double a_triangle = 4;  // steps
    mesh::check(s);
    std::vector<Box<3>> boxes;
    boxes.reserve(s.k);
    for (std::size_t i = 0; i < s.k; ++i) {
        const mesh::Face face = mesh::face_of(s, i);
        const Vec3 first = mesh::corner_of(s, face[0]);
        boxes.push_back({first, first});
        boxes.back().include(mesh::corner_of(s, face[1]));
        boxes.back().include(mesh::corner_of(s, face[2]));
    }
    const double near = most_within(boxes, mesh::MeshRule::list_reach * p.R());
    return a_step * (3 * mesh::MeshRule::max_steps + a_triangle * near);
}

/// The most tick_time_bound [s] that a loop of 1 kHz is given.
inline constexpr double max_tick_time = 0.3e-3;

/// Whether a mesh is rendered best by its triangles: nearer to the truth than by its points
/// (docs/make_mesh.py), if a tick is short enough.
inline bool by_triangles(const mesh::Surface& s, const Parameters& p) {
    return tick_time_bound(s, p) <= max_tick_time;
}

}  // namespace vfplan
