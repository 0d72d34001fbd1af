// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Where fitted surfaces leave no way, the points themselves decide: the step nearest to a wished
// one that runs into none of the points that touch the proxy, the god-object's own.
#pragma once

#include "vfplan/cone.hpp"
#include "vfplan/neighbours.hpp"

namespace vfplan {

template <int D, class Search>
class Touched {
  public:
    static constexpr int most = 8;  // points that may bend the step

    explicit Touched(const Kernels<D>& kernels) noexcept : kernels_(kernels) {}

    /// argmin |v - u| with (x - p) · v >= 0 for the points p within `reach` of x, by a hair more
    /// than 0, so that rounding does not stop it at once. The points that v runs into most steeply
    /// are taken one after the other, until there is none.
    Vec<D> operator()(Search& search, const Vec<D>& x, const Vec<D>& u, double reach,
                      double slack) const noexcept {
        Wall<D> wall[most];
        Vec<D> v = u;
        for (int count = 0; count < most; ++count) {
            double into = 0;
            visit(search, x, reach, [&](const Vec<D>& away) noexcept {
                const double r = norm(away), a = dot(away, v);
                if (r > 0 && a < into * r) into = a / r, wall[count] = {(1 / r) * away, slack};
            });
            if (into == 0) break;
            v = project(u, wall, count + 1, 0.5 * slack);
            if (!(norm(v) > slack)) break;
        }
        return v;
    }

  private:
    template <class F>
    void visit(Search& search, const Vec<D>& x, double reach, F&& f) const noexcept {
        search.visit(x, reach, [&](const Span<D>& s) noexcept {
            std::uint32_t which[room];
            const std::size_t n = kernels_.within(s, x, reach * reach, which, room);
            for (std::size_t i = 0; i < std::min(n, room); ++i) f(x - s[which[i]]);
            if (n <= room) return;
            for (std::size_t i = which[room - 1] + 1; i < s.n; ++i) {  // a crowd of points
                const Vec<D> w = x - s[i];
                if (dot(w, w) <= reach * reach) f(w);
            }
        });
    }

    static constexpr std::size_t room = 256;
    Kernels<D> kernels_;
};

}  // namespace vfplan
