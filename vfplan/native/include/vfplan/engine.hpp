// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The engine a controller holds:
//
//     vfplan::Parameters p;                       // Table I
//     vfplan::Engine engine(xyz, n, p);           // allocates; throws std::invalid_argument
//     engine.reset(hip);                          // optional: else the first HIP is the start
//     for (;;) force = engine.step(hip).force;    // never allocates, throws, locks or waits
//
// What the scene does not need is left out by type, chosen once when the engine is made.
#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "vfplan/curve/exact.hpp"
#include "vfplan/paper.hpp"
#include "vfplan/robust.hpp"
#include "vfplan/space.hpp"

namespace vfplan {

namespace bundle {
struct Fixture;
}

/// What an engine is made for: a loop of 1 kHz, or a replay or study, which can wait.
enum class Use { real_time, offline };

/// A rule in a space with a stiffness; all of it known to the compiler.
template <class S, class RuleOf, class Stiffness>
class BasicEngine {
  public:
    static constexpr int D = S::dimension;

    BasicEngine(S space, RuleOf rule, Stiffness stiffness)
        : space_(space), rule_(std::move(rule)), stiffness_(stiffness) {}

    void reset(const Vec3& hip) noexcept {
        rule_.reset();
        last_ = {};
        placed_ = good(hip);
        if (!placed_) return;
        last_.proxy = hip;
        proxy_ = space_.across(hip);
    }

    Step step(const Vec3& hip) noexcept {
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

    RuleOf& rule() noexcept { return rule_; }

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

    S space_;
    RuleOf rule_;
    Stiffness stiffness_;
    Vec<D> proxy_;
    Step last_;
    bool placed_ = false;
};

class Engine {
  public:
    /// Points of this many or fewer are looked through one by one: measured, a grid costs more.
    static constexpr std::size_t small_cloud = 64;

    /// `xyz`: n points [m], x y z of each in turn. Throws std::invalid_argument.
    Engine(const double* xyz, std::size_t n, const Parameters& p, Width width = Width::automatic) {
        check(p);
        if (p.rule == Rule::exact) reject("rule exact renders a curve, not points");
        if (p.ignore_axis)
            choose_rule(Slice(*p.ignore_axis), xyz, n, p, width);
        else
            choose_rule(Space{}, xyz, n, p, width);
    }

    /// A drawn curve, rendered as it is: rule `exact`, across p.ignore_axis. Of the parameters,
    /// band and gain have no part. Throws std::invalid_argument.
    Engine(const std::vector<Stroke>& strokes, Parameters p) {
        p.rule = Rule::exact;
        p.band = curve::ExactRule::band(p, strokes);
        check(p);
        check(strokes);
        if (!p.ignore_axis) reject("rule exact needs an ignore_axis: it is planar");
        const Slice space(*p.ignore_axis);
        curve::ExactRule rule(curve::Curve(strokes, space, p.R()), p);
        with_stiffness(p, [&](auto stiffness) {
            using Made = Lines<decltype(stiffness)>;
            made_ = std::make_unique<Made>(space, std::move(rule), stiffness);
        });
    }

    /// The engine of a bundle's fixture; include "vfplan/bundle/engine.hpp". Throws
    /// std::invalid_argument for one without rendering, and, unless it is used offline, for one
    /// whose ticks may take longer than a loop of 1 kHz can wait.
    /// Without a rule: exact where it holds lines and arcs, else robust.
    explicit Engine(const bundle::Fixture& fixture, std::optional<Rule> rule = std::nullopt,
                    Use use = Use::real_time);

    /// Puts the proxy at `hip` [m], wherever that is. A bad HIP (not finite, or beyond 1e6 m)
    /// leaves it unplaced: the first good one of a step is then its start.
    void reset(const Vec3& hip) noexcept { made_->reset(hip); }
    /// One servo loop.
    Step step(const Vec3& hip) noexcept { return made_->step(hip); }
    /// Memory held [bytes].
    std::size_t bytes() const noexcept { return made_->bytes(); }
    /// Cells of the grid; 0 without one.
    std::size_t cells() const noexcept { return made_->cells(); }
    bool planar() const noexcept { return made_->planar(); }
    /// Distance from x to the nearest point [m].
    double distance(const Vec3& x) const noexcept { return made_->distance(x); }

  private:
    struct Any {
        virtual ~Any() = default;
        virtual void reset(const Vec3&) noexcept = 0;
        virtual Step step(const Vec3&) noexcept = 0;
        virtual std::size_t bytes() noexcept = 0;
        virtual std::size_t cells() noexcept = 0;
        virtual bool planar() noexcept = 0;
        virtual double distance(const Vec3&) noexcept = 0;
    };

    template <class S, class R, class K>
    struct Some final : Any {
        S space;
        Kernels<S::dimension> kernels_;
        BasicEngine<S, R, K> engine;

        Some(S s, R rule, K k, const Kernels<S::dimension>& kernels)
            : space(s), kernels_(kernels), engine(s, std::move(rule), k) {}
        auto& search() noexcept { return engine.rule().neighbours(); }
        void reset(const Vec3& hip) noexcept override { engine.reset(hip); }
        Step step(const Vec3& hip) noexcept override { return engine.step(hip); }
        std::size_t bytes() noexcept override { return sizeof(*this) + search().bytes(); }
        std::size_t cells() noexcept override { return search().source().cells(); }
        bool planar() noexcept override { return S::dimension == 2; }
        double distance(const Vec3& at) noexcept override {
            const auto x = space.across(at);
            const auto& source = search().source();
            double least = std::numeric_limits<double>::infinity();
            const auto look = [&](const auto& s) noexcept {
                least = std::min(least, kernels_.nearest2(s, x));
            };
            if constexpr (requires { source.cell(); })
                for (double r = source.cell(), i = 0; i < 3; ++i, r *= 2) {
                    source.visit(x, r, look);
                    if (least <= r * r) return std::sqrt(least);
                }
            look(source.cloud().span(0, source.cloud().size()));
            return std::sqrt(least);
        }
    };

    template <class K>
    struct Lines final : Any {
        Slice space;
        BasicEngine<Slice, curve::ExactRule, K> engine;

        Lines(Slice s, curve::ExactRule rule, K k) : space(s), engine(s, std::move(rule), k) {}
        void reset(const Vec3& hip) noexcept override { engine.reset(hip); }
        Step step(const Vec3& hip) noexcept override { return engine.step(hip); }
        std::size_t bytes() noexcept override { return sizeof(*this) + engine.rule().bytes(); }
        std::size_t cells() noexcept override { return engine.rule().cells(); }
        bool planar() noexcept override { return true; }
        double distance(const Vec3& at) noexcept override {
            return engine.rule().distance(space.across(at));
        }
    };

    template <class S>
    void choose_rule(S space, const double* xyz, std::size_t n, const Parameters& p, Width width) {
        const auto cloud = make_cloud(space, xyz, n);
        check_resolved(p, xyz, n);
        const bool brute =
            p.search == Search::brute || (p.search == Search::automatic && n <= small_cloud);
        constexpr int D = S::dimension;
        if (p.rule == Rule::paper)
            brute ? choose_stiffness<S, PaperRule<D, AllPoints>>(space, cloud, p, width)
                  : choose_stiffness<S, PaperRule<D, Neighbours>>(space, cloud, p, width);
        else
            brute ? choose_stiffness<S, RobustRule<D, AllPoints>>(space, cloud, p, width)
                  : choose_stiffness<S, RobustRule<D, Neighbours>>(space, cloud, p, width);
    }

    template <class S, class R>
    void choose_stiffness(S space, const Cloud<S::dimension>& cloud, const Parameters& p,
                          Width width) {
        const auto loops = kernels<S::dimension>(width);
        with_stiffness(p, [&](auto stiffness) {
            using Made = Some<S, R, decltype(stiffness)>;
            made_ = std::make_unique<Made>(space, R(cloud, p, loops), stiffness, loops);
        });
    }

    template <class F>
    static void with_stiffness(const Parameters& p, F&& make) {
        const Vec3& k = p.stiffness;
        if (k[0] == k[1] && k[1] == k[2])
            make(ScalarStiffness{k[0]});
        else
            make(DiagonalStiffness{k});
    }

    std::unique_ptr<Any> made_;
};

}  // namespace vfplan
