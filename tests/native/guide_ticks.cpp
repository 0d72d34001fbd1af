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
#include <functional>
#include <numbers>
#include <random>

#include "allocations.hpp"
#include "vfplan/guide.hpp"

namespace {

using vfplan::Vec3;
constexpr double pi = std::numbers::pi;

struct Shape {
    const char* name;
    double radius;
    bool closed, planar;
    int points;
    std::function<Vec3(double)> curve;  // over [0, 1]
    bool arcs = false;                  // the guide goes along `meander`, not through points
};

/// Three lines joined by half circles of 6 mm, to the left and to the right.
const vfplan::Stroke meander{
    {0, 0, 0, 0.02, 0, 0, 0.02, 0.012, 0, 0, 0.012, 0, 0, 0.024, 0, 0.02, 0.024, 0},
    {0, 1, 0, -1, 0, 0},
    false};
Vec3 along_meander(double t) {
    constexpr double leg = 0.02, r = 6e-3, bend = pi * r;
    double s = t * (3 * leg + 2 * bend);
    if (s < leg) return {{s, 0, 0}};
    if ((s -= leg) < bend) return {{leg + r * std::sin(s / r), r - r * std::cos(s / r), 0}};
    if ((s -= bend) < leg) return {{leg - s, 2 * r, 0}};
    if ((s -= leg) < bend) return {{-r * std::sin(s / r), 3 * r - r * std::cos(s / r), 0}};
    return {{s - bend, 4 * r, 0}};
}

/// Two strands 10 mm apart, joined by a half circle.
Vec3 hairpin(double t) {
    constexpr double leg = 0.03, r = 5e-3, bend = pi * r;
    const double s = t * (2 * leg + bend);
    if (s < leg) return {{s, 0, 0}};
    if (s > leg + bend) return {{leg - (s - leg - bend), 2 * r, 0}};
    const double a = (s - leg) / r;
    return {{leg + r * std::sin(a), r - r * std::cos(a), 0}};
}
/// The paper's shape of two bends and a throat.
Vec3 omega(double t) {
    const double a = (0.25 + 1.5 * t) * pi - pi / 2;
    return {{0.012 * std::sin(a) * (1 + 0.4 * std::cos(2 * a)), 0.012 * std::cos(a), 0}};
}
Vec3 zigzag(double t) {
    const double s = 6 * t, k = std::floor(std::min(s, 5.999));
    const double f = s - k;
    return {{0.01 * s, 0.008 * (int(k) % 2 ? 1 - f : f), 0}};
}

const Shape shapes[] = {
    {"lines and arcs", 1e-3, false, true, 900, along_meander, true},
    {"lines and arcs, wide", 5.5e-3, false, true, 900, along_meander, true},
    {"hairpin", 1e-3, false, false, 300, hairpin},
    {"wide hairpin", 4.5e-3, false, false, 300, hairpin},
    {"eight", 1e-3, true, false, 400,
     [](double t) { return Vec3{{0.03 * std::sin(2 * pi * t), 0.02 * std::sin(4 * pi * t), 0}}; }},
    {"omega", 1e-3, false, true, 200, omega},
    {"bend as tight as the tube", 2e-3, true, false, 120,
     [](double t) {
         return Vec3{{2.1e-3 * std::cos(2 * pi * t), 2.1e-3 * std::sin(2 * pi * t), 0}};
     }},
    {"helix", 1.5e-3, false, false, 600,
     [](double t) {
         return Vec3{{0.01 * std::cos(8 * pi * t), 0.01 * std::sin(8 * pi * t), 0.03 * t}};
     }},
    {"zigzag", 1e-3, false, false, 7, zigzag},
    {"dense zigzag", 1e-3, false, true, 601, zigzag},
    {"coarse circle", 1e-3, true, false, 9,
     [](double t) { return Vec3{{0.02 * std::cos(2 * pi * t), 0.02 * std::sin(2 * pi * t), 0}}; }},
};

/// A hand: about the curve, in and out of the tube; now and then to anywhere, or at rest.
class Hand {
  public:
    Hand(const Shape& shape, unsigned seed) : shape_(shape), random_(seed) {}

    Vec3 operator()(long tick) {
        if (tick % 997 == 0) speed_ = uniform(-2e-4, 2e-4), deep_ = uniform(0, 4) * shape_.radius;
        if (tick % 4999 == 0) jump_ = uniform(-1, 1) * 0.02;
        if (tick % 7919 < 300) return at_;  // at rest
        t_ += speed_;
        if (shape_.closed) t_ -= std::floor(t_);
        if (t_ < -0.05 || t_ > 1.05) speed_ = -speed_, t_ = std::clamp(t_, -0.05, 1.05);
        jump_ *= 0.999;
        Vec3 x = shape_.curve(std::clamp(t_, 0.0, 1.0));
        if (!shape_.closed && (t_ < 0 || t_ > 1)) x[0] += 0.1 * (t_ - std::clamp(t_, 0.0, 1.0));
        turn_ += uniform(0, 0.02);
        const double across = deep_ * std::sin(0.003 * double(tick)) + jump_;
        const Vec3 aside{{across * std::cos(turn_), across * std::sin(turn_),
                          0.3 * across * std::sin(3 * turn_)}};
        const double tremor = 2e-5 * std::sin(0.06 * double(tick));
        at_ = x + aside + Vec3{{tremor, -tremor, tremor}};
        return at_;
    }

  private:
    double uniform(double low, double high) {  // the same numbers from every library
        return low + (high - low) * double(random_()) / 4294967295.0;
    }
    const Shape& shape_;
    std::mt19937 random_;
    double t_ = 0.5, speed_ = 0, deep_ = 0, jump_ = 0, turn_ = 0;
    Vec3 at_ = shape_.curve(0.5);
};

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
        if (s.held && s.status == vfplan::ok && norm(s.force) > 0) {
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
