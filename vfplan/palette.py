"""One palette for every picture, a colour a role.

The line and its points are blue, the wall at which the proxy stops is red, a guide's tube green.
Contact circle and normal have the proxy's colour. A residual is an error.

Any two of its colours are told apart by those who see no red, no green or no blue (a test computes
the difference), on white paper and on a dark screen.
"""

from __future__ import annotations

LIGHT = {
    "cloud": "#2f52e9",
    "wall": "#be0000",
    "tube": "#30a58e",
    "error": "#970d6c",
    "bridged": "#de790c",
    "force": "#222222",
    "tip": "#6c635a",
    "proxy": "#a287c6",
}
DARK = {
    "cloud": "#94b6ff",
    "wall": "#d0390e",
    "tube": "#218771",
    "error": "#9c4890",
    "bridged": "#fed22f",
    "force": "#e6e9ed",
    "tip": "#a2a2ab",
    "proxy": "#8454fc",
}
CLOUD, WALL, TUBE, ERROR, BRIDGED, FORCE, TIP, PROXY = LIGHT.values()
# Background of a stretch in contact.
EPISODE = "#d9f2d9"
# One colour a rule in every comparison.
RULE = {"robust": CLOUD, "paper": BRIDGED, "exact": TUBE}
# Colours of lines that have no role.
CYCLE = (CLOUD, BRIDGED, ERROR, TUBE, WALL)


def palette_css() -> str:
    """The colours of every picture as variables of a page, for light and for dark screens."""
    light, dark = (
        "; ".join(f"--{name}: {colour}" for name, colour in colours.items())
        for colours in (LIGHT, DARK)
    )
    return f":root {{ {light} }}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
