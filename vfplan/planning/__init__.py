"""plan(image, markers) -> fixture: the whole pipeline, one step a line.

    image   -> pen coverage -> centre line         extract()
    markers -> transform with its error            register()
    centre line -> points -> rendering             register()

`extract` ends in a curve (a `Fixture` in the image's pixels); `register` begins with one.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vfplan.fixture import Fixture
from vfplan.planning.extracting import Extracted, describe_extraction, extract, planned_curve
from vfplan.planning.registering import Planned, register
from vfplan.planning.settings import ExtractSettings, FixtureSettings

__all__ = [
    "ExtractSettings", "Extracted", "FixtureSettings", "Plan", "Planned", "describe_extraction",
    "extract", "plan", "planned_curve", "register",
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Plan:
    """A fixture, and the two steps it came from."""

    fixture: Fixture
    extracted: Extracted
    registered: Planned

    @property
    def report(self) -> dict[str, Any]:
        """What `plan --json` reports."""
        return {"extract": self.extracted.report, "register": self.registered.report}

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should look at."""
        return self.extracted.warnings + self.registered.warnings


def plan(
    image: str | Path,
    markers: str | Path,
    markers2: str | Path | None = None,
    *,
    extraction: ExtractSettings | None = None,
    curve: str | Path | None = None,
    settings: FixtureSettings | None = None,
) -> Plan:
    """From a planned slice and its markers to a fixture in the robot's frame.

    Parameters
    ----------
    image
        The slice with the curve drawn on it.
    markers, markers2
        One file with both positions of each marker, or two joined by label.
    curve
        A vector curve drawn on the slice, instead of a pen's.
    extraction, settings
        How the curve is read, and how it becomes a fixture.

    Raises
    ------
    ImageError, CurveError, MarkerError, SettingError
    CheckFailed
        The registration's error may be larger than `settings.max_tre_m`.
    """
    extracted = extract(image, extraction, curve=curve)
    registered = register(extracted.fixture, markers, markers2, settings, image=extracted.image)
    return Plan(registered.fixture, extracted, registered)
