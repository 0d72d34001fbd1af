// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What controller.hpp, which includes this, declares. With VFPLAN_SIGNED it checks signatures, by
// OpenSSL.
#pragma once

#include "vfplan/bundle/engine.hpp"
#ifdef VFPLAN_SIGNED
#include "vfplan/bundle/trust.hpp"
#endif

namespace vfplan::inline v1 {

namespace detail {

/// The bundle, signed by one of the keys where there are some.
inline bundle::Fixture load_signed(bundle::View data, const Demand& demand) {
    if (demand.keys.empty()) {
        if (demand.case_id || demand.robot_serial || demand.max_age_s || !demand.accept_unsigned)
            bundle::detail::refuse("signature.missing", "", {"comes without keys to check it with"},
                                   "Name the keys in Demand::keys, or accept_unsigned alone");
        return bundle::to_fixture(bundle::read_bundle(data));
    }
#ifdef VFPLAN_SIGNED
    bundle::Trust trust{{}, demand.case_id, demand.robot_serial, {}};
    for (const auto& path : demand.keys)
        for (auto& key : bundle::read_keys(path)) trust.keys.push_back(std::move(key));
    if (demand.max_age_s) {
        check_from("max_age_s", *demand.max_age_s, 0, 1e15, " s");
        trust.max_age = std::chrono::seconds(static_cast<std::int64_t>(*demand.max_age_s));
    }
    return bundle::to_fixture(bundle::read_bundle(data, trust));
#else
    bundle::detail::refuse("signature.missing", "", {"cannot be checked: built without OpenSSL"},
                           "Install OpenSSL (libssl-dev), and build vfplan again");
#endif
}

inline void check_frame(const bundle::Fixture& fixture) {
    bundle::detail::require(
        fixture.frame == "robot_base", "unsafe.frame", "",
        {"is in the frame ", bundle::Quoted{fixture.frame}, ", and the arm moves in robot_base"},
        "Register it first: vfplan register");
}

inline void check(const bundle::Fixture& fixture, const Demand& demand) {
    check_frame(fixture);
    const std::string tool = demand.tool.value_or(fixture.tool);
    using bundle::detail::require, bundle::Quoted;
    require(fixture.tool == tool, "unsafe.tool", "",
            {"names ", Quoted{fixture.tool}, " as the tool that touched the markers, and ",
             Quoted{tool}, " is demanded"},
            "Touch them with this tool, and give plan its file by --tip");
    require(fixture.reviewed || demand.accept_unreviewed, "unsafe.review", "",
            {"was approved by nobody"}, "Approve it with `vfplan review`, or accept_unreviewed");
    require(fixture.findings_unanswered == 0 || demand.accept_doubts, "unsafe.findings", "",
            {"has open findings of its planning: ", fixture.findings_unanswered},
            "Answer them with `vfplan review`, or accept_doubts");
}

/// What a fixture asks for: a forbidden region, a guide, or both at once, whose forces add.
class Rendered {
  public:
    Rendered(const bundle::Fixture& fixture, const Parameters& p, Use use)
        : parameters(p), fixture_(fixture) {
        if (use == Use::real_time) bundle::check_work(fixture, p);
        const bool forbids = !fixture.guidance || fixture.guidance->stroke;
        if (forbids || p.rule == Rule::exact) region.emplace(bundle::region_of(fixture, p));
        if (fixture.guidance) guide.emplace(bundle::make_guide(fixture, p.period));
    }

    /// Of both springs together, at most [N/m].
    double stiffness() const noexcept {
        return (region ? parameters.stiffest() : 0) + (guide ? guide->parameters().stiffness : 0);
    }
    /// The bundle's K, which was reviewed and signed, where it is least [N/m].
    double stiffness_of_bundle() const noexcept {
        return *std::ranges::min_element(fixture_.rendering->stiffness.c);
    }
    /// Renders what another one renders, whose engine takes the place of this one's; false where
    /// too many changes wait.
    bool exchange(Rendered&& other) {
        if (!region->exchange(std::move(*other.region))) return false;
        parameters = other.parameters;
        fixture_ = std::move(other.fixture_);
        return true;
    }
    /// Whether the same is felt.
    bool is_same(const bundle::Fixture& other, const Parameters& p) const {
        return fixture_.points == other.points && fixture_.mesh == other.mesh &&
               fixture_.pieces == other.pieces && fixture_.guidance == other.guidance &&
               parameters == p;
    }

    /// Begins here. True where a wall lies on the straight way from the last proxy, unless the
    /// reset before said so too: who resets again means it.
    bool reset(const Vec3& tip) noexcept {
        if (guide) guide->reset(tip);
        if (!region) return false;
        region->reset(tip);  // with the fixture that it was exchanged for
        is_beyond_ = !is_beyond_ && last_proxy_ && is_behind_wall(tip);
        if (region->distance(tip) >= free_distance()) last_proxy_ = tip;
        return is_beyond_;
    }
    /// The region's answer with both forces; of a guide alone its own.
    Step step(const Vec3& tip) noexcept {
        Step step;
        if (region) {
            step = region->step(tip);
            if (!(step.status & (Status::bad_hip | Status::inside))) last_proxy_ = step.proxy;
        }
        if (!guide) return step;
        const GuideStep guided = guide->step(tip);
        if (region) {
            if (dot(step.force, guided.force) < 0) step.status |= Status::capped;
            step.force = step.force + guided.force;
            return step;
        }
        std::tie(step.proxy, step.force, step.status) =
            std::tie(guided.proxy, guided.force, guided.status);
        if (guided.held) step.state = State::free_motion;
        if (norm(guided.force) > 0) {
            step.state = State::in_contact;
            step.normal = along(guided.force, 1);
        }
        return step;
    }

    std::optional<Engine> region;
    std::optional<Guide> guide;
    Parameters parameters;
    Vec3 force;  // of the last tick

  private:
    /// From the geometry to a proxy that is outside [m].
    double free_distance() const noexcept { return region->radius() - 2 * region->band(); }
    /// Whether the straight way from the last proxy comes nearer to the wall than its end is. A
    /// tick has time for so many looks, each to 4 R: a way along a wall is 32 R long at most.
    bool is_behind_wall(const Vec3& tip) const noexcept {
        constexpr int max_looks = 256;
        const double R = region->radius();
        const auto distance = [&](const Vec3& x) { return region->distance(x, 4 * R); };
        const double nearest = std::min(free_distance(), distance(tip) - R / 32);
        const double length = norm(tip - *last_proxy_);
        const Vec3 way = along(tip - *last_proxy_, 1);
        double t = 0;
        for (int i = 0; i < max_looks && t < length; ++i) {
            const double at = distance(*last_proxy_ + t * way);
            if (at < nearest) return true;
            t += std::max(at - free_distance(), R / 8);
        }
        return t < length;
    }

    bundle::Fixture fixture_;
    std::optional<Vec3> last_proxy_;  // of the region, outside
    bool is_beyond_ = false;          // the last reset was, from there
};

/// All fixtures together, in their frame: what a MovingFrame takes for an engine.
struct AllRendered {
    AllRendered(Rendered first, double max_hip_step) : max_hip_step(max_hip_step) {
        parts.push_back(std::move(first));
    }

    std::vector<Rendered> parts;
    double max_hip_step;
    HipGate gate;
    bool is_beyond = false;  // the last reset was, from where the proxy had been

    /// Without a place nothing is forgotten: else the next one could be beyond a wall, untold.
    void reset(const Vec3& tip) noexcept {
        if (!is_within_range(tip)) return;
        gate.reset(tip);
        is_beyond = false;
        for (Rendered& part : parts) is_beyond |= part.reset(tip);
    }
    /// Forces and bits of all; the rest is of the one that pushes most.
    Step step(const Vec3& tip) noexcept {
        const bool jumps = gate.refuses(tip, max_hip_step);
        Step all;
        Vec3 force;
        std::uint8_t status = Status::ok;
        for (Rendered& part : parts) {
            const bool is_first = &part == parts.data();
            const Step s = part.step(jumps ? HipGate::nowhere : tip);
            part.force = s.force;
            force = is_first ? s.force : force + s.force;
            status |= s.status;
            if (is_first || norm(s.force) > norm(all.force)) all = s;
        }
        // Of a force less arrives where another one pushes against it, by more than rounding.
        for (const Rendered& part : parts)
            if (dot(force, part.force) < (1 - 1e-9) * dot(part.force, part.force))
                status |= Status::capped;
        all.force = force;
        all.status = jumps ? std::uint8_t{Status::jumped} : status;
        if (!jumps && !(status & Status::bad_hip)) gate.reset(tip);
        if (is_beyond) all.status |= Status::other_side;
        return all;
    }
};

struct ControllerImpl {
    ControllerImpl(const bundle::Fixture& fixture, const Demand& demand,
                   const ControllerSettings& settings)
        : demand(demand),
          settings(checked(settings)),
          all(make(fixture), settings.max_hip_step),
          governor(governor_of(stiffness())) {
        if (settings.moving) frame = std::make_unique<MovingFrame>(*settings.moving);
    }

    static const ControllerSettings& checked(const ControllerSettings& settings) {
        check_from("hold_time", settings.hold_time, 0, 1, " s");
        if (settings.max_stiffness != 0)
            check_above("max_stiffness", settings.max_stiffness, 0, infinity, " N/m");
        check_hip_step(settings.max_hip_step);
        if ((settings.stop_at & no_position) != no_position)
            reject("stop_at lacks bad_hip or jumped. Give both: without the tip a loop stops.");
        if (settings.stop_at & Status::capped)
            reject("stop_at has capped. Give it without: look for that bit in Command::status.");
        return settings;
    }
    Parameters parameters(const bundle::Fixture& fixture) const {
        Parameters p = bundle::parameters(fixture, settings.rule);
        p.max_hip_step = 0;  // the gate has looked at it
        p.period = settings.governor.period;
        p.search = settings.search;
        return p;
    }
    Rendered make(const bundle::Fixture& fixture) const {
        check_frame(fixture);
        return {fixture, parameters(fixture),
                settings.any_tick_time ? Use::replay : Use::real_time};
    }
    void add(const bundle::Fixture& fixture) {
        const Parameters p = parameters(fixture);
        for (const Rendered& part : all.parts)
            if (part.is_same(fixture, p)) return;
        Rendered made = make(fixture);
        governor.take_limits(governor_of(stiffness() + made.stiffness()));
        all.parts.push_back(std::move(made));
    }
    /// Throws OutOfRange for a number that no fixture has.
    Rendered& part(std::size_t which) {
        check_from("which", double(which), 0, double(all.parts.size() - 1), "",
                   "fixtures are numbered from 0 as they were added");
        return all.parts[which];
    }
    Engine& region(std::size_t which) {
        auto& region = part(which).region;
        if (!region) reject("the fixture guides, and has no region to change.");
        return *region;
    }
    bool exchange(Rendered&& made, std::size_t which) {
        Rendered& old = part(which);
        if (made.guide || old.guide)
            reject("a fixture that guides cannot be exchanged. Make a controller of each.");
        governor_of(stiffness() - old.stiffness() + made.stiffness());
        return old.exchange(std::move(made));
    }
    /// Throws std::invalid_argument unless the only fixture of this controller has met all that
    /// another one demands of it.
    void check_meets(const ControllerImpl& other) const {
        const auto is_as_demanded = [](const auto& has, const auto& demanded) {
            return !demanded || has == demanded;
        };
        const auto is_taken = [&](const auto& key) {
            return std::ranges::find(other.demand.keys, key) != other.demand.keys.end();
        };
        const Demand &has = demand, &demanded = other.demand;
        const bool is_signed = !has.keys.empty(),
                   has_keys = std::ranges::all_of(has.keys, is_taken);
        const bool is_young = has.max_age_s && *has.max_age_s <= demanded.max_age_s;
        const Search search = other.settings.search;
        const std::pair<const char*, bool> met[]{
            {"keys", demanded.keys.empty() || (is_signed && has_keys)},
            {"accept_unsigned", is_signed || has.accept_unsigned <= demanded.accept_unsigned},
            {"case_id", is_as_demanded(has.case_id, demanded.case_id)},
            {"robot_serial", is_as_demanded(has.robot_serial, demanded.robot_serial)},
            {"max_age_s", !demanded.max_age_s || is_young},
            {"tool", is_as_demanded(has.tool, demanded.tool)},
            {"accept_unreviewed", has.accept_unreviewed <= demanded.accept_unreviewed},
            {"accept_doubts", has.accept_doubts <= demanded.accept_doubts},
            {"any_tick_time", settings.any_tick_time <= other.settings.any_tick_time},
            {"period", settings.governor.period == other.settings.governor.period},
            {"max_stiffness", settings.max_stiffness <= other.settings.max_stiffness},
            {"search", search != Search::editable || settings.search == Search::editable},
            {"size: it has more fixtures than one", all.parts.size() == 1}};
        for (const auto& [what, is_good] : met)
            if (!is_good)
                reject("exchange for a controller that differs in " + std::string(what) +
                       ". Make it with the demands and settings of the one that takes it.");
    }
    /// Throws std::invalid_argument where it would not be passive.
    Governor governor_of(double stiffness) const {
        GovernorLimits limits = settings.governor;
        limits.stiffness = std::max(stiffness, settings.max_stiffness);
        return Governor(limits);
    }
    double stiffness() const noexcept {
        double sum = 0;
        for (const Rendered& part : all.parts) sum += part.stiffness();
        return sum;
    }

    static Vec3 checked(const Vec3& tip) noexcept {
        return norm(tip) <= largest_distance ? tip : HipGate::nowhere;
    }
    void reset(const Vec3& given) noexcept {
        const Vec3 tip = checked(given);
        if (!is_within_range(tip)) {
            stopping |= Status::bad_hip;  // nothing begins anew, and a loop would not know it
            return;
        }
        waiting.reset(tip);
        has_waited = false;
        if (frame)
            frame->restart();
        else
            all.reset(tip);
        governor.reset();
        stopping = 0;
        bad_ticks = 0;
        joints = 0;
    }
    /// `govern`: the governor's tick for a force.
    template <class F>
    Command step(const Vec3& tip, const std::optional<double>& time_s, const F& govern) noexcept {
        time = time_s ? *time_s : time + settings.governor.period;
        const Vec3 hip = checked(tip);
        if (frame && waiting.has_last) begin_at_pose(hip);
        const Step s = frame ? frame->step(all, time, hip) : all.step(hip);
        note_stops(s.status);
        const Governed governed = govern(stopping ? Vec3{} : s.force);
        using Says = GovernorStatus;
        const int not_commanded = Says::bad_force | Says::bad_jacobian | Says::no_jacobian;
        stopping |= std::uint16_t((governed.status & not_commanded) << 8);
        const std::uint8_t status = s.status | (governed.is_capped ? Status::capped : Status::ok);
        Command out{governed.force, s.force,         s.proxy,  s.normal, s.state,
                    status,         governed.status, stopping, false};
        out.stop = stopping && governed.force == Vec3{} && !(joints && governor.has_torque());
        return out;
    }
    /// A fixture that moves begins at its first pose: with the tip where the reset was, or where it
    /// has gone since in ticks that rendered nothing.
    void begin_at_pose(const Vec3& hip) noexcept {
        frame->at(time);
        const bool is_good = is_within_range(hip) && !waiting.refuses(hip, settings.max_hip_step);
        if (std::exchange(has_waited, true) && is_good) waiting.last = hip;
        if (!frame->placed()) return;
        all.reset(frame->now().in(waiting.last));
        waiting.has_last = false;
    }
    void note_stops(std::uint8_t status) noexcept {
        const std::uint8_t bits = status & settings.stop_at;
        stopping |= bits & ~no_position;
        bad_ticks = (status & no_position) ? bad_ticks + 1 : std::max(bad_ticks - recovery, 0.0);
        if (bad_ticks * settings.governor.period > settings.hold_time) stopping |= bits;
        stopping |= asked.exchange(0, std::memory_order_relaxed);
    }

    static constexpr std::uint8_t no_position = Status::bad_hip | Status::jumped;
    /// Ticks without a position that a good one makes up for: more than one in eleven stops a loop.
    static constexpr double recovery = 0.1;

    Demand demand;
    ControllerSettings settings;
    AllRendered all;
    std::unique_ptr<MovingFrame> frame;
    HipGate waiting;          // since a reset, for a pose of the frame
    bool has_waited = false;  // for a tick
    Governor governor;
    std::atomic<std::uint16_t> asked{0};  // bits of `stopping`, from outside of the loop
    double time = 0;                      // [s]
    double bad_ticks = 0;        // without a good position, less `recovery` for each good one
    std::uint16_t stopping = 0;  // as in Command
    int joints = 0;              // of the Jacobians since the reset
};

/// Of a controller that was moved from.
inline constexpr Command command_of_nothing{
    .status = Status::bad_hip, .stopping = Status::bad_hip, .stop = true};

}  // namespace detail

VFPLAN_ONCE bundle::Fixture load(const std::filesystem::path& path, const Demand& demand) {
    return bundle::of_file(path, [&](bundle::View data) {
        bundle::Fixture fixture = detail::load_signed(data, demand);
        detail::check(fixture, demand);
        return fixture;
    });
}

VFPLAN_ONCE Controller::Controller(const std::filesystem::path& fixture, const Demand& demand,
                                   const ControllerSettings& settings)
    : Controller(load(fixture, demand), demand, settings) {}
VFPLAN_ONCE Controller::Controller(const bundle::Fixture& fixture, const Demand& demand,
                                   const ControllerSettings& settings)
    : impl_(std::make_shared<detail::ControllerImpl>(fixture, demand, settings)) {}

VFPLAN_ONCE detail::ControllerImpl& Controller::impl() const {
    if (!impl_) reject("this controller was moved from, and holds nothing. Make another one.");
    return *impl_;
}

VFPLAN_ONCE void Controller::add(const std::filesystem::path& fixture) {
    add(load(fixture, impl().demand));
}
VFPLAN_ONCE void Controller::add(const bundle::Fixture& fixture) { impl().add(fixture); }

VFPLAN_ONCE void Controller::reset(const Vec3& tip) noexcept {
    if (impl_) impl_->reset(tip);
}
VFPLAN_ONCE Command Controller::step(const Vec3& tip, std::optional<double> time_s) noexcept {
    if (!impl_) return detail::command_of_nothing;
    if (impl_->joints) return step(tip, time_s, nullptr, 0);  // an arm that takes torques
    return impl_->step(tip, time_s, [&](const Vec3& f) { return impl_->governor.step(f); });
}
VFPLAN_ONCE Command Controller::step(const Vec3& tip, std::optional<double> time_s,
                                     const double* jacobian, int joints) noexcept {
    if (!impl_) return detail::command_of_nothing;
    if (!impl_->joints) impl_->joints = joints;
    const int n = joints == impl_->joints ? joints : 0;  // another arm's is none
    return impl_->step(tip, time_s,
                       [&](const Vec3& f) { return impl_->governor.step(f, jacobian, n); });
}
VFPLAN_ONCE const double* Controller::torque() const noexcept {
    static constexpr double none[Governor::max_joints] = {};
    return impl_ ? impl_->governor.torque() : none;
}
VFPLAN_ONCE void Controller::request_stop() noexcept {
    if (impl_) impl_->asked.fetch_or(asked, std::memory_order_relaxed);
}

VFPLAN_ONCE bool Controller::pose(double stamp, const Pose& pose) noexcept {
    if (impl_ && !impl_->frame)
        impl_->asked.fetch_or(Status::stale_pose, std::memory_order_relaxed);
    return impl_ && impl_->frame && impl_->frame->pose(stamp, pose);
}
VFPLAN_ONCE void Controller::take_poses(double time_s) noexcept {
    if (impl_ && impl_->frame) impl_->frame->at(time_s);
}
VFPLAN_ONCE bool Controller::exchange(const std::filesystem::path& fixture, std::size_t which) {
    return exchange(load(fixture, impl().demand), which);
}
VFPLAN_ONCE bool Controller::exchange(const bundle::Fixture& fixture, std::size_t which) {
    return impl().exchange(impl_->make(fixture), which);
}
VFPLAN_ONCE bool Controller::exchange(Controller&& other, std::size_t which) {
    if (this == &other) reject("exchange of a fixture for itself. Make another controller.");
    other.impl().check_meets(impl());
    return impl().exchange(std::move(other.impl().all.parts[0]), which);
}
VFPLAN_ONCE bool Controller::edit(const std::uint32_t* remove, std::size_t n, const double* add,
                                  std::size_t m, std::size_t which) {
    return impl().region(which).edit(remove, n, add, m);
}
VFPLAN_ONCE bool Controller::remake(std::size_t which) { return impl().region(which).remake(); }
VFPLAN_ONCE void Controller::collect(std::size_t which) { impl().region(which).collect(); }
VFPLAN_ONCE bool Controller::set_stiffness(double stiffness, std::size_t which) {
    const Vec3 k{{stiffness, stiffness, stiffness}};
    detail::Rendered& part = impl().part(which);
    check_from("stiffness", stiffness, 0,
               std::max(part.stiffness_of_bundle(), impl_->settings.max_stiffness), " N/m",
               "at most the bundle's, or max_stiffness of the controller's settings");
    impl_->governor_of(impl_->stiffness() - part.parameters.stiffest() + stiffness);
    if (!impl_->region(which).set_stiffness(k)) return false;
    part.parameters.stiffness = k;
    return true;
}
VFPLAN_ONCE double Controller::stiffness() const noexcept { return impl_ ? impl_->stiffness() : 0; }
VFPLAN_ONCE double Controller::contact_radius(std::size_t which) const {
    return impl().part(which).parameters.contact_radius;
}
VFPLAN_ONCE Rule Controller::rule(std::size_t which) const {
    return impl().part(which).parameters.rule;
}
VFPLAN_ONCE std::size_t Controller::size() const noexcept {
    return impl_ ? impl_->all.parts.size() : 0;
}
VFPLAN_ONCE const Engine* Controller::region(std::size_t which) const {
    const auto& region = impl().part(which).region;
    return region ? &*region : nullptr;
}
VFPLAN_ONCE const MovingFrame* Controller::frame() const noexcept {
    return impl_ ? impl_->frame.get() : nullptr;
}
VFPLAN_ONCE const Governor& Controller::governor() const { return impl().governor; }

}  // namespace vfplan::inline v1
