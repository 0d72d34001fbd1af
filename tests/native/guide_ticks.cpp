// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   guide_ticks TICKS
//
// TICKS ticks of a hand along guides of many shapes: slides beside the curve, trembles, strokes
// that cross to other strands, rests. A line a shape: how far at most the proxy was beyond the
// tube [m], of the drawn points' own lines too; by how much the force changed more than K |dx| [N];
// the force's part along the curve where the place is at rest on it [N]; how much nearer to the HIP
// the proxy would have been had it stayed [m]; work beyond what sampling allows [J]; how many ticks
// had a force, and allocations.
#include <cstdio>
#include <cstdlib>

#include "allocations.hpp"
#include "guide_shapes.hpp"
#include "vfplan/guide.hpp"

namespace {

using guide_shapes::Hand, guide_shapes::meander, guide_shapes::Shape, guide_shapes::shapes;
using vfplan::Vec3;

double beside_lines(const std::vector<Vec3>& p, bool closed, const Vec3& x) {
    double best = 1e300;
    for (std::size_t i = 0; i + (closed ? 0 : 1) < p.size(); ++i) {
        const Vec3 a = p[i], way = p[(i + 1) % p.size()] - a;
        const double t = std::clamp(dot(x - a, way) / dot(way, way), 0.0, 1.0);
        best = std::min(best, norm(x - a - t * way));
    }
    return best;
}

void play(const Shape& shape, vfplan::Ends ends, long ticks) {
    std::vector<Vec3> points;
    std::vector<double> xyz;
    for (int i = 0; i < shape.points; ++i) {
        points.push_back(shape.curve(double(i) / (shape.closed ? shape.points : shape.points - 1)));
        for (int k = 0; k < 3; ++k) xyz.push_back(points.back()[k]);
    }
    vfplan::GuideParameters p;
    p.radius = shape.radius;
    p.ends = ends;
    p.cut_bends = true;
    if (shape.planar) p.ignore_axis = Vec3{{0, 0, 1}};
    vfplan::Guide guide = shape.arcs ? vfplan::Guide({meander}, p)
                                     : vfplan::Guide(xyz.data(), points.size(), shape.closed, p);
    const auto across = [&](Vec3 x) {
        if (shape.planar) x[2] = 0;
        return x;
    };
    Hand hand(shape, 7);
    Vec3 hip = hand(0);
    guide.reset(hip);
    vfplan::GuideStep was = guide.step(hip);
    double beyond = -1, lines = -1, jump = -1, drag = 0, recede = 0, work = 0, allowed = 0;
    const auto stored = [&](const vfplan::GuideStep& s) {
        return 0.5 * dot(s.force, s.force) / p.stiffness;
    };
    double excess = -1;
    const double begun = stored(was);
    long forced = 0;
    const long before = allocations;
    for (long t = 1; t < ticks; ++t) {
        const Vec3 next = hand(t);
        const Vec3 dx = across(next - hip);
        const vfplan::GuideStep s = guide.step(next);
        hip = next;
        jump = std::max(jump, norm(s.force - was.force) - p.stiffness * norm(dx));
        recede = std::max(recede, norm(across(s.proxy - hip)) - norm(across(was.proxy - hip)));
        work += dot(was.force, dx);
        allowed += 0.5 * p.stiffness * dot(dx, dx);
        excess = std::max(excess, work - (begun - stored(s)) - allowed);
        if (s.held) {
            const Vec3 proxy = across(s.proxy);
            beyond = std::max(beyond, guide.path().nearest(proxy).distance - p.radius);
            if (t % 16 == 0)
                lines = std::max(lines, beside_lines(points, shape.closed, proxy) - p.radius);
        }
        if (s.held && s.status == vfplan::Status::ok && norm(s.force) > 0) {
            ++forced;
            const auto& path = guide.path();
            const double length = path.strands()[0].length, h = 1e-7;
            const Vec3 c = path.at(0, s.arc), a = path.at(0, std::max(0.0, s.arc - h)),
                       b = path.at(0, std::min(length, s.arc + h));
            // At a corner or an end the force is between the normals of both sides.
            if (s.arc > h && s.arc < length - h && norm((b - c) - (c - a)) < 1e-4 * h)
                drag = std::max(drag, std::abs(dot(s.force, (1 / norm(b - a)) * (b - a))));
        }
        was = s;
    }
    std::printf(
        "%s, %s: beyond %.2g, lines %.2g, jump %.6g, drag %.2g, recede %.2g, excess %.2g, "
        "forced %ld, allocations %ld\n",
        shape.name, ends == vfplan::Ends::stop ? "stop" : "open", beyond, lines, jump, drag, recede,
        excess, forced, allocations - before);
}

}  // namespace

int main(int argc, char** argv) {
    const long ticks = argc > 1 ? std::atol(argv[1]) : 100'000;
    const long each = ticks / long(2 * std::size(shapes));
    for (const Shape& shape : shapes)
        for (const auto ends : {vfplan::Ends::stop, vfplan::Ends::open}) play(shape, ends, each);
}
