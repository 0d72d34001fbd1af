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
#pragma once

#include <optional>

#include "vfplan/editing.hpp"
#include "vfplan/made.hpp"

namespace vfplan {

namespace bundle {
struct Fixture;
}

/// What an engine is made for: a loop of 1 kHz, or a replay or study, which can wait.
enum class Use { real_time, offline };

class Engine {
  public:
    static constexpr std::size_t small_cloud = detail::small_cloud;
    /// An edit of more points makes the engine anew.
    static constexpr std::size_t most_at_once = detail::Changes::room / 2;

    /// `xyz`: n points [m], x y z of each in turn. Throws std::invalid_argument.
    Engine(const double* xyz, std::size_t n, const Parameters& p, Width width = Width::automatic)
        : parameters_(p), width_(width) {
        if (p.search == Search::editable) points_ = std::make_unique<detail::Points>(xyz, n);
        made_ = make(xyz, n);
    }

    /// A drawn curve, rendered as it is: rule `exact`, across p.ignore_axis. Of the parameters,
    /// band and gain have no part. Throws std::invalid_argument.
    Engine(const std::vector<Stroke>& strokes, const Parameters& p)
        : made_(detail::make(strokes, p)) {}

    /// A mesh, rendered from its triangles: rule `exact`, in space. As for a curve.
    Engine(const mesh::Surface& surface, const Parameters& p) : made_(detail::make(surface, p)) {}

    /// The engine of a bundle's fixture; include "vfplan/bundle/engine.hpp". Throws
    /// std::invalid_argument for one without rendering, and, unless it is used offline, for one
    /// whose ticks may take longer than a loop of 1 kHz can wait.
    /// Without a rule: bundle::best_rule.
    explicit Engine(const bundle::Fixture& fixture, std::optional<Rule> rule = std::nullopt,
                    Use use = Use::real_time);

    Engine(Engine&& other) noexcept { *this = std::move(other); }
    /// Neither is in a loop.
    Engine& operator=(Engine&& other) noexcept {
        if (this == &other) return *this;
        delete changes_.exchange(other.changes_.exchange(nullptr));
        made_ = std::move(other.made_);
        before_ = std::move(other.before_);
        points_ = std::move(other.points_);
        parameters_ = other.parameters_;
        width_ = other.width_;
        now_ = other.now_;
        return *this;
    }
    ~Engine() { delete changes_.load(); }

    /// Puts the proxy at `hip` [m], wherever that is. A bad HIP (not finite, or beyond 1e6 m)
    /// leaves it unplaced: the first good one of a step is then its start.
    void reset(const Vec3& hip) noexcept {
        now_ = {};
        if (auto* changes = changes_.load(std::memory_order_acquire)) {
            while (take(*changes)) continue;
            changes->pace.stop();
            if (before_) changes->retire(before_.release());
        }
        made_->reset(hip);
    }

    /// One servo loop.
    Step step(const Vec3& hip) noexcept {
        auto* changes = changes_.load(std::memory_order_acquire);
        if (changes)
            for (int i = 0; i < detail::Changes::a_tick && take(*changes); ++i) continue;
        Step s = made_->step(hip);
        if (changes) pace(*changes, s, hip);
        if (before_ && !(s.status & (inside | bad_hip))) changes->retire(before_.release());
        if (!(s.status & bad_hip)) now_ = {s.proxy, s.force, hip, true};
        return s;
    }

    /// Hands `other`, made by the same thread and then spent, to the loop; false, and nothing done,
    /// where 4096 changes wait. The proxy goes on from where it is.
    bool exchange(Engine&& other) {
        auto& c = changes();
        if (c.waiting.room() == 0) return false;
        if (auto* own = other.changes_.load())
            while (other.take(*own)) continue;
        points_ = std::move(other.points_);
        parameters_ = other.parameters_;
        width_ = other.width_;
        return c.waiting.push({detail::Change::exchange, other.made_.release(), 0, {}});
    }

    /// Takes the points of the n numbers in `remove` away and adds m; of an engine made with
    /// Search::editable. Points are numbered as they were given, those added go on from there.
    /// False where the loop does not take up what waits: the edit is kept and goes with the next,
    /// or with `remake`. Throws std::invalid_argument, and changes nothing, for what it cannot do.
    bool edit(const std::uint32_t* remove, std::size_t n, const double* add, std::size_t m) {
        if (!points_) reject("the points of this engine cannot be edited: Search::editable");
        auto& c = changes();
        const bool fits = parameters_.rule == Rule::robust && points_->fits(m);
        const auto all = points_->edit(remove, n, add, m, parameters_);
        if (!fits || all.size() > most_at_once || !c.waiting.push(all.data(), all.size()))
            return remake();
        return true;
    }
    /// Makes the engine of an edited cloud anew and hands it over, as `edit` does when there is
    /// much to tidy up.
    bool remake() {
        if (!points_) reject("the points of this engine cannot be edited: Search::editable");
        auto& c = changes();
        points_->missed();
        if (c.waiting.room() == 0) return false;
        const std::vector<double> left = points_->left();
        points_->made();
        return c.waiting.push(
            {detail::Change::exchange, make(left.data(), points_->size()).release(), 0, {}});
    }
    /// Deletes the engines that the loop has given back; the calls above do too.
    void collect() { changes(); }
    /// Changes that the loop has taken up: an exchange, a point that went or came, is one.
    std::uint64_t taken() const noexcept {
        const auto* changes = changes_.load(std::memory_order_acquire);
        return changes ? changes->taken.load(std::memory_order_relaxed) : 0;
    }

    /// The editor's: changes handed over that the loop has not taken up.
    std::size_t waiting() const noexcept {
        const auto* changes = changes_.load(std::memory_order_relaxed);
        return changes ? changes->waiting.waiting() : 0;
    }

    /// How far below R the proxy may be [m]: of a mesh, also what its smooth body takes.
    double band() const noexcept { return made_->band; }
    /// Memory held [bytes].
    std::size_t bytes() const noexcept { return made_->bytes(); }
    /// Cells of the grid; 0 without one.
    std::size_t cells() const noexcept { return made_->cells(); }
    bool planar() const noexcept { return made_->planar(); }
    /// Distance from x to the nearest point [m].
    double distance(const Vec3& x) const noexcept { return made_->distance(x); }
    /// Whether it was given to `exchange`.
    bool spent() const noexcept { return !made_; }

  private:
    struct Now {
        Vec3 proxy, force, hip;
        bool placed = false;
    };

    detail::Made make(const double* xyz, std::size_t n) const {
        Parameters p = parameters_;
        const bool few = n < detail::Points::worth_editing;
        if (p.search == Search::editable && (few || p.rule == Rule::paper))
            p.search = Search::automatic;
        return detail::make(xyz, n, p, width_);
    }

    /// The editor's: what it has for the loop, without what the loop gave back.
    detail::Changes& changes() {
        auto* changes = changes_.load(std::memory_order_relaxed);
        if (!changes) {
            changes = new detail::Changes;
            changes_.store(changes, std::memory_order_release);
        }
        changes->collect();
        return *changes;
    }

    /// The loop's: takes up the oldest change; false when there is none.
    bool take(detail::Changes& changes) noexcept {
        const detail::Change* change = changes.waiting.front();
        if (!change) return false;
        if (change->kind == detail::Change::exchange) {
            // While the proxy is on its way out, its side is the one that it had before.
            if (before_) changes.retire(made_.release());
            if (!before_) before_ = std::move(made_);
            made_.reset(change->engine);
            if (now_.placed) made_->go_on(now_.proxy, before_.get());
        } else if (change->kind == detail::Change::add) {
            made_->add(change->point);
        } else {
            made_->remove(change->id);
        }
        if (now_.placed) changes.pace.begin();
        changes.taken.fetch_add(1, std::memory_order_relaxed);
        changes.waiting.pop();
        return true;
    }

    void pace(detail::Changes& changes, Step& s, const Vec3& hip) noexcept {
        if (s.status & bad_hip) {
            s.proxy = now_.proxy;
            s.force = now_.force;
        } else if (now_.placed) {
            changes.pace(s, *made_, now_.force, norm(hip - now_.hip));
        }
    }

    detail::Made made_, before_;  // before_: until the proxy is out of made_
    Now now_;
    std::atomic<detail::Changes*> changes_{nullptr};
    std::unique_ptr<detail::Points> points_;  // the editor's, as what follows
    Parameters parameters_;
    Width width_ = Width::automatic;
};

}  // namespace vfplan
