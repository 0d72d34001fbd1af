// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The points around the proxy, gathered once and kept while the proxy stays near enough: within a
// tick and over many ticks.
#pragma once

#include "vfplan/grid.hpp"

namespace vfplan {

/// Points near a place, from a Grid or Edited. A neighbourhood too crowded for the list is read
/// from the grid.
template <int D, class SourceOf>
class Gathered {
  public:
    using Source = SourceOf;
    static constexpr std::size_t most = 8192;  // points in the list

    /// `reach`: the largest radius that is asked for often; `skin`: how far x may go meanwhile;
    /// `cell`: side of the grid's cells [m].
    Gathered(const Cloud<D>& cloud, double reach, double skin, double cell,
             const Kernels<D>& kernels)
        : source_(cloud, cell),
          held_(std::clamp<std::size_t>(cloud.size() / 4, 1024, most)),
          radius_(reach + skin),
          kernels_(kernels) {}

    const Source& source() const noexcept { return source_; }
    Source& source() noexcept { return source_; }
    std::size_t bytes() const noexcept { return source_.bytes() + held_.bytes(); }

    /// Calls f(Span) for stretches that together hold every point within `reach` of x (and more).
    template <class F>
    void visit(const Vec<D>& x, double reach, F&& f) noexcept {
        if (reach > radius_) return source_.visit(x, reach, f);
        if (!(norm(x - centre_) + reach <= radius_) || !valid_) gather(x, reach);
        if (crowded_) return source_.visit(x, reach, f);
        f(held_.span(0, count_));
    }

    /// The next answers depend on nothing asked before.
    void forget() noexcept { valid_ = false; }
    /// Whether the list has to do with what lies at p.
    bool reaches(const Vec<D>& p) const noexcept {
        return !valid_ || norm(p - centre_) <= radius_ * (1 + 1e-9);
    }

  private:
    /// Around a place ahead of x, as it went on from the last one: so the list serves longer.
    void gather(const Vec<D>& x, double reach) noexcept {
        const Vec<D> way = x - centre_;
        const double ahead = std::min(norm(way), 0.9 * (radius_ - reach));
        centre_ = valid_ ? x + along(way, ahead) : x;
        valid_ = true;
        crowded_ = false;
        count_ = 0;
        const double reach2 = radius_ * radius_ * (1 + 1e-12);
        source_.visit(centre_, radius_, [&](const Span<D>& span) noexcept {
            if (crowded_ || count_ + span.n > held_.size()) {
                crowded_ = crowded_ || !take_in_parts(span, reach2);
                return;
            }
            count_ += take(span, reach2);
        });
    }
    std::size_t take(const Span<D>& span, double reach2) noexcept {
        double* to[D];
        for (int k = 0; k < D; ++k) to[k] = held_.axis(k) + count_;
        return kernels_.gather(span, centre_, reach2, to);
    }
    /// A stretch that may not fit as a whole, eight points at a time; false when it does not.
    bool take_in_parts(Span<D> span, double reach2) noexcept {
        while (span.n > 0) {
            Span<D> part = span;
            part.n = std::min<std::size_t>(span.n, 8);
            if (count_ + part.n > held_.size()) return false;
            count_ += take(part, reach2);
            for (int k = 0; k < D; ++k) span.c[k] += part.n;
            span.n -= part.n;
        }
        return true;
    }

    Source source_;
    Cloud<D> held_;
    double radius_;
    Kernels<D> kernels_;
    Vec<D> centre_;
    std::size_t count_ = 0;
    bool valid_ = false, crowded_ = false;
};

/// Square of the distance from x to the nearest point within `reach`, or to one further off.
template <class Search, int D>
double nearest2(Search& search, const Kernels<D>& kernels, const Vec<D>& x, double reach) noexcept {
    double least = std::numeric_limits<double>::infinity();
    search.visit(x, reach, [&](const Span<D>& span) noexcept {
        least = std::min(least, kernels.nearest2(span, x));
    });
    return least;
}

template <int D>
using Neighbours = Gathered<D, Grid<D>>;

/// The same calls on a cloud too small to be worth a grid or a list: always all of it.
template <int D>
class AllPoints {
  public:
    AllPoints(const Cloud<D>& cloud, double, double, double, const Kernels<D>&)
        : box_(cloud.box()), cloud_(cloud) {}

    const AllPoints& source() const noexcept { return *this; }
    const Box<D>& box() const noexcept { return box_; }
    std::size_t cells() const noexcept { return 0; }
    std::size_t bytes() const noexcept { return cloud_.bytes(); }
    void forget() noexcept {}
    template <class F>
    void visit(const Vec<D>&, double, F&& f) const noexcept {
        f(cloud_.span(0, cloud_.size()));
    }

  private:
    Box<D> box_;
    Cloud<D> cloud_;
};

}  // namespace vfplan
