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

#include <memory>
#include <optional>

#include "vfplan/base/vec.hpp"
#include "vfplan/cloud/density.hpp"
#include "vfplan/cloud/grid.hpp"
#include "vfplan/curve/exact.hpp"
#include "vfplan/exchange.hpp"
#include "vfplan/mesh/exact.hpp"
#include "vfplan/rules/paper.hpp"
#include "vfplan/rules/robust.hpp"

namespace vfplan {

// A rule in its space, and the same behind a type that a controller can hold.
// What the scene does not need is left out by type, chosen once when the engine is made.

namespace detail {

/// A rule in a space; both known to the compiler.
template <class S, class RuleOf>
class RuleEngine : public AnyEngine {
  public:
    static constexpr int D = S::dimension;

    RuleEngine(S space, RuleOf rule, const Parameters& p)
        : AnyEngine(std::max({p.stiffness[0], p.stiffness[1], p.stiffness[2]}), p.R(), p.band),
          space_(space),
          rule_(std::move(rule)),
          stiffness_{p.stiffness} {}

    void reset(const Vec3& hip) noexcept final {
        rule_.reset();
        last_ = {};
        placed_ = good(hip);
        if (!placed_) return;
        last_.proxy = hip;
        proxy_ = space_.across(hip);
    }

    /// The next tick begins with the proxy at `proxy`, wherever that is; out of `before` it was.
    void go_on(const Vec3& proxy, AnyEngine* before) noexcept final {
        reset(proxy);
        before_.from = proxy;
        before_.engine = before;
        before_.space = &space_;
        rule_.go_on(before ? &before_ : nullptr);
    }

    Step step(const Vec3& hip) noexcept final {
        if (!good(hip)) return refuse();
        if (!placed_) reset(hip);
        const Vec<D> h = space_.across(hip);
        const Tick<D> tick = rule_(proxy_, h);
        last_.proxy = space_.place(proxy_, hip, h);
        last_.normal = space_.direction(tick.normal);
        last_.force = stiffness_.force(space_, proxy_ - h);
        last_.state = tick.state;
        last_.status = tick.status;
        return last_;
    }
    bool planar() noexcept final { return D == 2; }

  protected:
    S space_;
    RuleOf rule_;

  private:
    static bool good(const Vec3& hip) noexcept {
        for (int k = 0; k < 3; ++k)
            if (!(std::abs(hip[k]) <= largest_coordinate)) return false;
        return true;
    }
    Step refuse() noexcept {
        Step s = last_;  // all 0 before there was any proxy: a controller is never given a NaN
        s.status = bad_hip;
        return s;
    }

    Stiffness stiffness_;
    Before<S> before_;
    Vec<D> proxy_;
    Step last_;
    bool placed_ = false;
};

/// Points of this many or fewer are looked through one by one: measured, a grid costs more.
inline constexpr std::size_t small_cloud = 64;

/// Points.
template <class S, class R>
class Some final : public RuleEngine<S, R> {
  public:
    static constexpr bool editable = requires(R& rule) { rule.neighbours().source().remove(0); };
    using All = std::unique_ptr<Grid<S::dimension>>;

    /// `all`: the points, where the rule has not all of them.
    Some(S s, R rule, const Parameters& p, const Kernels<S::dimension>& kernels, All all)
        : RuleEngine<S, R>(s, std::move(rule), p), kernels_(kernels), all_(std::move(all)) {}
    void remove(std::size_t id) noexcept override {
        if constexpr (editable) this->rule_.edited(source().remove(id), false);
    }
    void add(const Vec3& point) noexcept override {
        if constexpr (editable) {
            const auto p = this->space_.across(point);
            source().add(p);
            this->rule_.edited(p, true);
        }
    }
    std::size_t bytes() noexcept override {
        return sizeof(*this) + this->rule_.neighbours().bytes() + (all_ ? all_->bytes() : 0);
    }
    std::size_t cells() noexcept override { return source().cells(); }
    double within(const Vec3& at, double reach) noexcept override {
        return within(source(), at, reach);
    }
    double distance(const Vec3& at) noexcept override {
        return all_ ? distance(*all_, at) : distance(source(), at);
    }

  private:
    auto& source() noexcept { return this->rule_.neighbours().source(); }
    template <class Source>
    double within(Source& source, const Vec3& at, double reach) noexcept {
        const auto x = this->space_.across(at);
        return std::sqrt(std::min(reach * reach, nearest2(source, kernels_, x, reach)));
    }
    template <class Source>
    double distance(Source& source, const Vec3& at) noexcept {
        if constexpr (requires { source.cell(); })
            for (double r = source.cell(), i = 0; i < 3; ++i, r *= 2)
                if (const double d = within(source, at, r); d < r) return d;
        return within(source, at, std::numeric_limits<double>::infinity());
    }

    Kernels<S::dimension> kernels_;
    All all_;
};

/// Lines and arcs, or triangles, as they are.
template <class S, class R>
struct Exact final : RuleEngine<S, R> {
    using RuleEngine<S, R>::RuleEngine;
    std::size_t bytes() noexcept override { return sizeof(*this) + this->rule_.bytes(); }
    std::size_t cells() noexcept override { return this->rule_.cells(); }
    double distance(const Vec3& at) noexcept override {
        return this->rule_.distance(this->space_.across(at));
    }
    double within(const Vec3& at, double reach) noexcept override {
        return std::min(distance(at), reach);
    }
};

using Made = std::unique_ptr<AnyEngine>;

template <class R, class S, class C>
Made with_rule(S space, const C& cloud, const Parameters& p, Width width,
               std::unique_ptr<Grid<S::dimension>> all = nullptr) {
    const auto loops = kernels<S::dimension>(width);
    return std::make_unique<Some<S, R>>(space, R(cloud, p, loops), p, loops, std::move(all));
}

template <class S>
Made in_space(S space, const double* xyz, std::size_t n, const Parameters& p, Width width) {
    constexpr int D = S::dimension;
    auto cloud = make_cloud(space, xyz, n);
    check_resolved(p, xyz, n);
    const bool brute =
        p.search == Search::brute || (p.search == Search::automatic && n <= small_cloud);
    if (p.rule == Rule::paper)
        return brute ? with_rule<PaperRule<D, AllPoints>>(space, cloud, p, width)
                     : with_rule<PaperRule<D, Neighbours>>(space, cloud, p, width);
    const auto kept = thinned(cloud, p);
    auto all = kept.lent > 0 ? std::make_unique<Grid<D>>(cloud, 2 * tuned::brief * p.R()) : nullptr;
    const auto with = [&]<template <int> class Search>() {
        return with_rule<RobustRule<D, Search>>(space, kept, p, width, std::move(all));
    };
    if (p.search == Search::editable) return with.template operator()<EditedNeighbours>();
    return brute ? with.template operator()<AllPoints>() : with.template operator()<Neighbours>();
}

inline Made make(const double* xyz, std::size_t n, const Parameters& p, Width width) {
    check(p);
    if (p.rule == Rule::exact) reject("rule exact renders a curve, not points");
    return p.ignore_axis ? in_space(Slice(*p.ignore_axis), xyz, n, p, width)
                         : in_space(Space{}, xyz, n, p, width);
}

inline Made make(const std::vector<Stroke>& strokes, Parameters p) {
    p.rule = Rule::exact;
    p.band = curve::ExactRule::band(p, strokes);
    check(p);
    check(strokes);
    if (!p.ignore_axis) reject("rule exact needs an ignore_axis: it is planar");
    const Slice space(*p.ignore_axis);
    return std::make_unique<Exact<Slice, curve::ExactRule>>(
        space, curve::ExactRule(curve::Curve(strokes, space, p.R()), p), p);
}

inline Made make(const mesh::Surface& surface, Parameters p) {
    p.rule = Rule::exact;
    mesh::check(surface);
    p.band = mesh::ExactRule::band(p, surface);
    check(p);
    if (p.ignore_axis) reject("rule exact renders a mesh in space: without an ignore_axis");
    mesh::Mesh triangles(surface, mesh::ExactRule::tolerance * p.R());
    mesh::Smooth smooth(triangles, p.R());
    p.band += smooth.rise();
    return std::make_unique<Exact<Space, mesh::ExactRule>>(
        Space{}, mesh::ExactRule(std::move(triangles), std::move(smooth), p), p);
}

}  // namespace detail

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
