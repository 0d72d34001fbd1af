"""The markers of a review, and what the registration says of them.

A marker is shown on the slice. Markers that were given in the patient's frame are shown where they
project onto a DICOM slice; each keeps its distance from it when it is moved.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.display import MM, Report
from vfplan.errors import MarkerError, SettingError, VfplanError
from vfplan.fixture import Stroke
from vfplan.geometry.lines import Array, unit_normal
from vfplan.images.read import PlannedImage
from vfplan.markers.correspondences import Correspondences, read_markers, read_sides
from vfplan.planning.settings import FixtureSettings
from vfplan.registration.models import fewest_markers
from vfplan.registration.registration import Registration, fit_registration, own_bound

# Places along a curve at which its bound is computed: a bound bends slowly.
BOUND_PLACES = 50


@dataclass(frozen=True)
class Marker:
    """One marker, as far as it is known.

    Parameters
    ----------
    label
        Its name.
    place
        (u, v) on the slice [px].
    target_m
        (x, y, z) in front of the robot.
    sigma_m
        Standard deviations of the target: none, one, or one an axis.
    is_used
        Whether the registration rests on it.
    depth_m
        Distance from the slice's plane, for markers of the patient's frame.
    residual_m
        Distance from where the registration says it lies.
    residual_px
        From its place to there, in the plane of the slice.
    is_deleted
        Whether a person took it out of the list; it is told as one that is left out.
    """

    label: str
    place: tuple[float, ...] | None = None
    target_m: tuple[float, float, float] | None = None
    sigma_m: tuple[float, ...] = ()
    is_used: bool = True
    depth_m: float = 0.0
    residual_m: float | None = None
    residual_px: tuple[float, float] | None = None
    is_deleted: bool = False

    @property
    def is_whole(self) -> bool:
        """Whether both of its positions are known."""
        return self.place is not None and self.target_m is not None


@dataclass(frozen=True, eq=False)
class Fit:
    """Markers, and the registration that those in use determine.

    Parameters
    ----------
    markers
        In the order in which they were given.
    settings
        The model, the weights and the gates.
    pixel_spacing_mm
        Of the slice (along u, along v); `None` if nobody knows.
    T_patient_image
        (3, 3) from [u v 1] to the patient's frame [m], if the markers are given there; else `None`.
    given
        The markers as they were read, while nobody has changed one; else `None`.
    """

    markers: tuple[Marker, ...] = ()
    settings: FixtureSettings = field(default_factory=FixtureSettings)
    pixel_spacing_mm: tuple[float, float] | None = None
    T_patient_image: Array | None = None
    given: Correspondences | None = None

    @property
    def used(self) -> tuple[Marker, ...]:
        """Those that the registration rests on."""
        return tuple(marker for marker in self.markers if marker.is_used and marker.is_whole)

    @property
    def registration(self) -> Registration | None:
        """The transform to the robot's frame; `None` if the markers give none."""
        return self._fitted[0]

    @property
    def why_not(self) -> str:
        """Why there is no registration; empty if there is one."""
        return self._fitted[1]

    def pairs(self) -> Correspondences:
        """The markers in use, joined as those of a file are."""
        if self.given is not None:
            return self.given
        used = self.used
        places = np.array([marker.place for marker in used])
        source = self.to_source(places, np.array([marker.depth_m for marker in used]))
        target = np.array([marker.target_m for marker in used])
        # Deviations of the targets count where all markers have them, each one or one an axis.
        sigma = None
        if {len(marker.sigma_m) for marker in used} in ({1}, {3}):
            sigma = np.array([marker.sigma_m for marker in used]).squeeze()
        labels = tuple(marker.label for marker in used)
        frame = "image" if self.T_patient_image is None else "patient_lps"
        values = [labels, source.tolist(), target.tolist(), [m.sigma_m for m in used]]
        sha256 = hashlib.sha256(json.dumps(values).encode()).hexdigest()
        return Correspondences(labels, source, frame, target, sigma, inputs={"markers": sha256})

    @cached_property
    def _fitted(self) -> tuple[Registration | None, str]:
        count, in_space = len(self.used), self.T_patient_image is not None
        needed, _ = fewest_markers(self.settings.model, 3 if in_space else 2)
        if count < needed:
            return None, f"{count} markers are whole and in use. At least {needed} are needed."
        spacing_m = None
        if self.pixel_spacing_mm is not None and not in_space:
            spacing_m = tuple(size / MM for size in self.pixel_spacing_mm)
        pairs = self.pairs()
        try:
            registration = fit_registration(
                pairs.source, pairs.target, model=self.settings.model, robust=self.settings.robust,
                labels=pairs.labels, pixel_spacing=spacing_m, sigma=pairs.sigma,
                seen_from=self.settings.seen_from,
            )  # fmt: skip
        except VfplanError as error:
            return None, error.message
        return registration, ""

    def to_source(self, places: NDArray, depth_m: NDArray | float = 0.0) -> Array:
        """Places on the slice (M, 2) [px] in the markers' frame: (M, 2) [px] or (M, 3) [m]."""
        places = np.asarray(places, float).reshape(-1, 2)
        if self.T_patient_image is None:
            return places
        on_slice = np.column_stack([places, np.ones(len(places))]) @ self.T_patient_image.T
        depths = np.broadcast_to(depth_m, len(places))
        return on_slice + depths[:, None] * unit_normal(self.T_patient_image)

    @property
    def metres_per_step(self) -> Array | None:
        """(3, 2) where a step of a pixel along u and along v leads in front of the robot [m]."""
        if self.registration is None:
            return None
        linear = self.registration.T_target_source[:3, :-1]
        if self.T_patient_image is None:
            return linear
        return linear[:, :3] @ self.T_patient_image[:, :2]

    @cached_property
    def mm_per_px(self) -> float | None:
        """How long a pixel is in front of the robot; `None` if there is no registration."""
        return None if self.metres_per_step is None else MM * size_of(self.metres_per_step)

    def tre95_m(self, strokes: Sequence[Stroke]) -> float | None:
        """The 95 % bound of the error over a whole curve, by the markers and of its own [px]."""
        if self.registration is None or len(strokes) == 0:
            return None
        step = max(1, sum(len(stroke.points) for stroke in strokes) // BOUND_PLACES)
        bound = bound95_m(self.registration, strokes, self.T_patient_image, step)
        return float(bound.max()) if np.isfinite(bound).all() else None

    @cached_property
    def rows(self) -> list[Report]:
        """Each marker with its residual, as the page shows it."""
        registration, steps = self.registration, self.metres_per_step
        loo_m = {}
        if registration is not None:
            onto_slice = np.linalg.pinv(steps)
            left_out = zip(registration.labels, registration.loo_m.tolist(), strict=True)
            loo_m = {label: value for label, value in left_out if np.isfinite(value)}
        rows = []
        for marker in self.markers:
            if marker.is_deleted:
                continue
            residual_m = residual_px = None
            if registration is not None and marker.is_whole:
                reached = registration.apply(self.to_source(marker.place, marker.depth_m))[0]
                residual = np.array(marker.target_m) - reached
                residual_m = float(np.linalg.norm(residual))
                residual_px = (onto_slice @ residual).tolist()
            rows.append({
                "label": marker.label, "place_px": marker.place, "target_m": marker.target_m,
                "used": marker.is_used, "depth_m": marker.depth_m, "residual_m": residual_m,
                "residual_px": residual_px, "loo_m": loo_m.get(marker.label),
            })  # fmt: skip
        return rows

    def without(self, labels: Sequence[str]) -> Fit:
        """The fit that was given, resting on its markers but those of these labels."""
        markers = tuple(replace(one, is_used=one.label not in labels) for one in self.markers)
        kept = self.with_markers(markers)
        if kept.used == markers:
            return self
        given = replace(kept.pairs(), inputs={}, tool=self.given.tool, tip=self.given.tip)
        return replace(kept, given=given)

    def index(self, name: Any) -> int:
        """A marker's place in the list by its label."""
        labels = [marker.label for marker in self.markers if not marker.is_deleted]
        if name not in labels:
            text = f"There is no marker {name!r}. The markers are: {', '.join(labels) or 'none'}."
            raise SettingError(text, code="no-such-marker")
        return labels.index(name)

    def with_marker(self, name: Any, **changes: Any) -> Fit:
        """The fit with the marker of this label changed."""
        markers, number = list(self.markers), self.index(name)
        markers[number] = replace(markers[number], **changes)
        return self.with_markers(tuple(markers))

    def with_markers(self, markers: tuple[Marker, ...]) -> Fit:
        """The fit of other markers; raises `SettingError` for a label that two of them have."""
        labels = Counter(marker.label for marker in markers if not marker.is_deleted)
        for label, count in labels.items():
            if count > 1:
                text = f"There is a marker {label!r} already. Give each its own label."
                raise SettingError(text, code="label-exists")
        # The deleted ones come last; one whose label is given anew is replaced by that.
        listed = tuple(marker for marker in markers if not marker.is_deleted)
        deleted = tuple(one for one in markers if one.is_deleted and one.label not in labels)
        return replace(self, markers=listed and listed + deleted, given=None)


def size_of(plane: NDArray) -> float:
    """The geometric mean of a pixel's sides [m], of the first two columns of a plane."""
    return float(np.sqrt(np.prod(np.linalg.svd(plane[:, :2])[1])))


def bound95_m(
    registration: Registration, strokes: Sequence[Stroke], place: NDArray | None, step: int = 1
) -> Array:
    """The 95 % bound at every so many points of strokes, by the markers and of their own [m].

    `place` (3, 3) takes (u, v, 1) to the patient's frame of a registration that begins there. The
    markers' bound bends slowly; the strokes' own is the largest near each place.
    """
    points, own = np.vstack([stroke.points for stroke in strokes]), own_bound(strokes)
    own = np.maximum.reduceat(own, np.arange(0, len(own), step))
    points = points[::step]
    if place is not None:
        points, own = points @ place[:, :2].T + place[:, 2], own * size_of(place)
    return registration.tre95_curve_m(points, own)


def fit_of(pairs: Correspondences, image: PlannedImage, settings: FixtureSettings) -> Fit:
    """The markers of a file on their slice.

    Raises
    ------
    SettingError
        Markers of the patient's frame, and a slice that does not say where it lies; or markers
        whose other side is not the robot's.
    """
    if pairs.target_frame != "robot_base":
        raise SettingError(
            f"The second side of the markers is in {pairs.target_frame}, and the page reviews "
            "plans for a robot. Give the positions in front of the robot as a table.",
            code="markers-not-for-robot",
        )
    place, places, depths = None, pairs.source, np.zeros(len(pairs.labels))
    if pairs.source_frame != "image":
        if image.T_patient_image is None:
            raise SettingError(
                "The markers are given in the patient's frame, and the slice does not say where "
                "it lies there. Give the DICOM slice.",
                code="slice-without-place",
            )
        place = image.T_patient_image[:3]
        depths = (pairs.source - place[:, 2]) @ unit_normal(place)
        places = (pairs.source - place[:, 2]) @ np.linalg.pinv(place[:, :2]).T
    markers = []
    for k, label in enumerate(pairs.labels):
        sigma = () if pairs.sigma is None else tuple(np.atleast_1d(pairs.sigma[k]).tolist())
        at, target = tuple(places[k].tolist()), tuple(pairs.target[k].tolist())
        markers.append(Marker(str(label), at, target, sigma, depth_m=float(depths[k])))
    return Fit(tuple(markers), settings, image.pixel_spacing_mm, place, pairs)


def fit_of_files(
    path: str | Path, path2: str | Path | None, image: PlannedImage, settings: FixtureSettings
) -> tuple[Fit, dict[str, str]]:
    """The markers of the files of a review, and each file's SHA-256 by its role.

    One file with one side is enough: the other side is then clicked or typed on the page. Raises as
    `read_markers` and `fit_of` do.
    """
    try:
        pairs = read_markers(path, path2, common=settings.common, spacing_mm=image.pixel_spacing_mm)
    except MarkerError as error:
        if error.code != "one-side-only":
            raise
        (side,) = read_sides(Path(path), image.pixel_spacing_mm)
        name = {"image": "place", "robot_base": "target_m"}.get(side.frame)
        if name is None:
            raise
    else:
        return fit_of(pairs, image, settings), pairs.inputs
    spreads = [()] * len(side.labels) if side.sigma is None else np.atleast_2d(side.sigma.T).T
    rows = zip(side.labels, side.positions.tolist(), spreads, strict=True)
    markers = tuple(
        Marker(label, sigma_m=tuple(spread), **{name: tuple(position)})
        for label, position, spread in rows
    )
    return Fit(markers, settings, image.pixel_spacing_mm), {"markers": side.sha256}
