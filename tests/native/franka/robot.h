// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// So much of libfranka's interface as samples/franka/loop.cpp uses, written for its test, and an
// arm that a hand presses 2 mm into a wall at z = 0 and moves along it. The address tells what
// happens: "press", "nan" (from tick 500 on), "signal" (SIGINT at tick 500), "start-inside".
#pragma once

#include <array>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <functional>
#include <stdexcept>
#include <string>

namespace franka {

struct Exception : std::runtime_error {
    using std::runtime_error::runtime_error;
};
enum class RealtimeConfig { kEnforce, kIgnore };
enum class Frame { kEndEffector };
constexpr double kMaxCutoffFrequency = 1000, kDefaultCutoffFrequency = 100;
struct Duration {};
struct RobotState {
    std::array<double, 16> O_T_EE{};
};
struct Torques {
    explicit Torques(const std::array<double, 7>& torques) : tau_J(torques) {}
    std::array<double, 7> tau_J;
    bool motion_finished = false;
};
inline Torques MotionFinished(Torques command) noexcept {
    command.motion_finished = true;
    return command;
}

struct Model {
    /// Three joints move the effector along x, y and z.
    std::array<double, 42> zeroJacobian(Frame, const RobotState&) const {
        std::array<double, 42> jacobian{};
        for (std::size_t j = 0; j < 3; ++j) jacobian[6 * j + j] = 1;
        return jacobian;
    }
};

class Robot {
  public:
    Robot(const std::string& address, RealtimeConfig config) : address_(address) {
        std::printf("%s ", config == RealtimeConfig::kEnforce ? "enforce" : "ignore");
    }
    void automaticErrorRecovery() {}
    void setCollisionBehavior(const std::array<double, 7>& low, const std::array<double, 7>& high,
                              const std::array<double, 6>& less,
                              const std::array<double, 6>& more) {
        if (low != high || less != more) throw Exception("thresholds");
        std::printf("torque %g force %g ", low[0], less[0]);
    }
    Model loadModel() { return {}; }
    RobotState readOnce() { return at(address_ == "start-inside" ? 1500 : 0); }
    void control(const std::function<Torques(const RobotState&, Duration)>& callback, bool = true,
                 double cutoff = kDefaultCutoffFrequency) {
        std::array<double, 7> last{};
        double step = 0, most = 0;
        for (long tick = 0; tick < 20000; ++tick) {
            if (address_ == "signal" && tick == 500) std::raise(SIGINT);
            const Torques command = callback(at(tick), Duration{});
            for (std::size_t j = 0; j < 7; ++j) {
                step = std::max(step, std::abs(command.tau_J[j] - last[j]));
                most = std::max(most, command.tau_J[j]);
            }
            last = command.tau_J;
            if (!command.motion_finished) continue;
            std::printf("cutoff %g tick %ld step %.3f most %.3f last %g\n", cutoff, tick, step,
                        most, std::abs(last[0]) + std::abs(last[1]) + std::abs(last[2]));
            return;
        }
        throw Exception("the reflex of the arm");
    }

  private:
    /// The tip stands 0.1 m below the effector, which is not turned.
    RobotState at(long tick) const {
        RobotState state;
        state.O_T_EE[0] = state.O_T_EE[5] = state.O_T_EE[10] = state.O_T_EE[15] = 1;
        state.O_T_EE[12] = 5e-3 * std::sin(2e-3 * double(tick));
        state.O_T_EE[14] = 0.1 + std::max(3e-3, 20e-3 - 4e-5 * double(tick));
        if (address_ == "nan" && tick >= 500) state.O_T_EE[13] = std::nan("");
        return state;
    }
    std::string address_;
};

}  // namespace franka
