// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A fixture on a Franka arm by libfranka, at 1 kHz: loop.py in C++.
//
//   loop FIXTURE.h5 HOST (--keys KEYS.pub [--case CASE] [--robot-serial ID] [--max-age S] |
//   --unsigned)
//        [--tool-tip X,Y,Z] [--collision-force N] [--collision-torque NM] [--no-real-time]
//
// Your hand holds the arm, and the torques that are commanded are the fixture's alone, limited by
// the governor. The loop does not start while the tip is inside the fixture. It stops at the bits
// of docs/controller.md, or at Ctrl-C: the torques fade first. Its exit codes are those of loop.py.
#include <franka/exception.h>
#include <franka/lowpass_filter.h>
#include <franka/model.h>
#include <franka/robot.h>

#include <array>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>

#include "vfplan/controller.hpp"
#include "vfplan/engine.hpp"

namespace {

using vfplan::Vec3;
constexpr int joints = 7;

struct Options {
    std::string fixture, host;
    vfplan::Demand demand;
    Vec3 tool_tip;  // in the end effector's frame [m]
    double collision_force =
        40;  // at which the arm stops [N]: twice what the governor lets through
    double collision_torque = 40;  // the same of a joint's external torque [N m]
    bool is_real_time = true;      // libfranka refuses a kernel that is not
};

double number(const std::string& text) {
    std::size_t end = 0;
    const double value = std::stod(text, &end);
    if (end != text.size()) throw std::invalid_argument(text);
    return value;
}

/// Throws std::exception for words that are no options.
Options read_options(int argc, char** argv) {
    Options o;
    for (int i = 1; i < argc; ++i) {
        const std::string word = argv[i];
        const auto value = [&] {
            if (++i == argc) throw std::invalid_argument(word + " without a value");
            return std::string(argv[i]);
        };
        if (word == "--keys") {
            o.demand.keys.emplace_back(value());
        } else if (word == "--case") {
            o.demand.case_id = value();
        } else if (word == "--robot-serial") {
            o.demand.robot_serial = value();
        } else if (word == "--max-age") {
            o.demand.max_age_s = number(value());
        } else if (word == "--unsigned") {
            o.demand.accept_unsigned = o.demand.accept_unreviewed = true;
        } else if (word == "--tool-tip") {
            if (std::sscanf(value().c_str(), "%lf,%lf,%lf", &o.tool_tip[0], &o.tool_tip[1],
                            &o.tool_tip[2]) != 3)
                throw std::invalid_argument("--tool-tip wants X,Y,Z");
        } else if (word == "--collision-force") {
            o.collision_force = number(value());
        } else if (word == "--collision-torque") {
            o.collision_torque = number(value());
        } else if (word == "--no-real-time") {
            o.is_real_time = false;
        } else if (word.starts_with("--") || !o.host.empty()) {
            throw std::invalid_argument("unknown: " + word);
        } else {
            (o.fixture.empty() ? o.fixture : o.host) = word;
        }
    }
    if (o.host.empty()) throw std::invalid_argument("give a fixture and the arm's address");
    return o;
}

/// The limits of a Franka Research 3, less 5 % of the torques for the arm's own terms.
vfplan::ControllerSettings settings() {
    vfplan::ControllerSettings s;
    for (int j = 0; j < joints; ++j) {
        s.governor.torque_step[j] = 0.95;
        s.governor.torque_max[j] = 0.95 * (j < 4 ? 87 : 12);
    }
    return s;
}

/// From the end effector to the tip, in the base's frame [m]. O_T_EE stands column by column.
Vec3 arm_of(const franka::RobotState& state, const Vec3& offset) {
    Vec3 arm;
    for (std::size_t k = 0; k < 3; ++k)
        for (std::size_t j = 0; j < 3; ++j) arm[k] += state.O_T_EE[4 * j + k] * offset[j];
    return arm;
}
Vec3 tip_of(const franka::RobotState& state, const Vec3& arm) {
    return Vec3(state.O_T_EE[12], state.O_T_EE[13], state.O_T_EE[14]) + arm;
}

/// Velocity of the tip by the joints', row after row, from the end effector's Jacobian.
void tip_jacobian(const std::array<double, 42>& of_effector, const Vec3& arm,
                  double (&rows)[3 * joints]) {
    for (int j = 0; j < joints; ++j) {
        const double* column = of_effector.data() + 6 * j;
        const Vec3 velocity = Vec3(column[0], column[1], column[2]) +
                              cross(Vec3(column[3], column[4], column[5]), arm);
        for (int k = 0; k < 3; ++k) rows[joints * k + j] = velocity[k];
    }
}

std::atomic<vfplan::Controller*> running{nullptr};
std::atomic<int> signal_seen{0};

void stop_at_signal(int number) {
    signal_seen = number;
    if (vfplan::Controller* controller = running) controller->request_stop();
}

int render(const Options& o, vfplan::Controller& controller) {
    franka::Robot robot(o.host, o.is_real_time ? franka::RealtimeConfig::kEnforce
                                               : franka::RealtimeConfig::kIgnore);
    robot.automaticErrorRecovery();
    std::array<double, 7> torques;
    std::array<double, 6> forces;
    torques.fill(o.collision_torque);
    forces.fill(o.collision_force);
    robot.setCollisionBehavior(torques, torques, forces, forces);
    const franka::Model model = robot.loadModel();

    const franka::RobotState first = robot.readOnce();
    const Vec3 start = tip_of(first, arm_of(first, o.tool_tip));
    const vfplan::Engine* region = controller.region();
    if (region && region->distance(start) < controller.contact_radius()) {
        std::fprintf(stderr, "the tip is inside the fixture. Lead the arm out by hand.\n");
        return 1;
    }
    controller.reset(start);
    running = &controller;
    std::uint16_t stopping = 0;
    // Without libfranka's filter, whose delay no passivity bound knows; the governor keeps the
    // rate.
    robot.control(
        [&](const franka::RobotState& state, franka::Duration) -> franka::Torques {
            const Vec3 arm = arm_of(state, o.tool_tip);
            double jacobian[3 * joints];
            tip_jacobian(model.zeroJacobian(franka::Frame::kEndEffector, state), arm, jacobian);
            const vfplan::Command out =
                controller.step(tip_of(state, arm), std::nullopt, jacobian, joints);
            std::array<double, 7> torque;
            std::copy_n(controller.torque(), joints, torque.begin());
            stopping = out.stopping;
            const franka::Torques command(torque);
            return out.stop ? franka::MotionFinished(command) : command;
        },
        true, franka::kMaxCutoffFrequency);
    running = nullptr;
    if (signal_seen) return 128 + signal_seen;
    std::fprintf(stderr, "stopped by itself: bits %u, see docs/controller.md\n", stopping);
    return 1;
}

}  // namespace

int main(int argc, char** argv) {
    Options options;
    try {
        options = read_options(argc, argv);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 2;
    }
    for (const int number : {SIGINT, SIGTERM, SIGHUP}) std::signal(number, stop_at_signal);
    try {
        vfplan::Controller controller(options.fixture, options.demand, settings());
        return render(options, controller);
    } catch (const vfplan::bundle::BundleError& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 4;
    } catch (const franka::Exception& error) {
        std::fprintf(stderr, "the arm stopped, or is not ready: %s\n", error.what());
        return 1;
    } catch (const std::invalid_argument& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 3;
    }
}
