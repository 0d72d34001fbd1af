// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Another engine, or other points, under the hand: what the editor's thread hands to the loop, and
// how the force gets from the one to the other.
#pragma once

#include <string>
#include <utility>

#include "vfplan/base/spsc_queue.hpp"
#include "vfplan/cloud/grid.hpp"
#include "vfplan/parameters.hpp"
#include "vfplan/rules/start_inside.hpp"
#include "vfplan/tick_time.hpp"

namespace vfplan::detail {

// An engine under the hand is exchanged for another one, or its cloud edited: what the editor's
// thread hands to the loop, and how the force gets from one to the other.

/// An engine behind its type.
struct AnyEngine {
    AnyEngine(double stiffness, double radius, double band) noexcept
        : stiffness(stiffness), radius(radius), band(band) {}
    virtual ~AnyEngine() = default;
    virtual void reset(const Vec3&) noexcept = 0;
    /// The next tick begins with the proxy of another engine, one that was out of `before`.
    virtual void go_on(const Vec3& proxy, AnyEngine* before) noexcept = 0;
    virtual Step step(const Vec3&) noexcept = 0;
    virtual void remove(std::size_t) noexcept {}
    virtual void add(const Vec3&) noexcept {}
    virtual std::size_t bytes() noexcept = 0;
    virtual std::size_t cells() noexcept = 0;
    virtual bool planar() noexcept = 0;
    virtual double distance(const Vec3&) noexcept = 0;
    /// The same, or `reach` where that is less.
    virtual double within(const Vec3&, double reach) noexcept = 0;

    double stiffness, radius, band;  // the largest of K; R
    AnyEngine* next = nullptr;       // of those that are retired
};

struct Change {
    enum Kind { exchange, remove, add } kind = exchange;
    AnyEngine* engine = nullptr;
    std::size_t id = 0;
    Vec3 point;
};

/// Lets the force follow the engine's by K (R/256 + |step of the HIP|) a tick, until it is there.
class Pace {
  public:
    void begin() noexcept {
        on_ = true;
        calm_ = 0;
    }
    void stop() noexcept { on_ = false; }
    void operator()(Step& s, const AnyEngine& engine, const Vec3& last, double moved) noexcept {
        if (!on_) return;
        const double most = engine.stiffness * (ramp * engine.radius + moved);
        const Vec3 way = s.force - last;
        const double length = norm(way);
        const bool there = length <= most;
        if (!there) s.force = last + (most / length) * way;
        calm_ = there ? calm_ + 1 : 0;
        on_ = calm_ < 2 || (calm_ < tuned::patience && (s.status & (inside | limit)));
        if (on_) s.status |= changing;
    }

  private:
    bool on_ = false;
    int calm_ = 0;  // ticks that the force is the engine's
};

/// Between the editor's thread and the loop.
struct Changes {
    static constexpr std::size_t room = 4096;
    static constexpr int a_tick = 64;  // changes taken up at most

    Ring<Change> waiting{room};
    std::atomic<AnyEngine*> retired{nullptr};
    std::atomic<std::uint64_t> taken{0};
    Pace pace;

    ~Changes() {
        for (; const Change* c = waiting.front(); waiting.pop()) delete c->engine;
        collect();
    }
    /// The loop's: it alone puts in, so it never has to try again.
    void retire(AnyEngine* old) noexcept {
        old->next = retired.exchange(nullptr, std::memory_order_acquire);
        retired.store(old, std::memory_order_release);
    }
    /// The editor's.
    void collect() noexcept {
        AnyEngine* old = retired.exchange(nullptr, std::memory_order_acquire);
        while (old) delete std::exchange(old, old->next);
    }
};

// The points of an engine that is edited, as the editor's thread knows them: each keeps its number
// for good, whatever is taken away before it.

class Points {
  public:
    /// Fewer are made anew at each edit: measured in docs/moving.md.
    static constexpr std::size_t worth_editing = 500;

    Points(const double* xyz, std::size_t n) : xyz_(xyz, xyz + 3 * n), local_(n), left_(n) {
        made();
    }

    std::size_t size() const noexcept { return left_; }
    /// x y z of those that are left, in the order of their numbers.
    std::vector<double> left() const {
        std::vector<double> all;
        all.reserve(3 * left_);
        for (std::size_t i = 0; i < local_.size(); ++i)
            if (local_[i] != gone) all.insert(all.end(), &xyz_[3 * i], &xyz_[3 * i] + 3);
        return all;
    }
    /// An engine was made of those: it counts from 0.
    void made() noexcept {
        std::size_t next = 0;
        for (std::size_t& local : local_)
            if (local != gone) local = next++;
        base_ = next_ = next;
        behind_ = false;
    }
    /// No engine has the last edit.
    void missed() noexcept { behind_ = true; }
    /// Whether the engine made last takes m more as it is.
    bool fits(std::size_t m) const noexcept {
        return !behind_ && base_ >= worth_editing && next_ - base_ + m <= Edited<3>::room(base_);
    }

    /// The same for that engine. Throws std::invalid_argument, and changes nothing, for a number
    /// that is no point's or no longer, for coordinates out of range, and where none would be left.
    std::vector<Change> edit(const std::uint32_t* remove, std::size_t n, const double* add,
                             std::size_t m, const Parameters& p) {
        for (std::size_t i = 0; i < 3 * m; ++i)
            if (!(std::abs(add[i]) <= largest_coordinate))
                reject("points must be finite and within 1e6 m");
        check_resolved(p, add, m);
        if ((next_ - base_ + m) / a_look > (next_ - base_) / a_look) check_crowd(add, m, p);
        std::vector<Change> all;
        all.reserve(n + m);
        for (std::size_t i = 0; i < n; ++i) {
            const bool there = remove[i] < local_.size() && local_[remove[i]] != gone;
            if (!there || left_ + m <= n) {
                for (; i-- > 0; all.pop_back()) local_[remove[i]] = all.back().id;
                reject(there ? "a cloud needs at least one point"
                             : "remove: each a point that is there, once");
            }
            all.push_back({Change::remove, nullptr, std::exchange(local_[remove[i]], gone), {}});
        }
        for (std::size_t i = 0; i < m; ++i) {
            all.push_back(
                {Change::add, nullptr, 0, {{add[3 * i], add[3 * i + 1], add[3 * i + 2]}}});
            local_.push_back(next_++);
        }
        xyz_.insert(xyz_.end(), add, add + 3 * m);
        left_ = left_ + m - n;
        return all;
    }

  private:
    static constexpr std::size_t gone = ~std::size_t{0};
    static constexpr std::size_t a_look = 1024;  // points: in one place less than most_tick_work

    /// Refuses points that came, and would, so close together that a tick takes too long.
    void check_crowd(const double* add, std::size_t m, const Parameters& p) const {
        std::vector<double> came(add, add + 3 * m);
        for (std::size_t i = local_.size() - (next_ - base_); i < local_.size(); ++i)
            if (local_[i] != gone) came.insert(came.end(), &xyz_[3 * i], &xyz_[3 * i] + 3);
        if (!(tick_work(came.data(), came.size() / 3, p) <= most_tick_work))
            reject("add: so many points in one place that a tick would take longer than 0.3 ms");
    }

    std::vector<double> xyz_;
    std::vector<std::size_t> local_;  // each point's number in the engine made last
    std::size_t left_;
    std::size_t base_ = 0, next_ = 0;  // of that engine: points it was made of, next number
    bool behind_ = false;
};

}  // namespace vfplan::detail

namespace vfplan {

/// What was free before an exchange.
template <class S>
struct Before final : Passage<S::dimension> {
    static constexpr int most_looks = 24;      // along a way; a longer one is none
    static constexpr double stride = 1 / 8.0;  // of R: no wall is passed over

    const S* space = nullptr;
    detail::AnyEngine* engine = nullptr;
    Vec3 from;

    bool free(const Vec<S::dimension>& d, double length,
              const Vec<S::dimension>& out) const noexcept override {
        const double R = engine->radius, enough = R - 2 * engine->band;
        const Vec3 way = space->direction(d), up = 2 * stride * R * space->direction(out);
        if (engine->within(from + up, 2 * R) < engine->within(from - up, 2 * R)) return false;
        double t = 0;
        for (int i = 0; i < most_looks; ++i) {
            const double room = engine->within(from + t * way, 2 * R) - enough;
            if (!(room >= 0)) return false;
            if (t >= length) return true;
            t = std::min(t + std::max(room, stride * R), length);
        }
        return false;
    }
};

}  // namespace vfplan
