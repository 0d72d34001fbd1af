// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What stands between engine and arm, last before the torque:
//
//     vfplan::GovernorLimits limits;                 // [N], [N m] and of one tick
//     vfplan::Governor governor(limits);             // throws std::invalid_argument
//     for (;;) {
//         const vfplan::Governed g = governor.step(engine.step(tip).force, jacobian, 7);
//         // command governor.torque(); never allocates, throws, locks or waits
//     }
//
// An arm refuses a force that changes too much in one tick. The governor changes it by no more than
// it was told to, along one line, and is not there while nothing is fast: below its limits what
// comes out is what went in, bit for bit.
//
// A force held back is the force of a spring that is gone, and gives energy. Released from F0 by
// s a tick of T, it pushes a free mass m for t = F0 T / s and gives it F0^2 t^2 / 8 m; that is no
// more than the F0^2 / 2 K which the spring had stored if s >= F0 T sqrt(K / m) / 2.
#pragma once

#include "vfplan/parameters.hpp"

namespace vfplan::inline v1 {

struct GovernorLimits {
    static constexpr int max_joints = 16;

    double force_step = 1.0;    ///< largest |change of force| from one tick to the next [N]
    double force_max = 20.0;    ///< largest |force| [N]
    double stiffness = 1000.0;  ///< K of the fixture's spring, its largest [N/m]
    double mass = 1.0;          ///< least moving mass at the tip, the arm's alone [kg]
    double period = 1e-3;       ///< of one tick [s]
    /// Largest |change of torque| of each joint [N m], or infinity.
    std::array<double, max_joints> torque_step;
    /// Largest |torque| of each joint [N m], or infinity.
    std::array<double, max_joints> torque_max;

    GovernorLimits() {
        torque_step.fill(infinity);
        torque_max.fill(infinity);
    }
    /// Least force_step with which a release of force_max gives no more than its spring had [N].
    double least_passive_step() const noexcept {
        return 0.5 * force_max * period * std::sqrt(stiffness / mass);
    }
};

/// What a tick of the governor has to say; bits, 0 when all is well.
struct GovernorStatus {
    enum Bit : std::uint8_t {
        bad_force = 1,  ///< the force is not finite or beyond 1e6 N, counts as none and fades out
        /// The Jacobian is not finite or beyond 1e6 m, or has not 1 to 16 columns; force and
        /// torques fade out.
        bad_jacobian = 2,
        /// Torques have limits, but without a Jacobian only forces were limited; a Controller
        /// stops.
        no_jacobian = 4,
        /// The arm turns faster than its torques may follow; torque() is not J^T F.
        torque_lags = 8,
        overdrawn = 16,  ///< the force held back gave more than the spring had stored
    };
};

struct Governed {
    Vec3 force;               ///< to command [N]
    double held_back = 0;     ///< |force asked for - force to command| [N]
    std::uint8_t status = 0;  ///< bits of GovernorStatus
    std::uint8_t engine = 0;  ///< bits of Status, of a Step that was governed
    bool is_capped = false;   ///< the force was shortened to force_max or torque_max
};

/// Throws OutOfRange on a value outside its range, and on a force_step that is not passive.
inline void check(const GovernorLimits& limits) {
    // A change that is a millionth of the force is still a million roundings of it.
    constexpr double smallest_share = 1e-6;
    check_above("force_max", limits.force_max, 0, 1e6, " N");
    check_above("stiffness", limits.stiffness, 0, infinity, " N/m");
    check_above("mass", limits.mass, 0, infinity, " kg");
    check_above("period", limits.period, 0, infinity, " s");
    const double least_step =
        std::max(limits.least_passive_step(), smallest_share * limits.force_max);
    check_above("force_step", limits.force_step, 0, 2 * limits.force_max, " N a tick",
                "above 0 and at most 2 force_max, by which a force turns round");
    check_from("force_step", limits.force_step, least_step, infinity, " N a tick",
               "force_max * period * sqrt(stiffness / mass) / 2: slower, a released force gives "
               "more energy than the spring had stored");
    for (int j = 0; j < GovernorLimits::max_joints; ++j) {
        const double most = limits.torque_max[j];
        if (!(most > 0)) reject_setting("torque_max", most, " N m", "a value above 0 N m");
        const double least = most == infinity ? 0 : smallest_share * most;
        const double step = limits.torque_step[j];
        if (!(step > 0 && step >= least))
            reject_setting("torque_step", step, " N m",
                           "a value above 0 and of at least " + shown(least) + " N m");
    }
}

class Governor {
  public:
    static constexpr int max_joints = GovernorLimits::max_joints;

    explicit Governor(const GovernorLimits& limits) : limits_(limits) {
        check(limits);
        by_torque_ = std::ranges::min(limits.torque_step) < infinity ||
                     std::ranges::min(limits.torque_max) < infinity;
    }

    /// Keeps to the limits of another one, whose joints have the same, from what is commanded on.
    void take_limits(const Governor& other) noexcept { limits_ = other.limits_; }
    /// Nothing is commanded and nothing was given, as when the controller of an arm starts.
    void reset() noexcept { *this = Governor(limits_); }

    /// The next tick of an arm that takes forces.
    Governed step(const Vec3& force) noexcept { return govern(force, {}, 0); }

    /// The next tick of an arm that takes torques.
    ///
    /// `jacobian` is that of the point on which the force acts: 3 x `joints`, row after row, with 1
    /// to 16 joints: any other number is `bad_jacobian`.
    Governed step(const Vec3& force, const double* jacobian, int joints) noexcept {
        const bool is_good = joints > 0 && joints <= max_joints && is_sound(jacobian, 3 * joints);
        if (is_good) return govern(force, {jacobian, joints}, 0);
        constexpr double none[max_joints] = {};
        const Governed g = govern({}, {}, GovernorStatus::bad_jacobian);
        ramp_torques(none, max_joints);
        return g;
    }

    /// The next tick for what an engine answered, whose status is kept; with a Jacobian, of an arm
    /// that takes torques.
    template <std::same_as<Step> S>
    Governed step(const S& rendered, const double* jacobian = nullptr, int joints = 0) noexcept {
        Governed g = jacobian ? step(rendered.force, jacobian, joints) : step(rendered.force);
        g.engine = rendered.status;
        return g;
    }

    /// J^T F to command [N m], of the last tick that had a Jacobian.
    const double* torque() const noexcept { return torque_; }
    bool has_torque() const noexcept {
        return std::ranges::any_of(torque_, [](double t) { return t != 0; });
    }
    /// What forces held back since the reset have given, had each pushed the mass freely [J].
    double energy_given() const noexcept { return closed_given_ + given(); }
    /// What the springs held that they were released from [J]. It is at least energy_given unless
    /// GovernorStatus::overdrawn.
    double energy_stored() const noexcept { return closed_stored_ + stored(); }

  private:
    /// Limits are aimed at from a little below, so that no rounding of a sum crosses them.
    static constexpr double below = 1 - 1e-9;
    /// The same from less below, for the limit of a force that was already aimed at `below` of it.
    static constexpr double nearly = 1 - 5e-10;
    /// By how much the energy given may exceed the energy stored before it counts as
    /// GovernorStatus::overdrawn: the sums are those of whole ticks.
    static constexpr double energy_tolerance = 1.01;
    /// Largest force [N], and entry of a Jacobian [m], that counts as a number.
    static constexpr double largest = 1e6;

    /// A Jacobian of 3 x `joints`, row after row. Where there is none, it has no joints.
    struct Jacobian {
        const double* values = nullptr;
        int joints = 0;

        /// What a force asks of joint j [N m].
        double torque(int j, const Vec3& force) const noexcept {
            return values[j] * force[0] + values[joints + j] * force[1] +
                   values[2 * joints + j] * force[2];
        }
    };

    /// The shares s of a change, from `smallest` to `largest`, that keep to limits.
    struct Shares {
        double smallest = 0;
        double largest = 1;

        bool is_empty() const noexcept { return !(smallest <= largest); }
        /// Keeps the shares s with |value + s change| <= limit.
        void keep(double value, double change, double limit) noexcept {
            if (limit == infinity) return;
            if (change == 0) {
                if (std::abs(value) > limit) largest = -1;
                return;
            }
            const double a = (-limit - value) / change;
            const double b = (limit - value) / change;
            smallest = std::max(smallest, std::min(a, b));
            largest = std::min(largest, std::max(a, b));
        }
    };

    static bool is_sound(const double* values, int n) noexcept {
        const auto is_number = [](double x) { return std::abs(x) <= largest; };
        return values != nullptr && std::all_of(values, values + n, is_number);
    }

    /// One tick. A force that is not sound counts as none.
    Governed govern(const Vec3& force, const Jacobian& jacobian, std::uint8_t status) noexcept {
        Governed g;
        g.status = status;
        if (by_torque_ && !jacobian.values && !status) g.status |= GovernorStatus::no_jacobian;
        const bool is_force_sound = is_sound(force.c, 3);
        if (!is_force_sound) g.status |= GovernorStatus::bad_force;
        const Vec3 wanted = is_force_sound ? force : Vec3{};
        const Vec3 target = clipped(wanted, jacobian);
        if (!accept(target, jacobian) && !ramp_towards(target, jacobian))
            g.status |= GovernorStatus::torque_lags;
        account_energy(target);
        if (given() > energy_tolerance * stored()) g.status |= GovernorStatus::overdrawn;
        g.force = force_;
        g.is_capped = !(target == wanted);
        g.held_back = norm(wanted - force_);
        return g;
    }

    /// The force, shortened to what the arm takes at rest.
    Vec3 clipped(const Vec3& force, const Jacobian& jacobian) const noexcept {
        double share = 1;
        const auto limit_to = [&share](double size, double limit) noexcept {
            if (size > limit) share = std::min(share, below * limit / size);
        };
        limit_to(norm(force), limits_.force_max);
        for (int j = 0; j < jacobian.joints; ++j)
            limit_to(std::abs(jacobian.torque(j, force)), limits_.torque_max[j]);
        return share < 1 ? share * force : force;
    }

    /// Takes the target as it is, if nothing changes too much by that.
    bool accept(const Vec3& target, const Jacobian& jacobian) noexcept {
        if (!(norm(target - force_) <= limits_.force_step)) return false;
        double torque[max_joints];
        for (int j = 0; j < jacobian.joints; ++j) {
            torque[j] = jacobian.torque(j, target);
            if (!(std::abs(torque[j] - torque_[j]) <= limits_.torque_step[j])) return false;
        }
        std::copy_n(torque, jacobian.joints, torque_);
        force_ = target;
        return true;
    }

    /// Moves the commanded force towards the target: F + s (target - F) with the largest s in [0,
    /// 1] for which the force changes by force_step at most (G1), and the torque of every joint
    /// stays within its step (G2) and its maximum (G3). Where the arm turns so fast that no s does,
    /// the force keeps to (G1) and the torques follow as fast as (G2) lets them; false then.
    bool ramp_towards(const Vec3& target, const Jacobian& jacobian) noexcept {
        const Vec3 change = target - force_;
        // (G1)
        const double force_share = std::min(1.0, below * limits_.force_step / norm(change));
        Shares shares{0, force_share};
        for (int j = 0; j < jacobian.joints; ++j) {
            const double torque = jacobian.torque(j, force_);
            const double torque_change = jacobian.torque(j, change);
            // (G2), (G3)
            shares.keep(torque - torque_[j], torque_change, below * limits_.torque_step[j]);
            shares.keep(torque, torque_change, nearly * limits_.torque_max[j]);
        }
        if (shares.is_empty()) {
            // The Jacobian has changed by more than the torques' steps allow.
            force_ = force_ + force_share * change;
            double goal[max_joints];
            for (int j = 0; j < jacobian.joints; ++j) goal[j] = jacobian.torque(j, force_);
            ramp_torques(goal, jacobian.joints);
            return false;
        }
        force_ = force_ + shares.largest * change;
        for (int j = 0; j < jacobian.joints; ++j) torque_[j] = jacobian.torque(j, force_);
        return true;
    }

    void ramp_torques(const double* goal, int n) noexcept {
        Shares shares;
        double change[max_joints];
        for (int j = 0; j < n; ++j) {
            change[j] = goal[j] - torque_[j];
            shares.keep(0, change[j], below * limits_.torque_step[j]);
            shares.keep(torque_[j], change[j], limits_.torque_max[j]);
        }
        const double share = std::max(shares.largest, 0.0);
        for (int j = 0; j < n; ++j) torque_[j] = torque_[j] + share * change[j];
    }

    /// Counts the energy of a force that lags behind its target: it pushes as if on a mass that
    /// nothing else holds.
    void account_energy(const Vec3& target) noexcept {
        const Vec3 lag = force_ - target;
        if (lag == Vec3{}) {
            closed_given_ += given();
            closed_stored_ += stored();
            momentum_ = {};
            stretched_ = 0;
        } else {
            momentum_ = momentum_ + limits_.period * lag;
            stretched_ = std::max({stretched_, norm(lag), norm(target), norm(before_)});
        }
        before_ = force_;
    }
    double given() const noexcept { return dot(momentum_, momentum_) / (2 * limits_.mass); }
    double stored() const noexcept { return stretched_ * stretched_ / (2 * limits_.stiffness); }

    GovernorLimits limits_;
    bool by_torque_ = false;
    Vec3 force_, before_, momentum_;
    double torque_[max_joints] = {};
    double stretched_ = 0;  // the largest force of the spring since the force lags [N]
    double closed_given_ = 0, closed_stored_ = 0;
};

}  // namespace vfplan::inline v1
