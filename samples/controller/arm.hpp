// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A simulated arm's tool tip, driven in the three ways that robots offer. Each form takes the
// hand's and the fixture's force in one tick and says where the tip is in the next.
//
// The paper adds the fixture's force to an impedance law; robots that take positions or velocities
// need it turned into one first, which is what Admittance and Velocity do.
#pragma once

#include "vfplan/base/vec.hpp"

namespace controller {

using vfplan::Vec3;

/// Tip and what the controller believes of it.
struct Tip {
    Vec3 position;  // [m]
    Vec3 velocity;  // [m/s]
};

/// Torque-controlled arm: the force is an independent term of the impedance law,
/// m a = F_hand + F_v - b v.
struct Impedance {
    double mass = 1.0;      // [kg] seen at the tip
    double damping = 20.0;  // [N s/m] of the impedance law

    void tick(Tip& tip, const Vec3& hand, const Vec3& fixture, double dt) const {
        for (int k = 0; k < 3; ++k) {
            const double push = hand[k] + fixture[k] - damping * tip.velocity[k];
            tip.velocity[k] += dt * push / mass;  // semi-implicit: velocity first
            tip.position[k] += dt * tip.velocity[k];
        }
    }
};

/// Position-controlled arm: a virtual mass and damper integrate the force twice into a displacement
/// to command; the arm's own loop follows it with a lag.
struct Admittance {
    double mass = 1.0;      // [kg] virtual
    double damping = 40.0;  // [N s/m] virtual
    double lag = 5e-3;      // [s] of the arm's position loop
    Tip command{};
    bool started = false;

    void tick(Tip& tip, const Vec3& hand, const Vec3& fixture, double dt) {
        if (!started) command = tip;
        started = true;
        for (int k = 0; k < 3; ++k) {
            const double push = hand[k] + fixture[k] - damping * command.velocity[k];
            command.velocity[k] += dt * push / mass;
            command.position[k] += dt * command.velocity[k];
            tip.velocity[k] = (command.position[k] - tip.position[k]) / lag;
            tip.position[k] += dt * tip.velocity[k];
        }
    }
};

/// Velocity-controlled arm: a gain turns the force into a velocity to command; the arm's own loop
/// reaches it with a lag.
struct Velocity {
    double gain = 1.0 / 40.0;  // [m/s/N]
    double lag = 5e-3;         // [s] of the arm's velocity loop

    void tick(Tip& tip, const Vec3& hand, const Vec3& fixture, double dt) const {
        for (int k = 0; k < 3; ++k) {
            const double wanted = gain * (hand[k] + fixture[k]);
            tip.velocity[k] += dt * (wanted - tip.velocity[k]) / lag;
            tip.position[k] += dt * tip.velocity[k];
        }
    }
};

}  // namespace controller
