"""The mask's skeleton as a graph: pieces of ink with their branches, junctions and ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.curve import tuned
from vfplan.curve.coverage import Ink
from vfplan.errors import CurveError

STAIR = 1.05
"""Times by which a staircase of pixels is longer than its line."""


@dataclass(frozen=True, eq=False)
class Piece:
    """One connected piece of ink.

    Parameters
    ----------
    pixels
        (N, 2) its pixels (u, v).
    path
        (M, 2) pixels (u, v) of its longest branch, in order.
    closed
        Whether that branch is a ring.
    junctions
        (J, 2) pixels where branches meet.
    length, width
        Of all its branches [px], and its area over that length [px].
    strength
        Mean coverage along the path.
    """

    pixels: NDArray[np.int64]
    path: NDArray[np.int64]
    closed: bool
    junctions: NDArray[np.int64]
    length: float
    width: float
    strength: float

    @property
    def is_part(self) -> bool:
        """Whether it may be a part of a line: no dot and no panel."""
        return self.length >= tuned.MIN_ASPECT / 2 * self.width


@dataclass(frozen=True, eq=False)
class Graph:
    """A skeleton's pixels and how they hang together.

    Parameters
    ----------
    pixels
        (N, 2) (u, v), sorted by row, then by column.
    edges
        (E, 2) neighbours within branches, as indices of pixels.
    junction
        (N,) bool, three or more branches meet there.
    """

    pixels: NDArray[np.int64]
    edges: NDArray[np.int64]
    junction: NDArray[np.bool_]

    @classmethod
    def of(cls, bone: NDArray[np.bool_]) -> Graph:
        """The graph of a (H, W) skeleton with a border of one free pixel.

        Two diagonal neighbours that share a straight one are no edge: the corner of a stair is no
        fork.
        """
        v, u = np.nonzero(bone)
        place = v * bone.shape[1] + u
        pairs = []
        for dv, du in ((0, 1), (1, 0), (1, 1), (1, -1)):
            target = _index(place, place + dv * bone.shape[1] + du)
            keep = target >= 0
            if dv and du:
                keep &= ~bone[v + dv, u] & ~bone[v, u + du]
            pairs.append(np.column_stack([np.flatnonzero(keep), target[keep]]))
        edges = np.concatenate(pairs)
        junction = np.bincount(edges.ravel(), minlength=len(u)) > 2
        inner = edges[~junction[edges].any(1)]
        return cls(np.column_stack([u, v]), inner, junction)

    def branches(self) -> list[tuple[NDArray[np.int64], bool]]:
        """The pixels of each branch in order, and whether it is a ring; by their first pixels."""
        neighbours: list[list[int]] = [[] for _ in self.pixels]
        for a, b in self.edges.tolist():
            neighbours[a].append(b)
            neighbours[b].append(a)
        waiting = ~self.junction
        found = []
        for start in np.flatnonzero(waiting).tolist():
            if waiting[start] and len(neighbours[start]) < 2:
                found.append((_walk(start, neighbours, waiting), False))
        # What is left are rings. Each is cut between two neighbours, and walked the other way.
        for start in self.edges[:, 0].tolist():
            if waiting[start]:
                found.append((_walk(start, neighbours, waiting), True))
        found.sort(key=lambda branch: min(branch[0]))
        return [(self.pixels[branch], closed) for branch, closed in found]


def _walk(start: int, neighbours: list[list[int]], waiting: NDArray[np.bool_]) -> list[int]:
    """A branch from one of its pixels on; its pixels wait no longer."""
    path = []
    ahead = [start]
    while ahead:
        path.append(ahead[-1])
        waiting[ahead[-1]] = False
        ahead = [k for k in neighbours[ahead[-1]] if waiting[k]]
    return path


def find_groups(ink: Ink) -> list[NDArray[np.int64]]:
    """The pixels (N, 2) of each connected piece of ink that is no speck.

    Raises `CurveError` where there are more than anybody draws.
    """
    import cv2

    pixels = cv2.findNonZero(ink.mask.view(np.uint8))
    if pixels is None:
        return []
    pixels = pixels.reshape(-1, 2).astype(np.int64)
    kind = cv2.CV_16U
    if len(pixels) >= 2**16:  # There may be as many pieces.
        kind = cv2.CV_32S
    _, labels = cv2.connectedComponents(ink.mask.view(np.uint8), connectivity=8, ltype=kind)
    label = labels[pixels[:, 1], pixels[:, 0]].astype(np.int64)
    order = np.argsort(label, kind="stable")
    groups = np.split(pixels[order], np.flatnonzero(np.diff(label[order])) + 1)
    groups = [group for group in groups if len(group) >= tuned.SPECK_PX]
    if len(groups) > tuned.MAX_PIECES:
        raise CurveError(
            f"There are {len(groups)} pieces of ink in the pen's colour, so this is noise or a "
            "coloured picture. Look in a part of it: --roi U,V,WIDTH,HEIGHT.",
            code="too-many-pieces",
            numbers={"pieces": len(groups), "pieces_max": tuned.MAX_PIECES},
        )
    return groups


def pen_mask(ink: Ink, groups: list[NDArray[np.int64]]) -> NDArray[np.bool_]:
    """(H, W) bool, the pixels that the pen covers by half of its own strength.

    Unlike `Ink.mask` it is not smoothed, so a crisp line is as wide in it as it was drawn.
    """
    mask = np.zeros(ink.mask.shape, bool)
    for group in groups:
        members = half_covered(ink, group)
        mask[members[:, 1], members[:, 0]] = True
    return mask


def half_covered(ink: Ink, pixels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Those of a piece's pixels that have half of its own strength."""
    coverage = ink.coverage[pixels[:, 1], pixels[:, 0]]
    return pixels[coverage > tuned.HALF * np.quantile(coverage, 0.9)]


def find_pieces(ink: Ink, groups: list[NDArray[np.int64]]) -> list[Piece]:
    """Every piece of ink that may be a line or a part of one, the longest first."""
    pieces = []
    for group in groups:
        if np.ptp(group, axis=0).max() > tuned.SPECK_PX:
            piece = _piece(group, ink)
            if piece is not None:
                pieces.append(piece)
    return sorted(pieces, key=lambda piece: (-piece.length, *piece.path[0]))


def _piece(pixels: NDArray[np.int64], ink: Ink) -> Piece | None:
    """One connected piece; `None` where its skeleton is a single pixel or junctions only."""
    corner = pixels.min(0) - 2
    columns, rows = pixels.max(0) - corner + 3
    box = np.zeros((rows, columns), bool)
    box[pixels[:, 1] - corner[1], pixels[:, 0] - corner[0]] = True
    graph = Graph.of(_core.thinned(box).astype(bool))
    branches = graph.branches()
    if not branches:
        return None
    path, closed = max(branches, key=lambda branch: len(branch[0]))
    path = path + corner
    length = sum(_length(*branch) for branch in branches)
    strength = float(ink.coverage[path[:, 1], path[:, 0]].mean(dtype=np.float32))
    junctions = graph.pixels[graph.junction] + corner
    return Piece(pixels, path, closed, junctions, length, len(pixels) / length, strength)


def _length(path: NDArray, closed: bool) -> float:
    """Length along pixels, less what the staircase adds [px]."""
    steps = np.diff(path, axis=0)
    length = np.hypot(*steps.T).sum()
    if closed:
        length += np.hypot(*(path[0] - path[-1]))
    return float(length / STAIR) + 1.0


def _index(places: NDArray, wanted: NDArray) -> NDArray[np.int64]:
    """The index of each wanted value in sorted places; -1 where it is not there."""
    at = np.minimum(np.searchsorted(places, wanted), len(places) - 1)
    return np.where(places[at] == wanted, at, -1)
