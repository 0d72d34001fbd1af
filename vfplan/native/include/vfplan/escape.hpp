// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A start inside the fixture: the proxy is taken out along the shortest way found, slowly, so that
// the force ramps; it follows the HIP meanwhile. Outside, the rule takes over as slowly.
#pragma once

#include <utility>

#include "vfplan/handover.hpp"
#include "vfplan/neighbours.hpp"
#include "vfplan/status.hpp"

namespace vfplan {

/// The free space before an exchange. A way out leads to the proxy's own side if the proxy could
/// have gone it before, and comes out with the fixture, in the direction -out, where it was.
template <int D>
class Passage {
  public:
    virtual bool free(const Vec<D>& d, double length, const Vec<D>& out) const noexcept = 0;

  protected:
    ~Passage() = default;
};

/// What a start may be inside of: the balls of radius R around the points of a cloud.
template <int D>
class Balls {
  public:
    static constexpr double never = std::numeric_limits<double>::infinity();

    Balls(const Kernels<D>& kernels, double radius) noexcept : kernels_(kernels), R_(radius) {}

    /// From the nearest point within R to x; 0 where there is none but at x itself.
    template <class Search>
    Vec<D> from_nearest(Search& search, const Vec<D>& x) const noexcept {
        double least = never;
        Vec<D> away;
        search.source().visit(x, R_ * (1 + 1e-6), [&](const Span<D>& s) noexcept {
            if (!(kernels_.nearest2(s, x) < least)) return;
            for (std::size_t i = 0; i < s.n; ++i) {
                const Vec<D> w = x - s[i];
                const double d2 = dot(w, w);
                if (d2 < least && d2 > 0) least = d2, away = w;
            }
        });
        return away;
    }
    /// Distance from y along d out of all balls that y is in; -infinity in none.
    template <class Search>
    double out(Search& search, const Vec<D>& y, const Vec<D>& d) const noexcept {
        const double inside2 = R_ * R_ * (1 - 1e-9);
        double s = -never;
        search.source().visit(y, R_, [&](const Span<D>& span) noexcept {
            s = std::max(s, kernels_.out(span, y, d, inside2, R_ * R_));
        });
        return s;
    }

  private:
    Kernels<D> kernels_;
    double R_;
};

template <int D, class Search, class Around = Balls<D>>
class Escape {
  public:
    static constexpr int most_hops = 48;             // from sphere to sphere along the way, a tick
    static constexpr int most_hops_to_choose = 128;  // along all ways together, a tick
    static constexpr int most_ticks_to_choose = 1024;

    Escape(const Around& around, double radius) noexcept : around_(around), R_(radius) {}

    bool active() const noexcept { return active_; }
    const Vec<D>& way() const noexcept { return way_; }
    void stop() noexcept {
        active_ = crossed_ = false;
        passage_ = nullptr;
    }
    /// The next way out is one that keeps to this, where there is one.
    void keep_to(const Passage<D>* passage) noexcept { passage_ = passage; }
    /// `inside`, and whether no way out on the proxy's own side was found.
    std::uint8_t status() const noexcept { return crossed_ ? inside | crossed : inside; }

    /// The HIP is at h, and the proxy inside: look for the way out, from the next step on.
    void begin(Search& search, const Vec<D>& h) noexcept {
        active_ = true;
        out_ = 0;
        last_ = start_ = h;
        way_ = Vec<D>{};
        way_.c[D - 1] = 1;
        way_ = nearest_ = from_nearest(search, h);
        best_ = never;
        for (double& t : reached_) t = 0;
        ticks_to_choose_ = most_ticks_to_choose;
        crossed_ = false;
    }

    /// One tick; true when the proxy has reached the free space.
    bool step(Search& search, const Vec<D>& h, Vec<D>& proxy) noexcept {
        bool out = false;
        if (ticks_to_choose_ > 0 && !choose(search)) {  // no force before there is a way
            --ticks_to_choose_;
            out = hop(search, h, way_) == free;
        } else {
            ticks_to_choose_ = 0;
            passage_ = nullptr;
            out = go(search, h);
        }
        last_ = h;
        proxy = h + out_ * way_;
        active_ = !out;
        return out;
    }

    /// The HIP is at h, wherever the way out began.
    void meets(const Vec<D>& h) noexcept { last_ = h; }

    /// Where the proxy, now at x, may go while the rule takes over: the HIP has come to h.
    Leash<D> leash(const Vec<D>& x, const Vec<D>& h) noexcept {
        const Vec<D> moved = h - std::exchange(last_, h);
        return {x + moved, ramp * R_ + norm(moved)};
    }

  private:
    static constexpr int ring = D == 3 ? 27 : 9;
    static constexpr double never = std::numeric_limits<double>::infinity();
    static constexpr double free = -never;

    Vec<D> from_nearest(Search& search, const Vec<D>& x) noexcept {
        const Vec<D> away = around_.from_nearest(search, x);
        const double r = norm(away);
        return r > 0 ? (1 / r) * away : way_;
    }

    /// From the nearest point, its opposite, and the neighbours of a cube.
    Vec<D> candidate(int i) const noexcept {
        if (i < 2) return (i == 0 ? 1.0 : -1.0) * nearest_;
        Vec<D> d;
        for (int k = 0, rest = i - 2; k < D; ++k, rest /= 3) d.c[k] = rest % 3 - 1;
        return norm(d) > 0 ? along(d, 1) : nearest_;
    }

    /// All ways are followed hop by hop, in turn, so that none uses up the hops of a tick; false
    /// while the shortest one is not known.
    bool choose(Search& search) noexcept {
        int hops = most_hops_to_choose;
        for (bool open = true; open;) {
            open = false;
            for (int i = 0; i < ring + 2; ++i) {
                if (!(reached_[i] < best_)) continue;
                if (hops-- == 0) return false;
                open = true;
                const Vec<D> d = candidate(i);
                const double s = hop(search, start_ + reached_[i] * d, d);
                if (s == free)
                    best_ = reached_[i], way_ = d, chosen_ = i;
                else
                    reached_[i] += s;
            }
        }
        if (!own(search, way_, best_)) return refuse();
        for (int i = 0; i < 2; ++i) {
            const Vec<D> d = from_nearest(search, start_ + best_ * way_);
            const double t = exit(search, start_, d, best_);
            if (t < best_ && own(search, d, t)) best_ = t, way_ = d;
        }
        return true;
    }
    bool own(Search& search, const Vec<D>& d, double length) noexcept {
        return !passage_ || passage_->free(d, length, from_nearest(search, start_ + length * d));
    }
    /// The shortest way leads to the other side: the next one, or of all, where none is left.
    bool refuse() noexcept {
        reached_[chosen_] = best_ = never;
        for (double t : reached_)
            if (t < never) return false;
        for (double& t : reached_) t = 0;
        passage_ = nullptr;
        crossed_ = true;
        return false;
    }

    /// One tick along the way; true when that ends outside.
    bool go(Search& search, const Vec<D>& h) noexcept {
        const double behind = exit(search, h, way_, out_);
        if (behind < out_) {  // as when the HIP has come through to the other side
            out_ = std::max(behind, out_ - ramp * R_);
        } else {
            const double most = ramp * R_ + std::max(0.0, -dot(h - last_, way_));
            const double ahead = exit(search, h + out_ * way_, way_, most);
            out_ += std::min(ahead, most);
            if (ahead < most) return true;
        }
        return hop(search, h + out_ * way_, way_) == free;
    }

    /// Distance from h along d to the free space; infinity beyond `most` or out of hops.
    double exit(Search& search, const Vec<D>& h, const Vec<D>& d, double most) noexcept {
        double t = 0;
        for (int i = 0; i < most_hops && t < most; ++i) {
            const double s = hop(search, h + t * d, d);
            if (s == free) return t;
            t += s;
        }
        return never;
    }

    /// Distance from y along d out of all that y is in; `free` where it is in nothing.
    double hop(Search& search, const Vec<D>& y, const Vec<D>& d) noexcept {
        const double s = around_.out(search, y, d);
        return s == free ? s : s + 1e-12 * R_;
    }

    Around around_;
    double R_;
    bool active_ = false;
    Vec<D> way_, last_;
    double out_ = 0;  // from the HIP to the proxy, along the way
    Vec<D> start_, nearest_;
    double reached_[ring + 2] = {};  // along each candidate, from the start
    double best_ = never;
    int chosen_ = 0;  // of the candidates
    const Passage<D>* passage_ = nullptr;
    bool crossed_ = false;
    int ticks_to_choose_ = 0;
};

}  // namespace vfplan
