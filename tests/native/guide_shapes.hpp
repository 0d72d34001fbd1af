// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The curves that the native tests of the guide follow, and the hand that moves along them.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "vfplan/guide.hpp"

namespace guide_shapes {

using vfplan::Vec3;
inline constexpr double pi = std::numbers::pi;

struct Shape {
    const char* name;
    double radius;
    bool closed, planar;
    int points;
    std::function<Vec3(double)> curve;  // over [0, 1]
    bool arcs = false;                  // the guide goes along `meander`, not through points
};

/// Three lines joined by half circles of 6 mm, to the left and to the right.
inline const vfplan::Stroke meander{
    {0, 0, 0, 0.02, 0, 0, 0.02, 0.012, 0, 0, 0.012, 0, 0, 0.024, 0, 0.02, 0.024, 0},
    {0, 1, 0, -1, 0, 0},
    false};
inline Vec3 along_meander(double t) {
    constexpr double leg = 0.02, r = 6e-3, bend = pi * r;
    double s = t * (3 * leg + 2 * bend);
    if (s < leg) return {{s, 0, 0}};
    if ((s -= leg) < bend) return {{leg + r * std::sin(s / r), r - r * std::cos(s / r), 0}};
    if ((s -= bend) < leg) return {{leg - s, 2 * r, 0}};
    if ((s -= leg) < bend) return {{-r * std::sin(s / r), 3 * r - r * std::cos(s / r), 0}};
    return {{s - bend, 4 * r, 0}};
}

/// Two strands 10 mm apart, joined by a half circle.
inline Vec3 hairpin(double t) {
    constexpr double leg = 0.03, r = 5e-3, bend = pi * r;
    const double s = t * (2 * leg + bend);
    if (s < leg) return {{s, 0, 0}};
    if (s > leg + bend) return {{leg - (s - leg - bend), 2 * r, 0}};
    const double a = (s - leg) / r;
    return {{leg + r * std::sin(a), r - r * std::cos(a), 0}};
}
/// The paper's shape of two bends and a throat.
inline Vec3 omega(double t) {
    const double a = (0.25 + 1.5 * t) * pi - pi / 2;
    return {{0.012 * std::sin(a) * (1 + 0.4 * std::cos(2 * a)), 0.012 * std::cos(a), 0}};
}
inline Vec3 zigzag(double t) {
    const double s = 6 * t, k = std::floor(std::min(s, 5.999));
    const double f = s - k;
    return {{0.01 * s, 0.008 * (int(k) % 2 ? 1 - f : f), 0}};
}

inline const Shape shapes[] = {
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

}  // namespace guide_shapes
