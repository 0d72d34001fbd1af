"""The markers of a review, and what the registration says of them."""

from __future__ import annotations

import csv
import io
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError, VfplanError
from vfplan.markers import Correspondences, read_markers
from vfplan.planning import FixtureSettings
from vfplan.registration import Registration, fit_registration

MIN_MARKERS = 3
"""Markers that determine a transform from a plane into space."""


@dataclass(frozen=True)
class Marker:
    """One marker: where it is on the slice [px] and in front of the robot [m], as far as known."""

    label: str
    place_px: tuple[float, float] | None = None
    target_m: tuple[float, float, float] | None = None
    sigma_m: tuple[float, ...] = ()
    is_used: bool = True

    @property
    def is_whole(self) -> bool:
        """Whether both of its positions are known."""
        return self.place_px is not None and self.target_m is not None


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
        Of the slice (along u, along v); `None` when nobody knows.
    """

    markers: tuple[Marker, ...]
    settings: FixtureSettings
    pixel_spacing_mm: tuple[float, float] | None = None

    @property
    def used(self) -> tuple[Marker, ...]:
        """Those that the registration rests on."""
        return tuple(marker for marker in self.markers if marker.is_used and marker.is_whole)

    @cached_property
    def _fitted(self) -> tuple[Registration | None, str]:
        used = self.used
        if len(used) < MIN_MARKERS:
            return (
                None,
                f"{len(used)} markers are whole and in use; at least {MIN_MARKERS} are needed",
            )
        sigmas = [marker.sigma_m for marker in used]
        same = len({len(sigma) for sigma in sigmas}) == 1
        sigma = np.squeeze(np.array(sigmas), -1 if len(sigmas[0]) == 1 else ()) if same else None
        spacing = self.pixel_spacing_mm
        try:
            fitted = fit_registration(
                np.array([marker.place_px for marker in used]),
                np.array([marker.target_m for marker in used]),
                model=self.settings.model,
                robust=self.settings.robust,
                labels=[marker.label for marker in used],
                pixel_spacing=spacing and (1e-3 * spacing[0], 1e-3 * spacing[1]),
                sigma=sigma if same and sigmas[0] else None,
                seen_from=self.settings.seen_from,
            )
        except VfplanError as error:
            return None, error.message
        return fitted, ""

    @property
    def registration(self) -> Registration | None:
        """The transform from the slice to the robot; `None` where the markers give none."""
        return self._fitted[0]

    @property
    def why_not(self) -> str:
        """Why there is no registration; empty where there is one."""
        return self._fitted[1]

    @cached_property
    def mm_per_px(self) -> float | None:
        """How long a pixel is in front of the robot, or by the file's pixel spacing."""
        if self.registration is not None:
            axes = self.registration.T_target_source[:, :2]
            return 1e3 * float(np.sqrt(np.prod(np.linalg.norm(axes, axis=0))))
        if self.pixel_spacing_mm is None:
            return None
        return float(np.sqrt(self.pixel_spacing_mm[0] * self.pixel_spacing_mm[1]))

    def tre95_m(self, points: NDArray) -> float | None:
        """The 95 % bound of the registration error over a whole curve (M, 2) [px]."""
        if self.registration is None or not len(points):
            return None
        # A bound bends slowly: fifty places show its largest value.
        sample = points[:: max(1, len(points) // 50)]
        bound = float(np.max(self.registration.tre95_curve_m(sample)))
        return bound if np.isfinite(bound) else None

    def describe(self) -> list[dict[str, Any]]:
        """Each marker with its residual, as the page shows it."""
        fitted = self.registration
        loo = {}
        if fitted is not None:
            for label, value in zip(fitted.labels, fitted.loo_m, strict=True):
                loo[label] = float(value) if np.isfinite(value) else None
        return [self._describe(marker, fitted, loo) for marker in self.markers]

    def _describe(
        self, marker: Marker, fitted: Registration | None, loo: dict[str, float | None]
    ) -> dict[str, Any]:
        shown: dict[str, Any] = {
            "label": marker.label,
            "place_px": None if marker.place_px is None else list(marker.place_px),
            "target_m": None if marker.target_m is None else list(marker.target_m),
            "used": marker.is_used,
            "residual_m": None,
            "residual_px": None,
            "loo_m": loo.get(marker.label) if marker.is_used else None,
        }
        if fitted is None or not marker.is_whole:
            return shown
        matrix = fitted.T_target_source
        reached = matrix @ [*marker.place_px, 1.0]
        miss = np.array(marker.target_m) - reached
        shown["residual_m"] = float(np.linalg.norm(miss))
        shown["residual_px"] = (np.linalg.pinv(matrix[:, :2]) @ miss).tolist()
        return shown

    def table(self) -> str:
        """The markers in use as a CSV that every command reads."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        used = self.used
        width = min((len(marker.sigma_m) for marker in used), default=0)
        names = {0: [], 1: ["sigma_m"], 3: ["sigma_x_m", "sigma_y_m", "sigma_z_m"]}[width]
        writer.writerow(["label", "u_px", "v_px", "x_m", "y_m", "z_m", *names])
        for marker in used:
            sigma = marker.sigma_m[:width]
            numbers = [*marker.place_px, *marker.target_m, *sigma]
            writer.writerow([marker.label, *(repr(float(x)) for x in numbers)])
        return text.getvalue()

    @contextmanager
    def as_file(self) -> Iterator[Path]:
        """A file with the markers in use, for as long as the block runs."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "markers.csv"
            path.write_text(self.table(), encoding="utf-8")
            yield path

    def index(self, name: Any) -> int:
        """A marker's place in the list by its label, or by its number from 0."""
        if isinstance(name, int) and not isinstance(name, bool) and 0 <= name < len(self.markers):
            return name
        for number, marker in enumerate(self.markers):
            if marker.label == name:
                return number
        raise SettingError(
            f"there is no marker {name!r}; there are {', '.join(m.label for m in self.markers)}",
            code="no-such-marker",
            numbers={"markers": len(self.markers)},
        )

    def with_marker(self, number: int, **changes: Any) -> Fit:
        """The fit with one marker changed."""
        markers = list(self.markers)
        markers[number] = replace(markers[number], **changes)
        return replace(self, markers=tuple(markers))

    def refuse_label(self, label: str, besides: int | None = None) -> None:
        """Raise `SettingError` for a label that another marker has."""
        for number, marker in enumerate(self.markers):
            if marker.label == label and number != besides:
                raise SettingError(
                    f"there is a marker {label!r} already; each label may occur once",
                    code="label-exists",
                    numbers={"markers": len(self.markers)},
                )


def markers_of(pairs: Correspondences) -> tuple[Marker, ...]:
    """The markers of a file, whose source is the slice.

    Raises `SettingError` where they are given in the patient's frame.
    """
    if pairs.source_frame != "image":
        raise SettingError(
            f"The markers are given in frame {pairs.source_frame!r}, and the page shows them on "
            "the slice. Give them in pixels, or review the fixture that `vfplan plan` writes.",
            code="markers-not-on-slice",
        )
    markers = []
    for k, label in enumerate(pairs.labels):
        sigma = () if pairs.sigma is None else tuple(np.atleast_1d(pairs.sigma[k]).tolist())
        place = tuple(pairs.source[k].tolist())
        markers.append(Marker(str(label), place, tuple(pairs.target[k].tolist()), sigma))
    return tuple(markers)


def markers_of_table(text: str) -> tuple[Marker, ...]:
    """The markers of a pasted table; raises `MarkerError` as the reading of a file does."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pasted.csv"
        path.write_text(text, encoding="utf-8")
        return markers_of(read_markers(path))
