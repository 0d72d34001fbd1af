// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What a bundle asks for: a forbidden region, a guide, or both at once, whose forces add.
#pragma once

#include <algorithm>
#include <optional>

#include "vfplan/bundle/engine.hpp"

namespace controller {

class Rendered {
  public:
    Rendered(const vfplan::bundle::Fixture& fixture, const vfplan::Parameters& p, vfplan::Use use) {
        if (use == vfplan::Use::real_time) vfplan::bundle::check_work(fixture, p);
        const auto forbidden = fixture.forbidden();
        if (p.rule == vfplan::Rule::exact)
            region_.emplace(fixture.guidance
                                ? vfplan::Engine(fixture.pieces_of(false), p)
                                : vfplan::bundle::make_engine(fixture, p, vfplan::Use::replay));
        else if (!forbidden.empty())
            region_.emplace(forbidden.data(), forbidden.size() / 3, p);
        if (region_) stiffness_ = std::max({p.stiffness[0], p.stiffness[1], p.stiffness[2]});
        if (fixture.guidance) {
            guide_.emplace(vfplan::bundle::make_guide(fixture));
            stiffness_ += fixture.guidance->stiffness;
        }
    }

    /// Of the forbidden strokes; not of a fixture that only guides.
    [[nodiscard]] vfplan::Engine& region() { return *region_; }
    [[nodiscard]] std::uint64_t taken() const noexcept {
        return region_ ? region_->changes_applied() : 0;
    }
    /// Of all springs together, at most [N/m].
    [[nodiscard]] double stiffness() const { return stiffness_; }

    void reset(const vfplan::Vec3& tip) noexcept {
        if (region_) region_->reset(tip);
        if (guide_) guide_->reset(tip);
    }
    /// The region's answer with both forces; of a guide alone its own.
    vfplan::Step step(const vfplan::Vec3& tip) noexcept {
        vfplan::Step step;
        if (region_) step = region_->step(tip);
        if (!guide_) return step;
        const vfplan::GuideStep guided = guide_->step(tip);
        if (region_) {
            step.force = step.force + guided.force;
            return step;
        }
        step.proxy = guided.proxy;
        step.force = guided.force;
        step.status = guided.status;
        if (guided.held) step.state = vfplan::State::free_motion;
        if (norm(guided.force) > 0) {
            step.state = vfplan::State::in_contact;
            step.normal = along(guided.force, 1);
        }
        return step;
    }

  private:
    std::optional<vfplan::Engine> region_;
    std::optional<vfplan::Guide> guide_;
    double stiffness_ = 0;
};

}  // namespace controller
