"""A pen's colour, and how a pixel is split into the pen's part and the rest.

Over grey g, a pen of colour c and coverage a shows p = (1 - a) g (1, 1, 1) + a c. The part of p
across the grey axis is a c' where c' is the pen's chroma, whatever g is: bones and air drop out.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.curve import tuned
from vfplan.errors import SettingError

HUES = ("red", "orange", "yellow", "lime", "cyan", "blue", "magenta")
"""Names of pens that a refusal looks for when the named pen drew nothing."""


@dataclass(frozen=True, eq=False)
class Pen:
    """Two directions in the plane of chroma, the plane across grey.

    Parameters
    ----------
    along
        (3,) unit vector of the pen's own chroma.
    across
        (3,) unit vector at right angles to it, positive towards yellow for a red pen.
    name
        What the caller named it.
    """

    along: NDArray[np.float64]
    across: NDArray[np.float64]
    name: str

    @classmethod
    def of_colour(cls, colour: str) -> Pen:
        """The pen of a CSS colour name or `#rrggbb`; raises `SettingError` for grey or nonsense."""
        rgb = parse_colour(colour)
        chroma = rgb - rgb.mean()
        strength = float(np.linalg.norm(chroma))
        if strength < tuned.CHROMA_FLOOR:
            raise SettingError(
                f"The colour {colour!r} has a chroma of {strength:.0f}, too little to tell it from "
                f"a grey slice. Name one of {tuned.CHROMA_FLOOR:.0f} or more, such as red.",
                code="colour-grey",
                numbers={"chroma": strength, "chroma_min": tuned.CHROMA_FLOOR},
            )
        along = chroma / strength
        return cls(along, np.cross(np.ones(3), along) / np.sqrt(3.0), colour)

    def turned(self, angle_rad: float) -> Pen:
        """The pen whose hue lies at an angle from this one."""
        cos, sin = np.cos(angle_rad), np.sin(angle_rad)
        along = cos * self.along + sin * self.across
        return Pen(along, cos * self.across - sin * self.along, self.name)

    def degrees_from(self, other: Pen) -> float:
        """The angle of this pen's hue from that of another [degrees]."""
        return float(np.degrees(np.arctan2(self.along @ other.across, self.along @ other.along)))


def parse_colour(colour: str) -> NDArray[np.float64]:
    """(3,) RGB on 0..255 of `#rrggbb` or a CSS colour name; raises `SettingError`."""
    if colour == "red":  # The default needs no import of matplotlib.
        return np.array([255.0, 0.0, 0.0])
    from matplotlib.colors import CSS4_COLORS, to_rgb

    try:
        return 255.0 * np.array(to_rgb(colour))
    except ValueError:
        question = ""
        similar = difflib.get_close_matches(colour.lower(), CSS4_COLORS, 1)
        if similar:
            question = f"Did you mean {similar[0]!r}? "
        raise SettingError(
            f"The colour {colour!r} is unknown. {question}Give the name of a colour or #rrggbb.",
            code="colour-unknown",
        ) from None
