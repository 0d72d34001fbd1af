// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The paper's rule, Algorithms 1-4 with equations (1)-(7), as the NumPy reference reads it. It
// keeps the paper's failures; the robust rule cures them.
#pragma once

#include "vfplan/rules/start_inside.hpp"

namespace vfplan::inline v1 {

template <int D>
class PaperRule {
  public:
    PaperRule(const Cloud<D>& cloud, const Parameters& p)
        : p_(p),
          reach_(p.outer_radius + p.point_radius),
          neighbours_(cloud, reach_, 0.05 * reach_, reach_ / 4, p.search) {}

    void reset() noexcept {
        neighbours_.forget();
        known_at_.reset();
    }
    void continue_from(FreeBefore<D>*) noexcept { reset(); }
    PaperRule& motion() noexcept { return *this; }
    Neighbours<D>& neighbours() noexcept { return neighbours_; }
    std::optional<Vec<D>> end_of_way(const Vec<D>& x) const noexcept { return x; }

    /// Algorithm 1, one servo loop.
    RuleAnswer<D> step(Vec<D>& proxy, const Vec<D>& hip) noexcept {
        RuleAnswer<D> answer;
        const auto [normal, de] = sight(proxy);
        const double rv = p_.point_radius, r1 = p_.r1();
        if (!(de < reach_)) {  // Algorithm 4, no neighbour: s = P_HIP - P_proxy
            proxy = hip;
            return answer;
        }
        answer.normal = normal;
        const Vec<D> u = hip - proxy;
        if (de < r1 + rv) {
            answer.state = State::entrenched;
            proxy = proxy + leave(proxy, answer.normal) * answer.normal;
        } else if (de <= p_.r2() + rv) {
            answer.state = State::in_contact;
            proxy = proxy + contact_step(u, answer.normal);
        } else {
            answer.state = State::free_motion;
            proxy = proxy + free_step(proxy, hip, u, answer.normal, de);
        }
        return answer;
    }

  private:
    static constexpr double cancelled = 1e-12;  // of the weights: a sum below it has no direction
    static constexpr double tiny2 = 1e-30;      // [m²]; below it float32 does not hold the square

    /// What a tick asks of the cloud first: eqs. (1) and (2), and the nearest point.
    struct Sight {
        Vec<D> normal;
        double nearest;
    };

    /// Where the proxy has not moved since the last tick, the answer stands.
    const Sight& sight(const Vec<D>& proxy) noexcept {
        if (known_at_ == proxy) return sight_;
        NormalSum<D> near;
        neighbours_.visit(proxy, reach_, [&](const PointSpan<D>& s) noexcept {
            kernels<D>.normal(s, proxy, p_.r1(), p_.outer_radius, near);
        });
        const double nearest = std::sqrt(near.nearest2);
        sight_ = {nearest < reach_ ? direction(proxy, near) : Vec<D>{}, nearest};
        known_at_ = proxy;
        return sight_;
    }
    /// Along the sum of eq. (1), or 0. No weight exceeds 1: a sum above its share of the number of
    /// points is above that of the weights too. The upper bound turns away what overflowed.
    Vec<D> direction(const Vec<D>& proxy, const NormalSum<D>& near) noexcept {
        const double length = norm(near.sum), most = static_cast<double>(near.count);
        if (near.nearest2 >= tiny2 && length > cancelled * most && length < 2 * most)
            return (1 / length) * near.sum;
        return direction_closely(proxy);
    }
    /// The same as eq. (1) is written, one point after the other: where it cancels, or where a
    /// point lies so near that its square would underflow.
    Vec<D> direction_closely(const Vec<D>& proxy) noexcept {
        Vec<D> sum;
        double weights = 0;
        neighbours_.visit(proxy, reach_, [&](const PointSpan<D>& s) noexcept {
            for (std::size_t i = 0; i < s.n; ++i) {
                const Vec<D> away = proxy - s[i];
                const double r = norm(away);
                if (!(r > 0 && r < p_.outer_radius)) continue;
                const double t = std::max((r - p_.r1()) / (p_.outer_radius - p_.r1()), 0.0);
                const double q = 1 - t, phi = (1 + 4 * t) * (q * q * q * q);
                sum = sum + (phi / r) * away;
                weights += phi;
            }
        });
        const double length = norm(sum);
        return length > cancelled * weights ? (1 / length) * sum : Vec<D>{};
    }

    /// Algorithm 3, eqs. (4) to (6): along u_p where the HIP lies beyond, at most xi r1.
    Vec<D> contact_step(const Vec<D>& u, const Vec<D>& n) const noexcept {
        const double into = dot(n, u);
        const Vec<D> up = u - into * n;
        return along(into < 0 ? up : u, p_.gain * std::min(norm(up), p_.r1()));
    }

    /// Algorithm 2.
    Vec<D> free_step(const Vec<D>& proxy, const Vec<D>& hip, const Vec<D>& u, const Vec<D>& n,
                     double de) noexcept {
        const double length = norm(u), R = p_.R();
        if (length == 0) return {};
        if (de > (R + length) * (1 + 1e-12)) return u;  // no sphere begins within the step
        const Vec<D> way = (1 / length) * u;
        double d = infinity;
        neighbours_.visit(proxy, reach_, [&](const PointSpan<D>& s) noexcept {
            d = std::min(d, kernels<D>.first_root_eq3(s, proxy, way, reach_ * reach_, R * R));
        });
        if (d >= length) return u;  // nothing in the way: special case 2 would change nothing
        const bool hip_inside = dot(n, u) < 0;
        if (!hip_inside && moves_away(proxy, hip)) return u;
        if (d == 0 && hip_inside) return contact_step(u, n);
        return (d / length) * u;
    }

    /// Special case 2: the in-neighbour points are further from the HIP than from the proxy.
    bool moves_away(const Vec<D>& proxy, const Vec<D>& hip) noexcept {
        Distances sum;
        neighbours_.visit(proxy, reach_, [&](const PointSpan<D>& s) noexcept {
            kernels<D>.distances(s, proxy, hip, reach_ * reach_, sum);
        });
        return sum.to_hip / sum.count > sum.to_proxy / sum.count;
    }

    /// Eq. (7): the way out along n.
    double leave(const Vec<D>& proxy, const Vec<D>& n) noexcept {
        const double R = p_.R(), inside = p_.r1() + p_.point_radius;
        double most = -infinity;
        neighbours_.visit(proxy, reach_, [&](const PointSpan<D>& s) noexcept {
            most = std::max(most, kernels<D>.last_root_eq7(s, proxy, n, inside * inside, R * R));
        });
        return std::isfinite(most) ? most : 0;
    }

    Parameters p_;
    double reach_;
    Neighbours<D> neighbours_;
    Sight sight_;
    std::optional<Vec<D>> known_at_;  // the proxy of which that is the sight
};

}  // namespace vfplan::inline v1
