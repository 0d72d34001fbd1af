"""Passivity: over a closed HIP cycle, a fixture may not give more than sampling lets it.

With U = ½ (p - x)ᵀ K (p - x) and a proxy that is never farther from the new HIP than the old proxy
was, each tick gives at most F_k·Δx <= U_k - U_{k+1} + ½ Δxᵀ K Δx. Over a cycle,

    W <= U_0 - U_N + ½ Σ Δxᵀ K Δx.

A proxy that recedes, farther from the new HIP than the old proxy was, puts energy in. The robust
rule guarantees that it never recedes by more than the band. docs/stability.md has the derivation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vfplan.engine.answers import Trace
from vfplan.engine.parameters import Rule, Vector
from vfplan.fixture import Fixture
from vfplan.stability import contacts
from vfplan.stability.case_result import CaseResult, outcome_of
from vfplan.stability.contacts import ROUNDING_M, Contact
from vfplan.stability.largest import EngineMaker


@dataclass(frozen=True)
class EnergyBalance:
    """Work and its bound over one closed cycle of the HIP.

    Parameters
    ----------
    work_j
        Σ F_k·(x_{k+1} - x_k), which the fixture gave the hand [J]; below 0 the hand gave it.
    bound_j
        The bound of this module for a proxy that does not recede [J].
    recede_m
        Largest growth of |proxy - HIP| in one tick beyond what the HIP's own step explains [m].
    stored_j
        Largest U along the cycle [J], against which the other figures are held.
    """

    work_j: float
    bound_j: float
    recede_m: float
    stored_j: float

    @property
    def excess(self) -> float:
        """(work - bound) / stored. Above 0 the fixture was active."""
        return 0.0 if self.stored_j <= 0 else (self.work_j - self.bound_j) / self.stored_j


def random_cycle(contact: Contact, rng: np.random.Generator) -> Vector:
    """(T, 3) a closed random path at 1 kHz that starts and ends clear of the contact [m].

    A sum of four harmonics under a window, up to about two radii each way: in and out of the
    fixture, through thin walls and around points, at 0.02 to 2 m/s.
    """
    seconds = 10 ** rng.uniform(-0.8, 0.8)
    s = np.linspace(0.0, 1.0, round(seconds * 1000.0))[:, None]
    wave = np.zeros((len(s), 3))
    for k in range(1, 5):
        phase = rng.uniform(0.0, 2 * np.pi, 3)
        wave += rng.normal(size=3) / k * np.cos(2 * np.pi * k * s + phase)
    window = np.sin(np.pi * s) ** 2
    path = contact.start + contact.radius * window * (wave + contact.push_direction)
    path[-1] = path[0]
    return path


def energy_balance(
    trace: Trace, hips: Vector, stiffness: float, axis: Vector | None = None
) -> EnergyBalance:
    """The energy balance of one cycle.

    Parameters
    ----------
    trace
        The engine's answers to `hips`.
    hips
        (T, 3) [m], the last row equal to the first.
    stiffness
        K [N/m], the same along every axis.
    axis
        (3,) the ignored axis. A movement along it does no work.
    """
    movement = np.diff(hips, axis=0)
    if axis is not None:
        movement = movement - np.outer(movement @ axis, axis)
    # The vector from the HIP to the proxy, without its part along an ignored axis.
    stretch = trace.force / stiffness
    length = np.linalg.norm(stretch, axis=1)
    length_before = np.linalg.norm(stretch[:-1] - movement, axis=1)
    stored = 0.5 * stiffness * length * length
    bound = stored[0] - stored[-1] + 0.5 * stiffness * (movement * movement).sum()
    return EnergyBalance(
        work_j=float((trace.force[:-1] * movement).sum()),
        bound_j=float(bound),
        recede_m=float(np.maximum(length[1:] - length_before, 0.0).max(initial=0.0)),
        stored_j=float(stored.max()),
    )


def passivity_cases(
    on: Fixture | str, rule: Rule, stiffness: float, cycles: int = 20, seed: int = 9
) -> list[CaseResult]:
    """The results of a named scene, or of a bundle's own points, lines and arcs, or triangles.

    Two results: the work over random cycles against its bound, and the largest step away from the
    HIP against the band. None where no ball fits beside the cloud. `stiffness` is K [N/m].
    """
    scene, contact_source, band = contacts.contacts_on(on, rule)
    places = list(contact_source)
    if not places:
        return []
    rng = np.random.default_rng(seed)
    make_engine = EngineMaker(rule, band)
    cycles_per_place = -(-cycles // len(places))
    balances = []
    for contact in places:
        engine = make_engine(contact)
        engine_band = engine.parameters.band
        for _ in range(cycles_per_place):
            hips = random_cycle(contact, rng)
            engine.reset(hips[0])
            trace = engine.run(hips)
            balances.append(energy_balance(trace, hips, 1.0, engine.parameters.ignore_axis))

    works = []
    bounds = []
    excesses = []
    for balance in balances:
        works.append(stiffness * balance.work_j)
        bounds.append(stiffness * balance.bound_j)
        excesses.append(balance.excess)
    count = len(balances)
    active = sum(excess > 0 for excess in excesses)
    recede = max(balance.recede_m for balance in balances)
    energy = CaseResult(
        case=f"passivity/{scene}/{rule}",
        outcome=outcome_of(active == 0, rule),
        detail=f"net work above the sampled-data bound in {active} of {count} random closed "
        f"cycles; largest (work - bound) / stored energy {max(excesses):+.2g}",
        limit=0.0,
        measured=max(excesses),
        unit="of the energy stored",
        values={
            "scene": scene,
            "rule": rule,
            "cycles": count,
            "active_cycles": active,
            "work_j": works,
            "bound_j": bounds,
            "excess": excesses,
        },
    )
    receding = CaseResult(
        case=f"recede/{scene}/{rule}",
        outcome=outcome_of(recede <= engine_band + ROUNDING_M, rule),
        detail=f"|proxy - HIP| grew in one tick by at most {recede / engine_band:.2f} bands",
        limit=engine_band,
        measured=recede,
        unit="m",
        values={"scene": scene, "rule": rule},
    )
    return [energy, receding]
