// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The short way from a bundle to the force that an arm is given, and the safe one:
//
//     vfplan::Demand demand;                            // what the file must be
//     demand.keys = {"team.pub"};
//     vfplan::Controller controller("fixture.h5", demand);   // throws; allocates
//     controller.reset(tip);
//     for (;;) {
//         const vfplan::Command out = controller.step(tip);  // never throws, allocates or waits
//         // command out.force
//         if (out.stop) break;                               // it has faded to 0
//     }
//
// It holds forbidden regions, guides, the frame of a fixture that moves, and a governor.
#pragma once

#include <filesystem>

#ifdef __cpp_exceptions
#include "vfplan/bundle/bytes.hpp"
#endif
#include "vfplan/governor.hpp"
#include "vfplan/moving.hpp"
#include "vfplan/version.hpp"

namespace vfplan::inline v1 {

class Engine;

namespace bundle {
struct Fixture;
}
namespace detail {
struct ControllerImpl;
}

/// What a bundle must be so that a controller renders it. In any case it is whole, keeps to the
/// format, and lies in the frame robot_base.
struct Demand {
    std::vector<std::filesystem::path> keys =
        {};                                   ///< files of public keys, one of which has signed it
    std::optional<std::string> case_id = {};  ///< for which it was signed
    std::optional<std::string> robot_serial = {};  ///< for which it was signed
    std::optional<double> max_age_s = {};          ///< how long ago it was signed at most [s]
    std::optional<std::string> tool = {};          ///< that touched the markers
    bool accept_unsigned = false;    ///< anybody may have made it, where no keys are given
    bool accept_unreviewed = false;  ///< nobody may have looked at its plan
    bool accept_doubts = false;      ///< doubts about its plan may be open
};

/// The fixture of a bundle that meets the demands. Throws bundle::BundleError.
VFPLAN_ONCE bundle::Fixture load(const std::filesystem::path& path, const Demand& demand);

struct ControllerSettings {
    GovernorLimits governor;  ///< its `period` is a tick's; its `stiffness` follows from the bundle
    double max_stiffness = 0;  ///< K to which set_stiffness may raise a bundle's [N/m]; what the
                               ///< fixture is exchanged for brings its own
    std::optional<MovingLimits> moving = {};  ///< of a fixture that moves
    std::optional<Rule> rule = {};            ///< without one, each fixture's best
    Search search = Search::automatic;
    double max_hip_step = 0.02;  ///< a tip further from the last one counts as no position [m]
    double hold_time = 0.02;     ///< for which the force is held without a good position [s]; ten
                                 ///< good ticks make up for a bad one
    /// At which bits of a tick's status the loop stops: `bad_hip` and `jumped`, which belong to any
    /// choice, after `hold_time`.
    std::uint8_t stop_at =
        Status::bad_hip | Status::stale_pose | Status::other_side | Status::jumped;
    bool any_tick_time = false;  ///< for a replay or a study, which can wait
};

/// What a tick answers.
struct Command {
    Vec3 force{};     ///< to command [N]; in a formula of Eigen, Eigen::Vector3d(out.force)
    Vec3 rendered{};  ///< of the fixtures, before the governor [N]
    Vec3 proxy{};     ///< in the robot's base [m]
    Vec3 normal{};    ///< unit, from the wall to the proxy; 0 when there is none
    State state = State::no_neighbour;  ///< of the fixture that pushes most, as proxy and normal
    std::uint8_t status = Status::ok;   ///< bits of Status
    std::uint8_t governor = 0;          ///< bits of GovernorStatus
    std::uint16_t stopping = 0;  ///< why the force fades: bits of Status, of GovernorStatus times
                                 ///< 256, or Controller::asked; 0 while the loop goes on
    bool stop = false;           ///< the force has faded to 0: the loop ends
};

/// Serves one loop: one thread steps and resets, one other calls what is said to be for it.
class Controller {
  public:
    /// In Command::stopping: `request_stop` was called.
    static constexpr std::uint16_t asked = 1 << 15;

    /// Renders the fixture of a bundle. Throws bundle::BundleError for a bundle that is not what is
    /// demanded, and std::invalid_argument for settings that do not fit it.
    explicit Controller(const std::filesystem::path& fixture, const Demand& demand = {},
                        const ControllerSettings& settings = {});
    /// Renders a fixture that `load` or another reader gave; the demands are of what is exchanged.
    /// Of it only the frame, the stiffness, the radii and the time of a tick are checked.
    explicit Controller(const bundle::Fixture& fixture, const Demand& demand = {},
                        const ControllerSettings& settings = {});
    Controller(Controller&&) noexcept = default;
    Controller& operator=(Controller&&) noexcept = default;

    /// Renders another fixture too: forces add up. One that is rendered already is felt once. It
    /// takes longer than a tick: call it before the loop begins. The commanded force stays.
    void add(const std::filesystem::path& fixture);
    void add(const bundle::Fixture& fixture);

    /// The loop begins, or goes on after a stop, with the tip here [m]. With a wall between this
    /// place and the last one of the proxy, the first tick says `other_side`; where the tool may be
    /// there, reset once more: so never reset automatically after a stop. At a place that is not
    /// finite, or beyond 100 m, nothing begins: the loop stops (`bad_hip`) until it is reset at a
    /// good one. Where the clock of a moving fixture begins anew, reset before its first tick, and
    /// again once `pose` has returned true: the first two older poses are refused.
    void reset(const Vec3& tip) noexcept;
    /// One tick of an arm that takes forces, at a time of its clock [s]: needed for a fixture that
    /// moves, else ticks are one period apart, and no time stops the loop.
    Command step(const Vec3& tip, std::optional<double> time_s = std::nullopt) noexcept;
    /// One tick of an arm that takes torques, which `torque` then has. `jacobian`: 3 x `joints` (1
    /// to 16) of the tip [m], row after row; of another unit or order nobody notices. Torque limits
    /// without any Jacobian stop the loop (`no_jacobian`).
    Command step(const Vec3& tip, std::optional<double> time_s, const double* jacobian,
                 int joints) noexcept;
    /// J^T F to command [N m], of 16 joints.
    const double* torque() const noexcept;
    /// From the next tick on the force fades, and the loop stops; from any thread, or a signal's
    /// handler. A reset does not forget a request that no tick has seen.
    void request_stop() noexcept;

    // For one other thread, while the loop runs.

    /// Hands over where the moving fixture was at `stamp` [s]: as MovingFrame::pose. Without
    /// ControllerSettings::moving nothing would move, and the loop stops (`stale_pose`).
    bool pose(double stamp, const Pose& pose) noexcept;
    /// Hands the poses that wait to the frame, as the tick at this time does; for the loop, where
    /// it is the tracker's thread too.
    void take_poses(double time_s) noexcept;
    /// Exchanges a fixture for that of another bundle, which meets the same demands; false where
    /// too many changes wait. Throws as the constructor does.
    bool exchange(const std::filesystem::path& fixture, std::size_t which = 0);
    bool exchange(const bundle::Fixture& fixture, std::size_t which = 0);
    /// Exchanges it for the only fixture of a controller that was made before, and is then spent.
    /// Throws std::invalid_argument for one that was made under weaker demands, or with
    /// any_tick_time, another period, a larger max_stiffness, or not Search::editable where this
    /// one has it. Its age was checked when it was made.
    bool exchange(Controller&& other, std::size_t which = 0);
    /// Takes points of a region away and adds others, as Engine::edit and Engine::remake; of
    /// settings with Search::editable.
    bool edit(const std::uint32_t* remove, std::size_t n, const double* add, std::size_t m,
              std::size_t which = 0);
    bool remake(std::size_t which = 0);
    /// Frees the memory of a region's replaced engines, as the changes above do too.
    void collect(std::size_t which = 0);
    /// Changes K of a region [N/m]; false where too many changes wait. Throws std::invalid_argument
    /// for one that is out of range, that is larger than the bundle's and than max_stiffness, or
    /// with which the governor would not be passive.
    bool set_stiffness(double stiffness, std::size_t which = 0);

    /// K of all springs together, at most [N/m].
    double stiffness() const noexcept;
    // Of a fixture by its number, from 0 as they were added; throws OutOfRange for another one.

    /// r_c [m].
    double contact_radius(std::size_t which = 0) const;
    /// By which its proxy moves.
    Rule rule(std::size_t which = 0) const;
    /// Its engine, to look at it, of "vfplan/engine.hpp"; null where it only guides.
    const Engine* region(std::size_t which = 0) const;
    /// Number of different fixtures.
    std::size_t size() const noexcept;
    /// The frame of a fixture that moves, or null.
    const MovingFrame* frame() const noexcept;
    const Governor& governor() const;

  private:
    detail::ControllerImpl& impl() const;

    std::shared_ptr<detail::ControllerImpl> impl_;  // which no other controller has
};

}  // namespace vfplan::inline v1

#ifndef VFPLAN_COMPILED
#include "vfplan/controller.inl"
#endif
