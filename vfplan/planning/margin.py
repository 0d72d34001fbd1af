"""A safety margin against registration error: a fixture that is thicker by it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

from vfplan.errors import SettingError

if TYPE_CHECKING:
    from vfplan.fixture import Fixture
    from vfplan.planning.settings import FixtureSettings
    from vfplan.registration import Registration


@dataclass(frozen=True)
class Margin:
    """What was added to the point radius."""

    # "tre95", or "given" for a number of metres.
    kind: str
    # The margin [m], the same all along the curve.
    largest_m: float

    @property
    def report(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "kind": self.kind,
            "side": "both",
            "largest_m": self.largest_m,
            "added_point_radius_m": self.largest_m,
        }


def add_margin(
    curve: Fixture, registration: Registration, settings: FixtureSettings
) -> tuple[FixtureSettings, Margin]:
    """The settings with a point radius that is larger by the margin that they ask for.

    "tre95" is the largest value, along the curve, of the bound that the registration's error stays
    within over the whole curve with probability 0.95. A number is a margin [m].

    Raises SettingError: an unknown margin
    """
    margin = settings.margin
    if margin == "tre95":
        kind, bound_m = "tre95", float(registration.tre95_curve_m(curve.points).max())
    else:
        is_number = isinstance(margin, Real) and not isinstance(margin, bool)
        if not is_number or not 0 <= margin < np.inf:
            raise SettingError(
                f"margin is {margin!r}. Give metres of at least 0, 'tre95' or none",
                code="margin-unknown",
            )
        kind, bound_m = "given", float(margin)
    # Up to the next nanometre: an id must not depend on a processor's last bit.
    margin_m = float(np.ceil(bound_m * 1e9) / 1e9)
    thicker = replace(settings, point_radius=settings.point_radius + margin_m)
    return thicker, Margin(kind, margin_m)
