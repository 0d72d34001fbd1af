"""One palette: every pair of colours stays apart for eyes that lack a kind of cones."""

from __future__ import annotations

import re

import numpy as np
import pytest
from conftest import ROOT
from skimage.color import deltaE_ciede2000, rgb2lab

from vfplan import palette

# G. M. Machado, M. M. Oliveira, L. A. F. Fernandes, IEEE TVCG 15, 2009, 1291-1298: severity 1.
SEEN = {
    "all cones": np.eye(3),
    "no red": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
               [-0.003882, -0.048116, 1.051998]],
    "no green": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                 [-0.011820, 0.042940, 0.968881]],
    "no blue": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                [0.004733, 0.691367, 0.303900]],
}  # fmt: skip
APART = 15.0  # CIEDE2000; a just noticeable difference is about 1, neighbours in a map 10


def linear(colours):
    rgb = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in colours]) / 255
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def shown(light):
    light = np.clip(light, 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("eye", SEEN)
@pytest.mark.parametrize("theme", ["LIGHT", "DARK"])
def test_every_pair_stays_apart(theme, eye):
    colours = getattr(palette, theme)
    lab = rgb2lab(shown(linear(colours.values()) @ np.transpose(SEEN[eye])))
    apart = deltaE_ciede2000(lab[:, None], lab[None]) + 100 * np.eye(len(lab))
    one, other = np.unravel_index(apart.argmin(), apart.shape)
    assert apart.min() >= APART, (list(colours)[one], list(colours)[other])


@pytest.mark.parametrize("theme, ground", [("LIGHT", "#ffffff"), ("DARK", "#14181d")])
def test_every_colour_stands_out_from_the_ground(theme, ground):
    """Contrast of at least 3, as WCAG 2.1 (1.4.11) wants it of graphics."""
    light = linear([*getattr(palette, theme).values(), ground]) @ [0.2126, 0.7152, 0.0722] + 0.05
    ratio = np.maximum(light[:-1] / light[-1], light[-1] / light[:-1])
    assert ratio.min() >= 3.0


def test_pictures_have_their_colours_from_the_palette():
    """Greys, the ground of a stretch in contact and the colour maps are no roles."""
    package = ROOT / "vfplan"
    drawing = [(package / folder).rglob("*.[pj]*") for folder in ("figures", "report", "view3d")]
    for path in [*drawing[0], *drawing[1], *drawing[2], package / "live" / "live.js",
                 *package.glob("*/figures.py")]:  # fmt: skip
        for r, g, b in re.findall(r"[\"']#([0-9a-f]{2})(..)(..)\b", path.read_text()):
            assert r == g == b or f"#{r}{g}{b}" in ("#a9dcb4", "#21918c"), path
