// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The engine a controller holds:
//
//     vfplan::Parameters p;                       // Table I
//     vfplan::Engine engine(xyz, n, p);           // allocates; throws std::invalid_argument
//     engine.reset(hip);                          // optional: else the first HIP is the start
//     for (;;) force = engine.step(hip).force;    // never allocates, throws, locks or waits
//
// Meanwhile one other thread may exchange it for another engine or edit its points: what it makes
// the loop takes up at the beginning of a tick, and gives the old one back.
//
// All is in the headers, which costs each source file that includes this one the time to compile
// the rules. With VFPLAN_COMPILED defined, only vfplan/engine.cpp compiles them, once; the CMake
// target vfplan::engine (find_package(vfplan COMPONENTS engine)) does both.
#pragma once

#include "vfplan/curve/pieces.hpp"
#include "vfplan/exchange.hpp"
#include "vfplan/mesh/surface.hpp"

namespace vfplan::inline v1 {

namespace bundle {
struct Fixture;
}

namespace detail {

/// The engine of n points [m], x y z of each in turn. Throws std::invalid_argument, as the others.
VFPLAN_ONCE ImplPtr make_impl(const double* xyz, std::size_t n, const Parameters& p);
/// The engine of lines and arcs, or of a mesh, by rule exact.
VFPLAN_ONCE ImplPtr make_impl(const std::vector<Stroke>& strokes, Parameters p);
VFPLAN_ONCE ImplPtr make_impl(const mesh::Surface& surface, Parameters p);

}  // namespace detail

/// Time [s] that a tick among n points takes at most (tick_time.hpp). Throws std::invalid_argument,
/// as the others.
VFPLAN_ONCE double tick_time_bound(const double* xyz, std::size_t n, const Parameters& p);
/// The same of rule exact among lines and arcs.
VFPLAN_ONCE double tick_time_bound(const std::vector<Stroke>& strokes, const Parameters& p);
/// The same of rule exact among triangles.
VFPLAN_ONCE double tick_time_bound(const mesh::Surface& surface, const Parameters& p);

/// What an engine is made for: a loop of 1 kHz, or a replay or study, which can wait.
enum class Use { real_time, replay, offline = replay };

class Engine {
  public:
    /// An edit of more points makes the engine anew.
    static constexpr std::size_t max_edit_in_place = detail::PendingChanges::capacity / 2;

    /// The engine of n points `xyz` [m], x y z of each in turn. Throws std::invalid_argument.
    Engine(const double* xyz, std::size_t n, const Parameters& p) : parameters_(p) {
        if (p.search == Search::editable) numbers_ = std::make_unique<detail::PointNumbers>(xyz, n);
        impl_ = make_impl(xyz, n);
    }

    /// A drawn curve, rendered as it is: rule `exact`, across p.ignore_axis. Of the parameters,
    /// band and gain have no part. Throws std::invalid_argument.
    Engine(const std::vector<Stroke>& strokes, const Parameters& p)
        : impl_(detail::make_impl(strokes, exactly(p))), parameters_(exactly(p)) {}

    /// A mesh, rendered from its triangles: rule `exact`, in space. As for a curve.
    Engine(const mesh::Surface& surface, const Parameters& p)
        : impl_(detail::make_impl(surface, exactly(p))), parameters_(exactly(p)) {}

    /// The engine of a bundle's fixture; include "vfplan/bundle/engine.hpp". Throws
    /// std::invalid_argument for one without rendering, and, unless it is used for a replay, for
    /// one whose ticks may take longer than a loop of 1 kHz can wait. Without a rule it takes
    /// bundle::best_rule.
    explicit Engine(const bundle::Fixture& fixture, std::optional<Rule> rule = std::nullopt,
                    Use use = Use::real_time);

    /// Of rule robust in space, before the first tick: its points are samples of this mesh. Where
    /// that is closed, a start under its skin is led out of the body, until an edit.
    void set_skin(const mesh::Surface& surface) {
        mesh::check(surface);
        if (impl_) impl_->set_skin(surface);
    }

    /// Of engines that no loop steps.
    Engine(Engine&&) noexcept = default;
    Engine& operator=(Engine&&) noexcept = default;

    /// Puts the proxy at `hip` [m], wherever that is. A bad HIP (not finite, or beyond 1e6 m)
    /// leaves it unplaced: the first good one of a step is then its start.
    void reset(const Vec3& hip) noexcept {
        if (!impl_) return;
        last_ = {};
        gate_.reset(hip);
        for (bool may_exchange = true; apply_next(may_exchange);) continue;
        changes_->force_ramp.stop();
        if (previous_) changes_->retire(previous_.release());
        impl_->reset(hip);
    }

    /// One servo tick. An engine that was given away answers `bad_hip` and no force.
    Step step(const Vec3& hip) noexcept {
        if (!impl_) return {.status = Status::bad_hip};
        bool may_exchange = true;
        for (int i = 0; i < detail::PendingChanges::max_a_tick; ++i)
            if (!apply_next(may_exchange)) break;
        const bool jumps = gate_.refuses(hip, impl_->parameters.max_hip_step);
        Step s = impl_->step(jumps ? HipGate::nowhere : hip);
        if (jumps) s.status = Status::jumped;
        if (s.status & (Status::bad_hip | Status::jumped)) {
            if (last_.is_placed) std::tie(s.proxy, s.force) = std::tie(last_.proxy, last_.force);
            return s;
        }
        if (last_.is_placed)
            changes_->force_ramp.limit_force(s, impl_->parameters, last_.force,
                                             norm(hip - gate_.last));
        if (previous_ && !(s.status & Status::inside)) changes_->retire(previous_.release());
        last_ = {s.proxy, s.force, true};
        gate_.reset(hip);
        return s;
    }

    /// Hands `other`, made by the same thread and then given away, to the loop; false, and nothing
    /// done, where 4096 changes wait. The proxy goes on from where it is.
    bool exchange(Engine&& other) {
        other.check_given();
        if (changes().queue.free_slots() == 0) return false;
        other.reset(HipGate::nowhere);
        numbers_ = std::move(other.numbers_);
        parameters_ = other.parameters_;
        changes_->queue.push({detail::PendingChange::exchange, other.impl_.release(), 0, {}});
        other.changes_.reset();
        return true;
    }

    /// Changes the diagonal of K [N/m]; false, and nothing done, where 4096 changes wait.
    bool set_stiffness(const Vec3& k) {
        check_stiffness(k);
        if (!changes().queue.push({detail::PendingChange::stiffness, nullptr, 0, k})) return false;
        parameters_.stiffness = k;
        return true;
    }

    /// Takes the points of the n numbers in `remove` away and adds m; of an engine made with
    /// Search::editable. Points are numbered as they were given, those added go on from there.
    /// False where the loop does not take up what waits: the edit is kept and goes with the next,
    /// or with `remake`. Throws std::invalid_argument, and changes nothing, for what it cannot do.
    bool edit(const std::uint32_t* remove, std::size_t n, const double* add, std::size_t m) {
        if (!numbers_) reject("the points of this engine cannot be edited: Search::editable");
        auto& c = changes();
        const bool fits = parameters_.rule == Rule::robust && numbers_->fits_in_place(m);
        const std::vector<detail::PendingChange> all =
            numbers_->edit(remove, n, add, m, parameters_);
        if (fits && all.size() <= max_edit_in_place && c.queue.push(all.data(), all.size()))
            return true;
        return remake();
    }
    /// Makes the engine of an edited cloud anew and hands it over, as `edit` does when there is
    /// much to tidy up.
    bool remake() {
        if (!numbers_) reject("the points of this engine cannot be edited: Search::editable");
        auto& c = changes();
        numbers_->mark_behind();
        if (c.queue.free_slots() == 0) return false;
        const std::vector<double> left = numbers_->points_left();
        numbers_->renumber();
        detail::EngineImpl* const made = make_impl(left.data(), numbers_->size()).release();
        return c.queue.push({detail::PendingChange::exchange, made, 0, {}});
    }
    /// Deletes the engines that the loop has given back; the calls above do too.
    void collect() { changes(); }
    /// Number of changes that the loop has taken up: an exchange, a point that went or came, is
    /// one.
    std::uint64_t changes_applied() const noexcept {
        return changes_ ? changes_->applied.load(std::memory_order_relaxed) : 0;
    }
    /// The editor's: number of changes handed over that the loop has not taken up.
    std::size_t changes_pending() const noexcept { return changes_ ? changes_->queue.size() : 0; }

    /// R of what the loop renders [m].
    double radius() const noexcept { return impl_ ? impl_->parameters.R() : 0; }
    /// How far below R the proxy may be [m]: of a mesh, also what its smooth body takes.
    double band() const noexcept { return impl_ ? impl_->parameters.band : 0; }
    /// Memory in use [bytes]; while no loop steps.
    std::size_t bytes() const noexcept { return impl_ ? impl_->bytes() + changes_->bytes() : 0; }
    /// Cells of the grid; 0 without one.
    std::size_t cells() const noexcept { return impl_ ? impl_->cells() : 0; }
    bool planar() const noexcept { return impl_ && impl_->parameters.ignore_axis; }
    /// What it was made with: of the thread that edits, as handed over last.
    const Parameters& parameters() const noexcept { return parameters_; }
    /// Distance from x to the nearest geometry, or `reach` where that is less [m]: the same on both
    /// sides of a drawn line; infinity of an engine that was given away.
    double distance(const Vec3& x, double reach = infinity) const noexcept {
        return impl_ ? impl_->distance(x, reach, nullptr) : infinity;
    }
    /// Whether it was given to `exchange`, or moved from.
    bool was_exchanged() const noexcept { return !changes_; }

  private:
    struct LastTick {
        Vec3 proxy, force;
        bool is_placed = false;
    };

    static Parameters exactly(Parameters p) {
        p.rule = Rule::exact;
        return p;
    }
    detail::ImplPtr make_impl(const double* xyz, std::size_t n) const {
        Parameters p = parameters_;
        const bool is_small = n < detail::PointNumbers::min_to_edit;
        if (p.search == Search::editable && (is_small || p.rule == Rule::paper))
            p.search = Search::automatic;
        return detail::make_impl(xyz, n, p);
    }

    void check_given() const {
        if (!changes_) reject("this engine was given away, and renders nothing. Make another one.");
    }
    /// The editor's: what it has for the loop, without what the loop gave back.
    detail::PendingChanges& changes() {
        check_given();
        changes_->delete_retired();
        changes_->reserve();
        return *changes_;
    }

    /// The loop's: takes up the oldest change; false when there is none, or it waits. Below a
    /// placed proxy a tick takes up one exchange, where it `may_exchange`. That waits until the way
    /// out that one before began is known; and until that is gone, where one tick does not suffice
    /// to look at what comes next.
    bool apply_next(bool& may_exchange) noexcept {
        detail::PendingChanges& changes = *changes_;
        const detail::PendingChange* change = changes.queue.front();
        if (!change) return false;
        const double stiffness = impl_->parameters.stiffest();
        if (change->what == detail::PendingChange::exchange) {
            if (last_.is_placed && !std::exchange(may_exchange, false)) return false;
            // While the proxy is on its way out, its side is the one that it had before. Where what
            // comes next has gone beyond it, it goes on from where it would come out.
            if (previous_ && last_.is_placed) {
                detail::EngineImpl& next = *change->engine;
                next.look.begin(detail::EngineImpl::look_steps);
                Vec3 from = last_.proxy;
                if (next.is_outside(from)) {
                    const std::optional<Vec3> end = impl_->end_of_way();
                    if (!end) return false;
                    if (!next.is_outside(*end)) from = *end;
                }
                if (next.look.is_spent()) return false;
                last_.proxy = from;
            }
            if (previous_)
                changes.retire(impl_.release());
            else
                previous_ = std::move(impl_);
            impl_.reset(change->engine);
            if (last_.is_placed) impl_->continue_from(last_.proxy, previous_.get());
        } else {
            impl_->change(*change);
        }
        if (last_.is_placed) changes.force_ramp.begin(stiffness);
        changes.applied.fetch_add(1, std::memory_order_relaxed);
        changes.queue.pop();
        return true;
    }

    detail::ImplPtr impl_;
    detail::ImplPtr previous_;  // until the proxy is out of impl_
    LastTick last_;
    HipGate gate_;  // has the last good HIP
    /// None of an engine that was given away.
    std::unique_ptr<detail::PendingChanges> changes_ = std::make_unique<detail::PendingChanges>();
    std::unique_ptr<detail::PointNumbers> numbers_;  // the editor's, as what follows
    Parameters parameters_;
};

}  // namespace vfplan::inline v1

#ifndef VFPLAN_COMPILED
#include "vfplan/engine.inl"
#endif
