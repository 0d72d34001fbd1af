"""One palette for every picture, after the paper's: blue cloud, green HIP, red contact circle.

Any two of its colours are told apart by those who see no red, no green or no blue (a test computes
the difference), on white paper and on a dark screen.
"""

from __future__ import annotations

LIGHT = {
    "cloud": "#2f52e9",
    "hip": "#30a58e",
    "contact": "#be0000",
    "proxy": "#970d6c",
    "bridged": "#de790c",
    "force": "#222222",
}
DARK = {
    "cloud": "#94b6ff",
    "hip": "#218771",
    "contact": "#d0390e",
    "proxy": "#9459af",
    "bridged": "#fed22f",
    "force": "#e6e9ed",
}
CLOUD, HIP, CONTACT, PROXY, BRIDGED, FORCE = LIGHT.values()
# Background of a stretch in contact.
EPISODE = "#d9f2d9"
# One colour a rule in every comparison.
RULE = {"robust": CLOUD, "paper": BRIDGED, "exact": HIP}
# Colours of lines that have no role.
CYCLE = (CLOUD, BRIDGED, PROXY, HIP, CONTACT)


def palette_css() -> str:
    """The colours of every picture as variables of a page, for light and for dark screens."""
    light, dark = (
        "; ".join(f"--{name}: {colour}" for name, colour in colours.items())
        for colours in (LIGHT, DARK)
    )
    return f":root {{ {light} }}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
