// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// How far the proxy can go along a straight way: the whole way, not a step of it.
#pragma once

#include "vfplan/neighbours.hpp"
#include "vfplan/tuned.hpp"

namespace vfplan {

/// What stops the proxy: spheres of radius `outer` met steeply, of radius `inner` met at a graze.
struct Obstacles {
    double outer, inner;
    double steep;  ///< sine of the angle between way and sphere above which a meeting is steep
};

template <int D, class Search>
class Travel {
  public:
    static constexpr int most_stretches = 128;  // of all ways of a tick, each as long as R

    Travel(const Kernels<D>& kernels, double radius) noexcept : kernels_(kernels), R_(radius) {}

    /// A tick begins.
    void begin() noexcept { left_ = most_stretches; }

    /// Length of the part of [0, length] from x along the unit vector `way` that is free. `limit`
    /// is set when the way has more stretches than a tick may look at; the answer is then what was
    /// seen.
    double operator()(Search& search, const Vec<D>& x, const Vec<D>& way, double length,
                      const Obstacles& o, bool& limit) noexcept {
        const double steep = o.steep * o.outer;
        Ray<D> ray{x, way, o.outer * o.outer, o.inner * o.inner, steep * steep};
        if (length <= stretch()) return std::min(length, first(search, ray, length));
        double a, b;
        if (!search.source().box().clip(x, way, length, R_, a, b)) return length;
        for (; left_ > 0; --left_, a += stretch()) {
            const double most = std::min(stretch(), b - a);
            if (most <= 0) return length;
            ray.from = x + a * way;
            const double s = first(search, ray, most);
            if (s < most) return std::min(length, a + s);
        }
        limit = true;
        return std::min(length, a);
    }

  private:
    double stretch() const noexcept { return R_; }

    double first(Search& search, const Ray<D>& ray, double length) const noexcept {
        double s = std::numeric_limits<double>::infinity();
        // Short ways lie in the list around the proxy; long ones are asked around their middle.
        const bool brief = length <= tuned::brief * R_;
        const Vec<D> around = brief ? ray.from : ray.from + 0.5 * length * ray.way;
        const double reach = R_ + (brief ? length : 0.5 * length);
        const auto look = [&](const Span<D>& span) noexcept {
            s = std::min(s, kernels_.meet(span, ray));
        };
        if (brief)
            search.visit(around, reach, look);
        else
            search.source().visit(around, reach, look);
        // A hair before the sphere, so that it is met again and not, by a rounding, entered.
        return std::max(0.0, s - tuned::hair * R_);
    }

    Kernels<D> kernels_;
    double R_;
    int left_ = most_stretches;
};

}  // namespace vfplan
