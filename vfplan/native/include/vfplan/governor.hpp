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

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>

#include "vfplan/base/vec.hpp"

namespace vfplan {

struct GovernorLimits {
    static constexpr int most_joints = 16;
    static constexpr double none = std::numeric_limits<double>::infinity();

    double force_step = 1.0;          ///< largest |change of force| from one tick to the next [N]
    double force_max = 20.0;          ///< largest |force| [N]
    double stiffness = 1000.0;        ///< K of the fixture's spring, its largest [N/m]
    double mass = 1.0;                ///< least moving mass at the tip, the arm's alone [kg]
    double period = 1e-3;             ///< of one tick [s]
    double torque_step[most_joints];  ///< largest |change of torque| of each joint [N m], or none
    double torque_max[most_joints];   ///< largest |torque| of each joint [N m], or none

    GovernorLimits() {
        std::fill_n(torque_step, most_joints, none);
        std::fill_n(torque_max, most_joints, none);
    }
    /// Least force_step with which a release of force_max gives no more than its spring had [N].
    double least_passive_step() const noexcept {
        return 0.5 * force_max * period * std::sqrt(stiffness / mass);
    }
    /// The same of a force that turns round at force_max: a way twice as long.
    double least_reversing_step() const noexcept { return 2 * least_passive_step(); }
};

/// What a tick of the governor has to say; bits, 0 when all is well.
enum GovernorStatus : std::uint8_t {
    bad_force = 1,     ///< force not finite or beyond 1e6 N: taken for none, and faded out
    bad_jacobian = 2,  ///< Jacobian not finite or beyond 1e6 m: force and torques fade out
    no_jacobian = 4,   ///< torques are limited, but without a Jacobian only forces were
    torque_lags = 8,   ///< the arm turns faster than its torques may follow: torque() is not J^T F
    overdrawn = 16,    ///< the force held back gave more than the spring had stored
};

struct Governed {
    Vec3 force;            ///< to command [N]
    double held_back = 0;  ///< |force asked for - force to command| [N]
    std::uint8_t status = 0;
};

/// Throws std::invalid_argument on a value outside its range, and on a force_step that is not
/// passive.
inline void check(const GovernorLimits& limits) {
    const auto must = [](bool holds, const std::string& what) {
        if (!holds) reject(what);
    };
    const auto positive = [](double x) { return std::isfinite(x) && x > 0; };
    must(positive(limits.force_max) && limits.force_max <= 1e6,
         "force_max must be above 0 and at most 1e6 N");
    must(positive(limits.stiffness), "stiffness must be above 0");
    must(positive(limits.mass), "mass must be above 0");
    must(positive(limits.period), "period must be above 0");
    // A change that is a millionth of the force is still a million roundings of it.
    must(positive(limits.force_step) && limits.force_step >= 1e-6 * limits.force_max,
         "force_step must be above 0 and at least 1e-6 force_max");
    must(limits.force_step >= limits.least_passive_step(),
         "force_step " + std::to_string(limits.force_step) +
             " N a tick gives more energy than the spring had stored; at least force_max * period "
             "* sqrt(stiffness / mass) / 2 = " +
             std::to_string(limits.least_passive_step()) + " N is passive");
    for (int j = 0; j < GovernorLimits::most_joints; ++j) {
        must(limits.torque_max[j] > 0, "torque_max must be above 0");
        must(limits.torque_step[j] > 0 && (limits.torque_max[j] == GovernorLimits::none ||
                                           limits.torque_step[j] >= 1e-6 * limits.torque_max[j]),
             "torque_step must be above 0 and at least 1e-6 torque_max");
    }
}

class Governor {
  public:
    static constexpr int most_joints = GovernorLimits::most_joints;

    explicit Governor(const GovernorLimits& limits) : limits_(limits) {
        check(limits);
        for (int j = 0; j < most_joints; ++j)
            by_torque_ = by_torque_ || limits.torque_step[j] < GovernorLimits::none ||
                         limits.torque_max[j] < GovernorLimits::none;
    }

    /// Nothing commanded, nothing given: as the arm is when its controller starts.
    void reset() noexcept { *this = Governor(limits_, by_torque_); }

    /// The next tick of an arm that takes forces.
    Governed step(const Vec3& force) noexcept {
        const bool good = sound(force.c, 3);
        return govern(force, good, good ? 0 : bad_force, nullptr, 0);
    }

    /// The next tick of an arm that takes torques.
    ///
    /// `jacobian`: 3 x `joints`, row after row, of the point the force acts on; joints <= 16.
    Governed step(const Vec3& force, const double* jacobian, int joints) noexcept {
        const int n = std::clamp(joints, 0, most_joints);
        if (n == 0 || !sound(jacobian, 3 * n)) {
            const Governed g = govern({}, false, bad_jacobian, nullptr, 0);
            fade_torques();
            return g;
        }
        const bool good = sound(force.c, 3);
        return govern(force, good, good ? 0 : bad_force, jacobian, n);
    }

    const GovernorLimits& limits() const noexcept { return limits_; }
    /// J^T F to command [N m], of the last tick that had a Jacobian.
    const double* torque() const noexcept { return torque_; }
    /// What forces held back since the reset have given, had each pushed the mass freely [J].
    double energy_given() const noexcept { return closed_given_ + given(); }
    /// What the springs held that they were released from [J]: at least energy_given unless
    /// overdrawn.
    double energy_stored() const noexcept { return closed_stored_ + stored(); }

  private:
    /// Limits are aimed at from a little below, so that no rounding of a sum crosses them.
    static constexpr double below = 1 - 1e-9, nearly = 1 - 5e-10;
    static constexpr double largest = 1e6;

    Governor(const GovernorLimits& limits, bool by_torque) noexcept
        : limits_(limits), by_torque_(by_torque) {}

    static bool sound(const double* values, int n) noexcept {
        if (values == nullptr) return false;
        for (int k = 0; k < n; ++k)
            if (!(std::abs(values[k]) <= largest)) return false;
        return true;
    }
    static double of_joint(const double* jacobian, int n, int j, const Vec3& force) noexcept {
        return jacobian[j] * force[0] + jacobian[n + j] * force[1] + jacobian[2 * n + j] * force[2];
    }

    Governed govern(const Vec3& asked, bool good, int said, const double* jacobian,
                    int n) noexcept {
        Governed g;
        g.status = static_cast<std::uint8_t>(said);
        if (by_torque_ && jacobian == nullptr && !(said & bad_jacobian)) g.status |= no_jacobian;
        const Vec3 wanted = good ? asked : Vec3{};
        const Vec3 target = clipped(wanted, jacobian, n);
        if (!accept(target, jacobian, n) && !ramp_towards(target, jacobian, n))
            g.status |= torque_lags;
        account_energy(target);
        if (given() > 1.01 * stored()) g.status |= overdrawn;
        g.force = force_;
        g.held_back = norm(wanted - force_);
        return g;
    }

    /// The force, shortened to what the arm takes at rest.
    Vec3 clipped(const Vec3& force, const double* jacobian, int n) const noexcept {
        double share = 1;
        const auto hold = [&share](double size, double limit) noexcept {
            if (size > limit) share = std::min(share, below * limit / size);
        };
        hold(norm(force), limits_.force_max);
        for (int j = 0; j < n; ++j)
            hold(std::abs(of_joint(jacobian, n, j, force)), limits_.torque_max[j]);
        return share < 1 ? share * force : force;
    }

    /// Takes the target as it is, if nothing changes too much by that.
    bool accept(const Vec3& target, const double* jacobian, int n) noexcept {
        if (!(norm(target - force_) <= limits_.force_step)) return false;
        double torque[most_joints];
        for (int j = 0; j < n; ++j) {
            torque[j] = of_joint(jacobian, n, j, target);
            if (!(std::abs(torque[j] - torque_[j]) <= limits_.torque_step[j])) return false;
        }
        std::copy_n(torque, n, torque_);
        force_ = target;
        return true;
    }

    /// Goes towards the target by as much as every limit allows; false where the torques alone do.
    bool ramp_towards(const Vec3& target, const double* jacobian, int n) noexcept {
        const Vec3 change = target - force_;
        double least = 0, most = std::min(1.0, below * limits_.force_step / norm(change));
        const double by_force = most;
        for (int j = 0; j < n; ++j) {
            const double at = of_joint(jacobian, n, j, force_);
            const double by = of_joint(jacobian, n, j, change);
            within(at - torque_[j], by, below * limits_.torque_step[j], least, most);
            within(at, by, nearly * limits_.torque_max[j], least, most);
        }
        const bool together = least <= most;
        force_ = force_ + (together ? most : by_force) * change;
        if (together)
            for (int j = 0; j < n; ++j) torque_[j] = of_joint(jacobian, n, j, force_);
        else
            torques_towards(jacobian, n);
        return together;
    }

    /// Narrows [least, most] to the shares s with |at + s by| <= limit.
    static void within(double at, double by, double limit, double& least, double& most) noexcept {
        if (limit == GovernorLimits::none) return;
        if (by == 0) {
            if (std::abs(at) > limit) most = -1;
            return;
        }
        const double a = (-limit - at) / by, b = (limit - at) / by;
        least = std::max(least, std::min(a, b));
        most = std::min(most, std::max(a, b));
    }

    /// Torques towards J^T F where the Jacobian has changed by more than a step of them allows.
    void torques_towards(const double* jacobian, int n) noexcept {
        double change[most_joints];
        for (int j = 0; j < n; ++j) change[j] = of_joint(jacobian, n, j, force_) - torque_[j];
        ramp_torques(change, n);
    }
    void fade_torques() noexcept {
        double change[most_joints];
        for (int j = 0; j < most_joints; ++j) change[j] = -torque_[j];
        ramp_torques(change, most_joints);
    }
    void ramp_torques(const double* change, int n) noexcept {
        double share = 1;
        for (int j = 0; j < n; ++j) {
            double least = 0;
            within(0, change[j], below * limits_.torque_step[j], least, share);
            within(torque_[j], change[j], limits_.torque_max[j], least, share);
        }
        share = std::max(share, 0.0);
        for (int j = 0; j < n; ++j) torque_[j] = torque_[j] + share * change[j];
    }

    /// A force that lags behind its target pushes, as if on a mass that nothing else holds.
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
    double torque_[most_joints] = {};
    double stretched_ = 0;  // [N] the most that the spring was, since the force lags
    double closed_given_ = 0, closed_stored_ = 0;
};

}  // namespace vfplan
