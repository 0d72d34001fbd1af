"""What every scene offers: a cloud, its exact geometry, the exact proxy, and scripted HIP paths."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from vfplan import fixture
from vfplan.engine.parameters import Vector, check_stiffness
from vfplan.engine.proxy import check_path
from vfplan.errors import SettingError
from vfplan.scenes import god_object, outline
from vfplan.scenes.outline import Pieces


@dataclass(frozen=True, eq=False)
class Scene(ABC):
    """A cloud with a known truth.

    Parameters
    ----------
    spacing
        Distance between neighbouring points [m].
    """

    spacing: float = 0.5e-3
    name: ClassVar[str]

    def __init_subclass__(cls) -> None:
        """Every scene is a dataclass as this one is, and has its class's name: "double-sheet"."""
        dataclass(frozen=True, eq=False)(cls)
        if "name" not in vars(cls):
            cls.name = re.sub("(?<=[a-z])(?=[A-Z])", "-", cls.__name__).lower()

    def __post_init__(self) -> None:
        if not 0 < self.spacing < 1:
            raise SettingError(f"spacing is {self.spacing:g} m. Give more than 0 and less than 1 m")

    @cached_property
    @abstractmethod
    def points(self) -> Vector:
        """(N, 3) cloud [m]."""

    @cached_property
    @abstractmethod
    def pieces(self) -> tuple[Pieces, ...]:
        """The exact geometry that the cloud samples."""

    @property
    @abstractmethod
    def routes(self) -> dict[str, Vector]:
        """Corners (K, 3) [m] of each scripted HIP path, the first one free of contact."""

    @property
    def ignore_axis(self) -> str | None:
        """What the engine is to be given: "z" for a scene in the plane."""
        return None

    def path(self, route: str, speed: float = 0.05, rate: float = 1000.0) -> Vector:
        """(T, 3) HIP positions along a route, `speed` [m/s] sampled at `rate` [Hz]."""
        if route not in self.routes:
            raise SettingError(f"route is {route!r}. Give one of {', '.join(self.routes)}")
        return travel(self.routes[route], speed, rate)

    def truth(self, hips: ArrayLike, radius: float = 5e-3, start: Vector | None = None) -> Vector:
        """The exact proxy (T, 3) [m] for each HIP (T, 3) [m], one after the other.

        The minimum of |x - HIP| over the positions at least `radius` = r_c + r_v from the exact
        geometry, reached by sliding from where the proxy was; `start` or the first HIP begins.

        Raises
        ------
        SceneError
            The start lies inside the fixture.
        """
        path = check_path(hips)
        proxy = np.asarray(start, float) if start is not None else path[0]
        flat = self._flat
        out = np.empty_like(path)
        for i, hip in enumerate(path):
            start_flat = proxy * flat
            target = hip * flat
            pieces = self.pieces_between(start_flat, target, radius)
            proxy = god_object.follow(pieces, start_flat, target, radius)
            out[i] = proxy + hip * (1 - flat)
        return out

    def sensitivity(self, hips: ArrayLike, truth: Vector, radius: float = 5e-3) -> Vector:
        """(T,) how far the exact proxy moves for a small step of the HIP, over that step's length.

        See `god_object.sensitivity`; `truth` (T, 3) is that of the HIPs (T, 3).
        """
        flat = self._flat
        values = []
        for proxy, hip in zip(truth * flat, check_path(hips) * flat, strict=True):
            pieces = self.pieces_between(proxy, hip, radius)
            values.append(god_object.sensitivity(pieces, proxy, hip, radius))
        return np.array(values)

    def pieces_between(self, proxy: Vector, hip: Vector, radius: float) -> tuple[Pieces, ...]:
        """The pieces that a proxy (3,) can meet on its path to a HIP (3,); here all of them."""
        return self.pieces

    def force(self, hips: ArrayLike, proxy: Vector, stiffness: ArrayLike = 1000.0) -> Vector:
        """Eq. (8) for HIPs and proxies (T, 3): the exact force (T, 3) [N]."""
        stretch = proxy - check_path(hips)
        if self.along_z:
            stretch = stretch * [1.0, 1.0, 0.0]
        return stretch * check_stiffness(stiffness)

    def clearance(self, x: Vector) -> Vector:
        """(T,) distance of the positions x (T, 3) from the exact geometry [m]."""
        distances = []
        for place in x * self._flat:
            pieces = self.pieces_between(place, place, 0.0)
            distances.append(god_object.look(pieces, place).distance.min())
        return np.array(distances)

    @property
    def _flat(self) -> Vector:
        """(3,) 1 for each coordinate of a position that counts, else 0."""
        return np.array([1.0, 1.0, 0.0]) if self.along_z else np.ones(3)

    @property
    def along_z(self) -> bool:
        """Whether the exact geometry is endless along z."""
        return False


class Drawn(Scene):
    """A scene drawn in the plane z = 0 and endless along z.

    Parameters
    ----------
    extrude
        0: points in the plane, the engine ignores z. Above 0: a cloud of that height [m] around
        z = 0, rows `spacing` apart, for an engine in 3-D.
    """

    extrude: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.extrude < 1:
            raise SettingError(f"extrude is {self.extrude:g} m. Give at least 0 and less than 1 m")

    @cached_property
    @abstractmethod
    def runs(self) -> tuple[outline.Run, ...]:
        """The outline."""

    @cached_property
    def points(self) -> Vector:
        """(N, 3) cloud [m]."""
        flat = outline.sample(self.runs, self.spacing)
        half = round(self.extrude / self.spacing / 2)
        heights = np.arange(-half, half + 1) * self.spacing
        return np.column_stack([np.tile(flat, (len(heights), 1)), np.repeat(heights, len(flat))])

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """The exact outline."""
        return outline.pieces(self.runs)

    @cached_property
    def lines_and_arcs(self) -> fixture.Pieces:
        """The exact outline as rule "exact" takes it."""
        return outline.lines_and_arcs(self.runs)

    def clearance(self, x: Vector) -> Vector:
        """See `Scene.clearance`; all positions at once."""
        return outline.distance(self.runs, x[:, :2])

    @property
    def ignore_axis(self) -> str | None:
        """ "z" when the cloud is flat."""
        return None if self.extrude else "z"

    @property
    def along_z(self) -> bool:
        """Always: the outline is endless along z."""
        return True


def travel(corners: Vector, speed: float, rate: float = 1000.0) -> Vector:
    """(T, 3) positions on straight lines between corners (K, 3), `speed` [m/s] at `rate` [Hz].

    Both ends belong to the path; the last step may be shorter.
    """
    if not (speed > 0 and rate > 0):
        raise SettingError(f"speed is {speed:g} m/s at {rate:g} Hz. Give both above 0")
    x, y, z = np.asarray(corners, float).T
    edges = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    s = np.append(np.arange(0.0, edges[-1], speed / rate), edges[-1])
    return np.column_stack([np.interp(s, edges, x), np.interp(s, edges, y), np.interp(s, edges, z)])


def corners_mm(*points: tuple[float, ...]) -> Vector:
    """The corners of a path in millimetres, (u, v) or (x, y, z), as (K, 3) in metres."""
    rows = [[*point, 0.0][:3] for point in points]
    return np.array(rows) * 1e-3
