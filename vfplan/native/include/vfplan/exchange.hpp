// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Another engine, or other points, under the hand: what the editor's thread hands to the loop
// (PendingChanges), the numbers that points keep (PointNumbers), and how the force gets
// from the one engine to the other (ForceRamp). After a start inside, the force is ramped by WayOut
// and ForceBall of rules/start_inside.hpp instead.
#pragma once

#include "vfplan/base/queue.hpp"
#include "vfplan/base/work.hpp"
#include "vfplan/mesh/surface.hpp"
#include "vfplan/parameters.hpp"

namespace vfplan::inline v1::detail {

struct EngineImpl;

/// What the editor hands to the loop.
struct PendingChange {
    enum Change { exchange, remove, add, stiffness } what = exchange;
    EngineImpl* engine = nullptr;
    std::size_t id = 0;
    Vec3 point;  ///< or K [N/m]
};

/// An engine behind its type.
struct EngineImpl {
    explicit EngineImpl(const Parameters& p) noexcept : parameters(p) {}
    virtual ~EngineImpl() = default;
    virtual void reset(const Vec3& hip) noexcept = 0;
    /// The next tick starts with the proxy of another engine, which was outside of `previous`.
    virtual void continue_from(const Vec3& proxy, EngineImpl* previous) noexcept = 0;
    /// Where the proxy is, or comes out if it is led out since an exchange; nothing while that is
    /// not known.
    virtual std::optional<Vec3> end_of_way() noexcept = 0;
    virtual Step step(const Vec3& hip) noexcept = 0;
    /// Takes up what is no exchange.
    virtual void change(const PendingChange& change) noexcept = 0;
    /// The points are samples of this mesh.
    virtual void set_skin(const mesh::Surface&) {}
    virtual std::size_t bytes() noexcept = 0;
    virtual std::size_t cells() noexcept = 0;
    /// Distance from x to the geometry, or `reach` where that is less [m]; 0 where a budget has no
    /// steps left to know it.
    virtual double distance(const Vec3& x, double reach, WorkBudget* budget) noexcept = 0;
    bool is_outside(const Vec3& x) noexcept {
        return distance(x, parameters.R(), &look) >= parameters.R() - 2 * parameters.band;
    }
    /// Inner steps among triangles that a tick looks at other engines for.
    static constexpr std::int64_t look_steps = 4000;

    WorkBudget look{look_steps};  ///< what is left of them
    Parameters parameters;        ///< of the loop: of a mesh with the band of its smooth body
};

using ImplPtr = std::unique_ptr<EngineImpl>;

/// The ramp of the force after an exchange, an edit or another K. The force follows that of the
/// engine by K (R/256 + |motion of the HIP|) in a millisecond, and by a newton at most, until it is
/// there; K is the larger of the two. Where nothing is in reach the force of before is gone sooner.
class ForceRamp {
  public:
    /// `stiffness`: the largest of K before [N/m].
    void begin(double stiffness) noexcept {
        if (!is_on_) stiffness_ = release_ = 0;
        stiffness_ = std::max(stiffness_, stiffness);
        is_on_ = true;
        ticks_there_ = 0;
    }
    void stop() noexcept { is_on_ = false; }
    /// `last`: the force of the tick before; `moved`: how far the HIP has moved since [m].
    void limit_force(Step& s, const Parameters& p, const Vec3& last, double moved) noexcept {
        if (!is_on_) return;
        const bool is_free = s.force == Vec3{};
        if (!is_free)
            release_ = 0;
        else if (release_ == 0)
            release_ = norm(last) * p.period / tuned::release_time;
        const double ramp = tuned::force_ramp * p.R() * p.pace();
        const double by_spring = std::max(stiffness_, p.stiffest()) * (ramp + moved);
        const double allowed =
            std::max(std::min(by_spring, tuned::max_force_ramp * p.period), release_);
        const Vec3 change = s.force - last;
        const double size = norm(change);
        const bool is_there = size <= allowed;
        if (!is_there) s.force = last + (allowed / size) * change;
        ticks_there_ = is_there ? ticks_there_ + 1 : 0;
        // An engine whose proxy still moves under a still HIP may change the force once more.
        const bool still_moves = s.status & (Status::inside | Status::limit);
        is_on_ = ticks_there_ < 2 || (ticks_there_ < tuned::ticks_to_stall && still_moves);
        if (is_on_) s.status |= Status::changing;
    }

  private:
    bool is_on_ = false;
    int ticks_there_ = 0;   // in which the force was that of the engine
    double stiffness_ = 0;  // the largest K since it is on [N/m]
    double release_ = 0;    // what goes a tick where nothing is in reach [N]
};

/// Between the editor's thread and the loop.
struct PendingChanges {
    static constexpr std::size_t capacity = 4096;
    /// Changes that a tick takes up at most, one exchange among them.
    static constexpr int max_a_tick = 64;

    // Both have room from the first change on: an engine that nobody changes needs none.
    SpscQueue<PendingChange> queue;
    SpscQueue<EngineImpl*> retired;
    std::atomic<std::uint64_t> applied{0};
    ForceRamp force_ramp;

    ~PendingChanges() {
        for (; const PendingChange* c = queue.front(); queue.pop()) delete c->engine;
        delete_retired();
    }
    /// Makes room, in the editor's thread.
    void reserve() {
        queue.reserve(capacity);
        retired.reserve(2 * capacity);  // as many as may wait, and those before
    }
    std::size_t bytes() const noexcept { return queue.bytes() + retired.bytes(); }
    /// Gives an engine back, in the loop.
    void retire(EngineImpl* old) noexcept { retired.push(old); }
    /// Deletes what was given back, in the editor's thread.
    void delete_retired() noexcept {
        for (; EngineImpl* const* old = retired.front(); retired.pop()) delete *old;
    }
};

/// The points of an engine that is edited, as the editor's thread knows them: each keeps its number
/// for good, whatever is taken away before it.
class PointNumbers {
  public:
    /// The engine of fewer points is made anew at each edit: measured in docs/moving.md.
    static constexpr std::size_t min_to_edit = 500;

    PointNumbers(const double* xyz, std::size_t n) : xyz_(xyz, xyz + 3 * n), local_(n), left_(n) {
        renumber();
    }

    std::size_t size() const noexcept { return left_; }
    /// x y z of those that are left, in the order of their numbers, from number `first` on.
    std::vector<double> points_left(std::size_t first = 0) const {
        std::vector<double> all;
        for (std::size_t i = first; i < local_.size(); ++i)
            if (local_[i] != gone) all.insert(all.end(), &xyz_[3 * i], &xyz_[3 * i] + 3);
        return all;
    }
    /// An engine was made of those that are left: it counts from 0.
    void renumber() noexcept {
        std::size_t next = 0;
        for (std::size_t& local : local_)
            if (local != gone) local = next++;
        base_ = next_ = next;
        is_behind_ = false;
    }
    /// No engine has the last edit.
    void mark_behind() noexcept { is_behind_ = true; }
    /// Whether the engine made last takes m more points as it is.
    VFPLAN_ONCE bool fits_in_place(std::size_t m) const noexcept;

    /// The edit, in the numbers of that engine. Throws std::invalid_argument, and changes nothing,
    /// for a number that is no point's or no longer, for coordinates out of range, and where no
    /// point would be left.
    VFPLAN_ONCE std::vector<PendingChange> edit(const std::uint32_t* remove, std::size_t n,
                                                const double* add, std::size_t m,
                                                const Parameters& p);

  private:
    static constexpr std::size_t gone = ~std::size_t{0};
    /// So many points in one place are less than max_tick_time: they are checked that often.
    static constexpr std::size_t points_a_check = 1024;

    std::vector<double> xyz_;
    std::vector<std::size_t> local_;  // each point's number in the engine made last
    std::size_t left_;
    std::size_t base_ = 0;  // points that engine was made of
    std::size_t next_ = 0;  // next number of that engine
    bool is_behind_ = false;
};

}  // namespace vfplan::inline v1::detail
