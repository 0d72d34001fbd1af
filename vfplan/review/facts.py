"""The numbers of a plan in words, as they stand beside the picture on a sheet."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vfplan.fixture import Fixture, Stroke
from vfplan.geometry.polyline import length_of

if TYPE_CHECKING:
    from vfplan.review.sheet_input import SheetInput


def facts_of(
    record: SheetInput,
    fixture: Fixture,
    strokes: tuple[Stroke, ...],
) -> tuple[tuple[str, str], ...]:
    """What stands beside the picture, in words."""
    heading = "Geometry" if not strokes else "Line"
    facts = [(heading, _geometry_in_words(record, fixture, strokes))]
    registration = fixture.registration
    if record.metres_per_px is not None:
        # Where markers and image say different sizes, both stand there.
        size = f"{record.metres_per_px * 1e3:.4g}"
        stated = size
        by_markers = registration is not None and registration.source_frame == "image"
        if by_markers and fixture.image is not None and fixture.image.pixel_spacing_mm is not None:
            along_u, along_v = fixture.image.pixel_spacing_mm
            stated = f"{math.sqrt(along_u * along_v):.4g}"
        words = f"{size} mm"
        if stated != size:
            words += f" by the markers, as the lengths here; {stated} mm by the image"
        facts.append(("Pixel", words))
    if registration is not None:
        left_out = labels_left_out(fixture)
        used = []
        for number, label in enumerate(registration.labels):
            if label not in left_out:
                used.append(number)
        worst = max(used, key=lambda number: registration.residuals_m[number])
        markers = str(len(used))
        if len(used) < len(registration.labels):
            markers += f" of {len(registration.labels)}"
        words = (
            f"{markers}, {registration.model}; residual "
            f"{registration.fre_rms_m * 1e3:.2f} mm rms, largest "
            f"{registration.residuals_m[worst] * 1e3:.2f} mm at "
            f"{registration.labels[worst]}"
        )
        facts.append(("Markers", words))
    error = "not known"
    if fixture.frame == "image":
        error = "not registered yet"
    elif record.tre95_m is not None:
        bound = float(record.tre95_m.max())
        error = f"moves the line by at most {bound * 1e3:.2f} mm"
        if record.metres_per_px is not None:
            error += f" ({bound / record.metres_per_px:.1f} px)"
        error += " (95 %)"
    elif registration is not None and registration.tre_m is not None:
        largest = float(registration.tre_m.max())
        error = f"{largest * 1e3:.2f} mm rms at most; the 95 % bound is not kept in the bundle"
    if fixture.frame == "image" or registration is not None:
        facts.append(("Error of the registration", error))
    if record.margin_m is not None:
        facts.append(("Margin", f"{record.margin_m * 1e3:.2f} mm on every side"))
    elif "margin" in fixture.provenance.settings:
        facts.append(("Margin", "the 95 % bound"))
    elif fixture.rendering is not None:
        facts.append(("Margin", "none"))
    if fixture.rendering is not None:
        radius = fixture.rendering.contact_radius + fixture.rendering.point_radius
        what = "line"
        if fixture.mesh is not None:
            what = "surface"
        elif fixture.curve is None:
            what = "points"
        stiffness = stiffness_in_words(fixture.rendering.stiffness)
        facts.append(
            ("The wall", f"{radius * 1e3:.2f} mm from the {what} to the tool's centre; {stiffness}")
        )
    return tuple(facts)


def _geometry_in_words(record: SheetInput, fixture: Fixture, strokes: tuple[Stroke, ...]) -> str:
    if not strokes and fixture.mesh is not None:
        return f"{len(fixture.points)} points, {len(fixture.mesh)} triangles"
    if not strokes:
        return f"{len(fixture.points)} points"
    parts = []
    for stroke in strokes:
        if not stroke.is_ordered:
            parts.append(f"{len(stroke.points)} pixels in no order")
            continue
        shape = "closed" if stroke.closed else "open"
        length = length_of(stroke.points, stroke.closed)
        words = f"{shape}, {length:.0f} px"
        if record.metres_per_px is not None:
            words += f" = {length * record.metres_per_px * 1e3:.1f} mm"
        if stroke.width is not None:
            words += f"; the pen is {stroke.width:.1f} px wide"
        parts.append(words)
    return ". ".join(parts)


def stiffness_in_words(stiffness: NDArray[np.float64]) -> str:
    """The stiffness of the wall, one number where it is the same along all axes."""
    x, y, z = stiffness
    return f"{x:g} N/m" if x == y == z else f"{x:g} N/m along x, {y:g} along y, {z:g} along z"


def labels_left_out(fixture: Fixture) -> list[str]:
    """The labels of the markers that a robust registration did not use."""
    return str(fixture.provenance.settings.get("markers_left_out", "")).split(",")
