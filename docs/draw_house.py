"""Draw the packages and the imports between them: `python docs/draw_house.py`.

The rows are those of `tests/test_layers.py`; the arrows are read from the code. An arrow that
others lead round is left out.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from test_layers import LAYERS, imports, layer, sources  # noqa: E402

INK = "#1b3a57"
PALE = "#9db4c8"
BOX = "#eef3f7"


def main() -> None:
    """Write docs/pictures/house.png."""
    place = {
        name: ((k + 0.5) / len(row), rank)
        for rank, row in enumerate(LAYERS)
        for k, name in enumerate(row)
    }
    used = {
        (owner, target)
        for path, module in sources()
        if (owner := layer(module))
        for name in imports(path)
        if name.startswith("vfplan.") and (target := layer(name.removeprefix("vfplan.")))
        if target != owner
    }
    above = sorted(place, key=lambda name: place[name][1])
    reach: dict[str, set[str]] = {}  # all that a name uses, itself or through others
    kept = set()
    for owner in above:
        targets = {target for name, target in used if name == owner}
        round_about = {far for target in targets for far in reach[target]}
        reach[owner] = targets | round_about
        kept |= {(owner, target) for target in targets - round_about}
    figure, axes = plt.subplots(figsize=(10, 0.72 * len(LAYERS)), layout="constrained")
    for owner, target in sorted(kept):
        near = place[owner][1] - place[target][1] == 1
        axes.annotate(
            "", place[target], place[owner], zorder=1,
            arrowprops={"arrowstyle": "-|>", "color": INK if near else PALE,
                        "lw": 0.9 if near else 0.5, "shrinkA": 9, "shrinkB": 9},
        )  # fmt: skip
    for name, (x, y) in place.items():
        axes.text(
            x, y, name, ha="center", va="center", fontsize=10, color=INK, zorder=2,
            bbox={"boxstyle": "round,pad=0.35", "fc": BOX, "ec": INK, "lw": 0.9},
        )  # fmt: skip
    axes.set(xlim=(0, 1), ylim=(-0.6, len(LAYERS) - 0.4))
    axes.axis("off")
    figure.savefig(ROOT / "docs" / "pictures" / "house.png", dpi=110)


if __name__ == "__main__":
    main()
