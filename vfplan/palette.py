"""One palette for every picture, a colour a role.

The line and its points are blue, the wall at which the proxy stops is red, a guide's tube green.
Contact circle and normal have the proxy's colour. A residual is an error.

Any two of its colours are told apart by those who see no red, no green or no blue (a test computes
the difference), on white paper and on a dark screen.
"""

from __future__ import annotations

# On white paper, and on a dark screen.
COLOURS = {
    "cloud": ("#2f52e9", "#94b6ff"),
    "wall": ("#be0000", "#d0390e"),
    "tube": ("#30a58e", "#218771"),
    "error": ("#970d6c", "#9c4890"),
    "bridged": ("#de790c", "#fed22f"),
    "force": ("#222222", "#e6e9ed"),
    "tip": ("#6c635a", "#a2a2ab"),
    "proxy": ("#a287c6", "#8454fc"),
}
LIGHT, DARK = ({name: pair[k] for name, pair in COLOURS.items()} for k in (0, 1))
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
