"""Passivity: over a closed HIP cycle, a fixture may not give more than sampling lets it.

With U = ½ (p - x)ᵀ K (p - x) and a proxy that is never farther from the new HIP than the old proxy
was, each tick gives at most F_k·Δx <= U_k - U_{k+1} + ½ Δxᵀ K Δx. Over a cycle,

    W <= U_0 - U_N + ½ Σ Δxᵀ K Δx.

A proxy that recedes, farther from the new HIP than the old proxy was, puts energy in: the robust
rule's guarantee is that it never recedes by more than the band. The docs (stability.md) give the
derivation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vfplan.engine.parameters import Rule, Vector
from vfplan.engine.ticks import Trace
from vfplan.fixture import Fixture
from vfplan.stability import contacts
from vfplan.stability.contacts import Contact
from vfplan.stability.largest import engines_for
from vfplan.stability.rows import Row, verdict


@dataclass(frozen=True)
class Cycle:
    """Work over one closed cycle of the HIP."""

    # Σ F_k·(x_{k+1} - x_k), what the fixture gave the hand [J]; negative: what it took
    work_j: float
    bound_j: float  # the sampled-data bound without receding [J]
    recede_m: float  # largest growth of |proxy - HIP| in one tick with the HIP where it is [m]
    stored_j: float  # largest U along the cycle [J], to hold the other figures against

    @property
    def excess(self) -> float:
        """(work - bound) / stored: above 0 the fixture was active."""
        return (self.work_j - self.bound_j) / self.stored_j if self.stored_j > 0 else 0.0


def random_cycle(contact: Contact, rng: np.random.Generator, rate: float = 1000.0) -> Vector:
    """(T, 3) a closed random path that starts and ends clear of the contact [m].

    A sum of four harmonics under a window, up to about two radii each way: in and out of the
    fixture, through thin walls and around points, at 0.02 to 2 m/s.
    """
    seconds = 10 ** rng.uniform(-0.8, 0.8)
    s = np.linspace(0.0, 1.0, round(seconds * rate))[:, None]
    wave = np.zeros((len(s), 3))
    for k in range(1, 5):
        phase = rng.uniform(0.0, 2 * np.pi, 3)
        wave += rng.normal(size=3) / k * np.cos(2 * np.pi * k * s + phase)
    inward = contact.inward / np.linalg.norm(contact.inward)
    path = contact.start + contact.radius * np.sin(np.pi * s) ** 2 * (wave + inward)
    path[-1] = path[0]
    return path


def measure(trace: Trace, hips: Vector, stiffness: float, axis: Vector | None = None) -> Cycle:
    """The cycle's energy balance.

    trace: the engine's answers to `hips`
    hips: (T, 3) [m], the last row equal to the first
    stiffness: K [N/m], isotropic
    axis: (3,) the ignored axis; nothing happens along it
    """
    dx = np.diff(hips, axis=0)
    if axis is not None:
        dx = dx - np.outer(dx @ axis, axis)
    stretch = trace.force / stiffness  # proxy - HIP, without its part along an ignored axis
    length = np.linalg.norm(stretch, axis=1)
    old = np.linalg.norm(stretch[:-1] - dx, axis=1)  # the old proxy from the new HIP
    stored = 0.5 * stiffness * length * length
    return Cycle(
        work_j=float((trace.force[:-1] * dx).sum()),
        bound_j=float(stored[0] - stored[-1] + 0.5 * stiffness * (dx * dx).sum()),
        recede_m=float(np.maximum(length[1:] - old, 0.0).max(initial=0.0)),
        stored_j=float(stored.max()),
    )


def passivity(on: Fixture | str, rule: Rule, stiffness: float, cycles: int = 20) -> list[Row]:
    """Rows of a named scene, or of a bundle's own points, lines and arcs, or triangles; K [N/m]."""
    scene, met, band = contacts.met(on, rule)
    places = list(met)
    rng = np.random.default_rng(9)
    found: list[Cycle] = []
    make = engines_for(rule, band)
    if not places:
        return []
    for contact in places:
        engine = make(contact)
        par = engine.parameters
        for _ in range(-(-cycles // len(places))):
            hips = random_cycle(contact, rng)
            engine.reset(hips[0])
            trace = engine.run(hips)
            found.append(measure(trace, hips, 1.0, par.ignore_axis))
    active = [cycle for cycle in found if cycle.excess > 0]
    excess = max(cycle.excess for cycle in found)
    recede = max(cycle.recede_m for cycle in found)
    values = {
        "scene": scene,
        "rule": rule,
        "cycles": len(found),
        "active_cycles": len(active),
        "work_j": [stiffness * cycle.work_j for cycle in found],
        "bound_j": [stiffness * cycle.bound_j for cycle in found],
        "excess": [cycle.excess for cycle in found],
    }
    return [
        Row(
            case=f"passivity/{scene}/{rule}",
            outcome=verdict(not active, rule),
            detail=f"net work above the sampled-data bound in {len(active)} of {len(found)} random"
            f" closed cycles; largest (work - bound) / stored energy {excess:+.2g}",
            limit=0.0,
            measured=excess,
            unit="of the energy stored",
            values=values,
        ),
        Row(
            case=f"recede/{scene}/{rule}",
            outcome=verdict(recede <= par.band * (1 + 1e-6), rule),
            detail=f"|proxy - HIP| grew in one tick by at most {recede / par.band:.2f} bands",
            limit=par.band,
            measured=recede,
            unit="m",
            values={"scene": scene, "rule": rule},
        ),
    ]
