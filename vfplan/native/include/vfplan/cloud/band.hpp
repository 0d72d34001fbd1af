// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The band that a cloud asks for: how deep a ball of radius R sinks between the points that it
// touches as it rolls over them. A second layer, and what noise or a mask's stairs hide, it never
// touches.
#pragma once

#include "vfplan/rules/contacts.hpp"

namespace vfplan::inline v1 {

/// The band that the cloud of n points of three coordinates each asks for [m]: the paper's 10 µm,
/// or the depth of its dips. What nine in ten keep beyond the typical is roughness, as deep again
/// where heights differ. Of `p` only the radii and the ignored axis count; between 1e-8 R and half
/// of r_c. Throws as `check_radii` and `make_cloud`.
VFPLAN_ONCE double band_for(const double* points, std::size_t n, const Parameters& p);

#if !defined(VFPLAN_COMPILED) || defined(VFPLAN_COMPILING)
namespace detail {

/// Balls that come from two sides towards points of a cloud, and roll on each way until they touch
/// more. A dip's size: the diameter of the least circle round what the ball then touches.
template <int D>
class RollingBall {
  public:
    RollingBall(const Cloud<D>& cloud, double radius)
        : R_(radius), source_(cloud, std::min(0.4 * radius, cell_of_few(cloud)), Search::grid) {
        const std::size_t n = cloud.size(), count = std::min(n, samples);
        for (std::size_t i = 0; i < count && looked_at_ < max_points_looked_at; ++i) {
            const double golden = 0.6180339887498949 * static_cast<double>(i);
            const double at = (golden - std::floor(golden)) * static_cast<double>(n);
            approach(cloud[n == count ? i : static_cast<std::size_t>(at)], i);
        }
        std::sort(size_.begin(), size_.end());
    }

    /// Depth [m] that this share of the dips keeps; 0: there is none. What is as large as a hole,
    /// half of R, on a curve R/16 deep, counts only where there is hardly anything else.
    double depth(double share) const {
        const double hole = (D == 2 ? std::sqrt(0.5) : 0.5) * R_;
        const double apart = (D == 2 ? 1 : std::sqrt(2.0)) * R_;
        const bool sparse = weight(hole) < 0.1 * weight(apart);
        double size = 0, left = sparse ? 0.5 * weight(apart) : share * weight(hole);
        for (auto it = size_.begin(); left > 0; ++it) size = it->first, left -= it->second;
        const double quarter2 = 0.25 * size * size;
        return quarter2 / (R_ + std::sqrt(R_ * R_ - quarter2));
    }

  private:
    static constexpr std::size_t samples = 128;
    static constexpr double max_points_looked_at = 1e8;  // at points: about a second
    static constexpr double same = 1e-6;      // of R: points nearer than that count as one
    static constexpr double max_turn = 0.42;  // tangent of half of 0.8: beyond, it is a rim

    /// Side of a cell that holds about eight points of a surface.
    static double cell_of_few(const Cloud<D>& cloud) {
        const Box<D> box = cloud.box();
        const double cells = std::max(1.0, static_cast<double>(cloud.size()) / 8);
        return std::max(1e-300, norm(box.high - box.low) / (D == 2 ? cells : std::sqrt(cells)));
    }
    template <class F>
    void visit(const Vec<D>& x, double reach, F&& f) {
        source_.visit(x, reach, [&](const PointSpan<D>& span) {
            looked_at_ += static_cast<double>(span.n);
            f(span);
        });
    }

    /// Two balls from different sides towards a point; which of them is tried first is a matter of
    /// `i`.
    void approach(const Vec<D>& at, std::size_t i) {
        constexpr std::size_t all = D == 2 ? 8 : 26;  // neighbours of a square, or of a cube
        for (std::size_t k = 0, found = 0; k < all && found < 2; ++k) {
            std::size_t cell = (i + 11 * k) % all;
            cell += cell >= all / 2;  // not its middle
            Vec<D> way;
            for (int j = 0; j < D; ++j, cell /= 3) way.c[j] = static_cast<double>(cell % 3) - 1;
            found += touch_down(at, along(way, 1));
        }
    }
    /// Whether a ball may come from 2 R off along `way`; it rolls from what it touches.
    bool touch_down(const Vec<D>& at, const Vec<D>& way) {
        const Vec<D> from = at + 2 * R_ * way;
        const Ray<D> ray{from, -1.0 * way, R_ * R_, R_ * R_, 0};
        double s = 2 * R_, near2 = R_ * R_;
        visit(from, R_, [&](const PointSpan<D>& span) {
            if (near2 >= R_ * R_) near2 = std::min(near2, kernels<D>.nearest2(span, from));
        });
        if (near2 < R_ * R_) return false;
        visit(from - R_ * way, 2 * R_,
              [&](const PointSpan<D>& span) { s = std::min(s, kernels<D>.ray_hit(span, ray)); });
        const Vec<D> centre = from - s * way;
        double least2 = R_ * R_ * (1 + 1e-6);
        Vec<D> touched = at;
        visit(centre, std::sqrt(least2), [&](const PointSpan<D>& span) {
            if (!(kernels<D>.nearest2(span, centre) < least2)) return;
            for (std::size_t i = 0; i < span.n; ++i) {
                const Vec<D> p = span[i], d = p - centre;
                if (dot(d, d) < least2) least2 = dot(d, d), touched = p;
            }
        });
        roll_from(touched, along(centre - touched, 1));
        return true;
    }

    /// On from a ball over `a`, its middle along the unit vector n. What lies further off than
    /// twice a size is touched later: so nearby points are looked at first.
    void roll_from(const Vec<D>& a, const Vec<D>& n) {
        constexpr int ways = 2 * (D - 1);
        Vec<D> across[D - 1];
        tangent_frame(n, across);
        double size[ways] = {};
        int open = ways;
        for (double reach = std::min(source_.cell(), R_); open > 0 && reach < 2 * R_; reach *= 2) {
            gather(a, reach);
            for (int k = 0; k < ways; ++k) {
                if (size[k] > 0 && size[k] < 0.25 * reach) continue;  // known
                size[k] = next_contact_size(n, (k % 2 ? -1.0 : 1.0) * across[k / 2]);
                open -= size[k] > 0 && size[k] < 0.5 * reach;
            }
        }
        for (const double s : size)
            if (s > 0) size_.emplace_back(s, D == 2 ? s : 1.0);
    }
    /// Where the points within `reach` of a lie from there.
    void gather(const Vec<D>& a, double reach) {
        near_.clear();
        visit(a, reach, [&](const PointSpan<D>& span) {
            for (std::size_t i = 0; i < span.n; ++i) {
                const Vec<D> d = span[i] - a;
                const double d2 = dot(d, d);
                if (d2 > same * same * R_ * R_ && d2 <= reach * reach) near_.push_back(d);
            }
        });
    }

    /// From over the origin, R along n, towards t: the size; 0 where the ball turns round an end.
    double next_contact_size(const Vec<D>& n, const Vec<D>& t) const {
        double turn;
        const Vec<D>* b = first_touched({}, R_, n, t, turn);
        if (b == nullptr) return 0;
        if constexpr (D == 3) {
            const Vec3 middle = 0.5 * *b;
            const double scale = R_ / (1 + turn * turn);
            const Vec3 w = scale * ((1 - turn * turn) * n + 2 * turn * t) - middle;
            const Vec3 on = along(cross(*b, w), 1);
            const double arm = norm(w);
            const Vec3* c =
                first_touched(middle, arm, (1 / arm) * w, dot(on, n) > 0 ? -1.0 * on : on, turn, b);
            if (c != nullptr) return circumdiameter(norm(*b), norm(*c), norm(*c - *b));
        }
        return norm(*b);
    }
    /// Diameter of the least circle round a triangle of these sides.
    static double circumdiameter(double a, double b, double c) noexcept {
        const double longest = std::max({a, b, c}), half = (a + b + c) / 2;
        if (2 * longest * longest >= a * a + b * b + c * c) return longest;  // obtuse
        return a * b * c / (2 * std::sqrt(half * (half - a) * (half - b) * (half - c)));
    }
    /// The point that the ball touches first when its middle turns about `pivot`, from `arm` along
    /// n towards t; `turn`: tangent of half the angle. None before a rim: nullptr.
    const Vec<D>* first_touched(const Vec<D>& pivot, double arm, const Vec<D>& n, const Vec<D>& t,
                                double& turn, const Vec<D>* held = nullptr) const {
        const Vec<D>* found = nullptr;
        turn = max_turn;
        for (const Vec<D>& p : near_) {
            const Vec<D> d = p - pivot;
            const double a = dot(d, n), b = dot(d, t);
            // Met where a cos + b sin is as much as that; it is less at first, and must grow.
            const double least = (arm * arm + dot(d, d) - R_ * R_) / (2 * arm);
            const double root2 = a * a + b * b - least * least;
            if (&p == held || b <= 0 || root2 <= 0) continue;
            const double at = (least - a) / (b + std::sqrt(root2));
            if (at > -same && at < turn) turn = std::max(at, 0.0), found = &p;
        }
        return found;
    }
    double weight(double largest) const {
        double all = 0;
        for (const auto& [size, weight] : size_) all += size <= largest ? weight : 0;
        return all;
    }

    double R_, looked_at_ = 0;
    PointIndex<D> source_;
    std::vector<Vec<D>> near_;
    std::vector<std::pair<double, double>> size_;  // of a dip, and its weight: length on a curve
};

}  // namespace detail

VFPLAN_ONCE double band_for(const double* points, std::size_t n, const Parameters& p) {
    check_radii(p);
    const auto of = [&](const auto& rolling) {
        const double typical = rolling.depth(0.5), rough = rolling.depth(0.9) - typical;
        return std::max({1e-5, finest_band * p.R(), typical + 2 * rough});
    };
    const double band =
        p.ignore_axis
            ? of(detail::RollingBall<2>(make_cloud(Slice(*p.ignore_axis), points, n), p.R()))
            : of(detail::RollingBall<3>(make_cloud(Space{}, points, n), p.R()));
    return std::min(band, p.contact_radius / 2);
}
#endif

}  // namespace vfplan::inline v1
