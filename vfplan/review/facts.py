"""The numbers of a plan in words, as they stand beside the picture on a sheet."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

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
    heading = "Line"
    if not strokes:
        heading = "Geometry"
    facts = [(heading, _geometry_in_words(record, fixture, strokes))]
    if record.metres_per_px is not None:
        facts.append(("Pixel", _pixel_in_words(record.metres_per_px, fixture)))
    if fixture.registration is not None:
        facts.append(("Markers", _markers_in_words(fixture)))
    if fixture.frame == "image":
        facts.append(("Error of the registration", "not registered yet"))
    elif fixture.registration is not None:
        facts.append(("Error of the registration", _error_in_words(record, fixture)))
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
        facts.append(("The tool's centre keeps", f"{radius * 1e3:.2f} mm from the {what}"))
    return tuple(facts)


def _pixel_in_words(metres_per_px: float, fixture: Fixture) -> str:
    """The size of a pixel, and where it is from if markers and image say different sizes."""
    size = f"{metres_per_px * 1e3:.4g}"
    record = fixture.registration
    if record is None or record.source_frame != "image" or fixture.image is None:
        return f"{size} mm"
    if fixture.image.pixel_spacing_mm is None:
        return f"{size} mm"
    along_u, along_v = fixture.image.pixel_spacing_mm
    stated = f"{math.sqrt(along_u * along_v):.4g}"
    if stated == size:
        return f"{size} mm"
    return f"{size} mm by the markers, as the lengths here; {stated} mm by the image"


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
        shape = "open"
        if stroke.closed:
            shape = "closed"
        length = length_of(stroke.points, stroke.closed)
        words = f"{shape}, {length:.0f} px"
        if record.metres_per_px is not None:
            words += f" = {length * record.metres_per_px * 1e3:.1f} mm"
        if stroke.width is not None:
            words += f"; the pen is {stroke.width:.1f} px wide"
        parts.append(words)
    return ". ".join(parts)


def _markers_in_words(fixture: Fixture) -> str:
    record = fixture.registration
    left_out = labels_left_out(fixture)
    used = [k for k, label in enumerate(record.labels) if label not in left_out]
    worst = max(used, key=lambda k: record.residuals_m[k])
    markers = str(len(used))
    if len(used) < len(record.labels):
        markers += f" of {len(record.labels)}"
    return (
        f"{markers}, {record.model}; residual {record.fre_rms_m * 1e3:.2f} mm rms, "
        f"largest {record.residuals_m[worst] * 1e3:.2f} mm at {record.labels[worst]}"
    )


def labels_left_out(fixture: Fixture) -> list[str]:
    """The labels of the markers that a robust registration did not use."""
    return str(fixture.provenance.settings.get("markers_left_out", "")).split(",")


def _error_in_words(record: SheetInput, fixture: Fixture) -> str:
    if record.tre95_m is not None:
        bound = float(record.tre95_m.max())
        words = f"the whole line lies within {bound * 1e3:.2f} mm"
        if record.metres_per_px is not None:
            words += f" ({bound / record.metres_per_px:.1f} px)"
        return words + " (95 %)"
    if fixture.registration.tre_m is not None:
        largest = float(fixture.registration.tre_m.max())
        return f"{largest * 1e3:.2f} mm rms at most; the 95 % bound is not kept in the bundle"
    return "not known"
