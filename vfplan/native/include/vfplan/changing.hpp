// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// An engine under the hand is exchanged for another one, or its cloud edited: what the editor's
// thread hands to the loop, and how the force gets from one to the other.
#pragma once

#include <utility>

#include "vfplan/handover.hpp"
#include "vfplan/ring.hpp"
#include "vfplan/status.hpp"

namespace vfplan::detail {

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

}  // namespace vfplan::detail
