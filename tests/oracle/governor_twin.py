"""The governor once more, in NumPy: shares are looked for by bisection, not solved for."""

from __future__ import annotations

import numpy as np

MARGIN = 1e-9  # how far below a limit the governor aims, relative


class Twin:
    def __init__(self, force_step, force_max, torque_step, torque_max, stiffness, mass, period):
        self.force_step, self.force_max = force_step, force_max
        self.torque_step, self.torque_max = np.asarray(torque_step), np.asarray(torque_max)
        self.stiffness, self.mass, self.period = stiffness, mass, period
        self.force, self.torque = np.zeros(3), np.zeros(len(self.torque_step))
        self.momentum, self.top, self.given, self.stored = np.zeros(3), 0.0, 0.0, 0.0

    def step(self, wanted, J):
        over = max(
            np.linalg.norm(wanted) / self.force_max, (np.abs(J.T @ wanted) / self.torque_max).max()
        )
        target = wanted if over <= 1 else wanted * ((1 - MARGIN) / over)
        before = self.force
        share = self.largest(lambda s: self.allowed(before + s * (target - before), J))
        if share is not None:
            self.force = before + share * (target - before)
            self.torque = J.T @ self.force
        else:  # the arm turned too far: the force goes its way, the torques follow theirs
            by = target - before
            share = self.largest(lambda s: np.linalg.norm(s * by) <= self.force_step)
            self.force = before + share * by
            by, old = J.T @ self.force - self.torque, self.torque
            share = self.largest(
                lambda s: (
                    (np.abs(s * by) <= self.torque_step).all()
                    and (np.abs(old + s * by) <= self.torque_max).all()
                )
            )
            self.torque = old + share * by
        self.account(before, target)
        return self.force

    def allowed(self, force, J):
        torque = J.T @ force
        return (
            np.linalg.norm(force - self.force) <= self.force_step
            and (np.abs(torque - self.torque) <= self.torque_step).all()
            and (np.abs(torque) <= self.torque_max).all()
        )

    @staticmethod
    def largest(holds):
        """The largest share in [0, 1] that holds; `None` when none of 257 does."""
        tried = np.linspace(1, 0, 257)
        low = next((s for s in tried if holds(s)), None)
        if low is None or low == 1:
            return low
        high = low + tried[0] - tried[1]
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if holds(middle) else (low, middle)
        return low

    def account(self, before, target):
        lag = self.force - target
        if np.linalg.norm(lag) < 1e-7:
            self.given += self.momentum @ self.momentum / (2 * self.mass)
            self.stored += self.top**2 / (2 * self.stiffness)
            self.momentum, self.top = np.zeros(3), 0.0
            return
        self.momentum = self.momentum + self.period * lag
        self.top = max(self.top, *(float(np.linalg.norm(v)) for v in (lag, target, before)))
