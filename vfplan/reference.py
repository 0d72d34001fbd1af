"""The paper's rule in NumPy, to be read beside the paper: Algorithms 1-4 and equations (1)-(8).

T. Li, A. Badre, H. D. Taghirad, M. Tavakoli, "Point-based 3D virtual fixture generating for
image-guided and robot-assisted surgery in orthopedics". Symbols are the paper's. Every point of the
cloud is looked at in every tick; nothing is cached, cured or sped up. Where the text leaves room,
the readings taken here are:

- Eq. (3) has two roots; the smaller counts when it is not negative. A point whose sphere the ray
  misses, or that lies behind, gives no root; with no root at all d = |u|.
- Eq. (7): the larger root, maximum over the entrenched points.
- "HIP inside the VF" is n·u < 0.
- Special case 2 of Algorithm 2 compares means over the in-neighbour points.
- A point exactly at the proxy adds nothing to eq. (1); a sum at or below 1e-12 of the sum of the
  weights counts as zero and gives n = 0. In an ideal ring of points the order of summation alone
  decides what is left: such states have no answer that two programs could agree on.
- φ takes r, not r - r_v, as eq. (1) and (2) have it; with r_v >= r3 - r1 it vanishes on contact.
- A step along a vector of length 0 is 0. State and normal are those the tick began with.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vfplan.engine.parameters import MAX_COORDINATE, ProxyParameters, Vector, check_points
from vfplan.engine.proxy import Status, Step, Trace, check_hip, check_path
from vfplan.errors import SettingError
from vfplan.geometry import ROUNDING


class PaperProxy:
    """The paper's proxy, one NumPy pass over the whole cloud a tick; rule "paper" only.

    Takes the same arguments and answers the same calls as `vfplan.ProxyEngine`. Until `reset` is
    called, the first HIP is also the first proxy, as Algorithm 1 initialises it.

    Parameters
    ----------
    points
        (N, 3) cloud [m].
    rule
        "paper".
    parameters
        Table I: contact_radius, band, point_radius, stiffness, ignore_axis, outer_radius, gain; see
        `ProxyParameters.make`.

    Raises
    ------
    SettingError, SceneError
        As `ProxyParameters.make`; another rule than "paper".
    """

    def __init__(
        self, points: ArrayLike, *table: Any, rule: str = "paper", **parameters: Any
    ) -> None:
        if rule != "paper":
            raise SettingError(
                f"rule is {rule!r}, and the reference renders 'paper' only. Give that"
            )
        self.parameters = ProxyParameters.make(points, *table, rule="paper", **parameters)
        self._cloud = self._across(check_points(points))
        self._proxy: Vector | None = None
        self._normal, self._force, self._state = np.zeros(3), np.zeros(3), -1

    @property
    def left_out(self) -> dict[str, int]:
        """Nothing: the reference does all of the work in every tick."""
        return {}

    def reset(self, hip: ArrayLike) -> None:
        """Put the proxy at `hip` (3,) [m], wherever that is."""
        self._proxy = check_hip(hip, finite=True).copy()
        self._normal, self._force, self._state = np.zeros(3), np.zeros(3), -1

    def step(self, hip: ArrayLike) -> Step:
        """One servo loop of Algorithm 1 for the HIP at `hip` (3,) [m]."""
        return self._tick(check_hip(hip))

    def run(self, hips: ArrayLike) -> Trace:
        """One tick for each row of `hips` (T, 3) [m], from the current proxy on."""
        return Trace.of([self._tick(hip) for hip in check_path(hips)])

    def distance(self, positions: ArrayLike) -> Vector:
        """Distance (T,) [m] of `positions` (T, 3) [m] from the nearest point."""
        places = self._across(check_path(positions))
        return np.array([np.linalg.norm(self._cloud - x, axis=1).min() for x in places])

    def _tick(self, hip: Vector) -> Step:
        if not np.all(np.abs(hip) <= MAX_COORDINATE):  # NaN, infinite or absurd: stay, say so
            proxy = np.zeros(3) if self._proxy is None else self._proxy
            return Step(proxy, self._normal, self._force, self._state, Status.BAD_HIP)
        if self._proxy is None:
            self._proxy = hip.copy()  # Algorithm 1: P_proxy <- P_HIP
        self._state, self._normal, moved = main_algorithm(
            self._cloud, self._across(self._proxy), self._across(hip), self.parameters
        )
        self._proxy = moved + (hip - self._across(hip))  # Along an ignored axis: HIP's coordinate.
        self._force = virtual_force(self._across(self._proxy - hip), self.parameters)
        return Step(self._proxy, self._normal, self._force, self._state, Status.OK)

    def _across(self, x: Vector) -> Vector:
        """P x with P = I - a aᵀ: the part across the ignored axis; x itself without one."""
        a = self.parameters.ignore_axis
        if a is None:
            return x
        # Not x @ a, which rounds otherwise in a row than alone: on a point the distance is 0.
        ahead = x[..., 0] * a[0] + x[..., 1] * a[1] + x[..., 2] * a[2]
        return x - ahead[..., None] * a


def main_algorithm(
    p: Vector, proxy: Vector, hip: Vector, par: ProxyParameters
) -> tuple[int, Vector, Vector]:
    """Algorithm 1, one servo loop: state, normal n and the proxy's new position.

    Parameters
    ----------
    p
        (N, 3) cloud [m].
    proxy, hip
        (3,) P_proxy and P_HIP [m].
    par
        Table I.
    """
    r1, r2, r3, rv = par.r1, par.r2, par.outer_radius, par.point_radius
    de = np.linalg.norm(p - proxy, axis=1)
    entrenched = de < r1 + rv
    in_contact = (r1 + rv <= de) & (de <= r2 + rv)
    free_motion = (r2 + rv < de) & (de < r3 + rv)
    in_neighbour = p[entrenched | in_contact | free_motion]

    if entrenched.any():
        state = 2
    elif in_contact.any():
        state = 1
    else:
        state = int(free_motion.any()) - 1
    n = normal_vector(in_neighbour, proxy, r1, r3) if state >= 0 else np.zeros(3)

    u = hip - proxy
    if state == 0:
        s = step_free_motion(in_neighbour, proxy, hip, u, n, par)
    elif state == 1:
        s = step_in_contact(u, n, par)
    elif state == 2:
        s = step_entrenched(p[entrenched], proxy, n, par)
    else:
        s = u  # Algorithm 4, no neighbour: s = P_HIP - P_proxy
    return state, n, proxy + s


def normal_vector(p: Vector, proxy: Vector, r1: float, r3: float) -> Vector:
    """Eq. (1): the weighted mean of the unit vectors from the points to the proxy, normalised."""
    outward = proxy - p
    r = np.linalg.norm(outward, axis=1)
    outward, r = outward[r > 0], r[r > 0]
    phi = wendland(r, r1, r3)
    nk = (outward / r[:, None] * phi[:, None]).sum(axis=0)
    length = np.linalg.norm(nk)
    # A sum of eq. (1) that cancels to rounding has no direction.
    return np.zeros(3) if length <= ROUNDING * phi.sum() else nk / length


def wendland(r: Vector, r1: float, r3: float) -> Vector:
    """Eq. (2): φ(r), 1 up to r1 and 0 from r3 on, smooth between."""
    t = np.clip((r - r1) / (r3 - r1), 0.0, 1.0)
    return (1 + 4 * t) * (1 - t) ** 4


def step_free_motion(
    p: Vector, proxy: Vector, hip: Vector, u: Vector, n: Vector, par: ProxyParameters
) -> Vector:
    """Algorithm 2 (state 0): towards the HIP, up to the first contact. `p`: in-neighbour points."""
    length = np.linalg.norm(u)
    if length == 0:
        return np.zeros(3)
    hip_inside = n @ u < 0
    d = min(first_contact(p - proxy, u / length, par.R), length)
    s = d * u / length
    if d == 0 and hip_inside:  # Special case 1
        up = projection(u, n)
        s = along(up, tangential_step(up, par))
    is_receding = np.linalg.norm(p - hip, axis=1).mean() > np.linalg.norm(p - proxy, axis=1).mean()
    if not hip_inside and is_receding:  # Special case 2
        s = u
    return s


def first_contact(w: Vector, direction: Vector, radius: float) -> float:
    """min d0_i of eq. (3): |w_i - d0 û| = r_c + r_v, w_i = p_i - P_proxy; inf without a root."""
    ahead = w @ direction
    discriminant = ahead**2 - (w**2).sum(axis=1) + radius**2
    hit = discriminant >= 0
    d0 = ahead[hit] - np.sqrt(discriminant[hit])
    d0 = d0[d0 >= 0]
    return float(d0.min()) if d0.size else np.inf


def projection(u: Vector, n: Vector) -> Vector:
    """Eq. (4): u_p, u projected onto the plane normal to n."""
    return u - (n @ u) * n


def tangential_step(up: Vector, par: ProxyParameters) -> float:
    """Eq. (5): the step size d, at most ξ r1."""
    return par.gain * min(float(np.linalg.norm(up)), par.r1)


def along(v: Vector, d: float) -> Vector:
    """d v / |v|; 0 when v is 0."""
    length = np.linalg.norm(v)
    return np.zeros(3) if length == 0 else d * v / length


def step_in_contact(u: Vector, n: Vector, par: ProxyParameters) -> Vector:
    """Algorithm 3 (state 1), eq. (6): along u_p with the HIP inside the VF, along u outside."""
    up = projection(u, n)
    d = tangential_step(up, par)
    return along(up if n @ u < 0 else u, d)


def step_entrenched(p: Vector, proxy: Vector, n: Vector, par: ProxyParameters) -> Vector:
    """Algorithm 4 (state 2): out along n by d = max d2_i of eq. (7). `p`: entrenched points."""
    w = p - proxy
    ahead = w @ n
    inside = par.R**2 - (w**2).sum(axis=1)  # > 0: the points are entrenched
    d2 = ahead + np.sqrt(ahead**2 + inside)
    return d2.max() * n


def virtual_force(across: Vector, par: ProxyParameters) -> Vector:
    """Eq. (8): F_v = K (P_proxy - P_HIP); with an ignored axis P K P (P_proxy - P_HIP).

    Parameters
    ----------
    across
        (3,) P (P_proxy - P_HIP) [m].
    par
        Table I.
    """
    force = par.stiffness * across
    a = par.ignore_axis
    return force if a is None else force - (force @ a) * a
