"""Draw the packages and the imports between them: `python docs/draw_house.py`.

The rows are those of `tests/test_layers.py`; the arrows are read from the code. An arrow that
others lead round is left out.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "support")]
from test_layers import LAYERS, layer, ours, sources  # noqa: E402

INK = "#1b3a57"
PALE = "#9db4c8"
BOX = "#eef3f7"


def arrows() -> dict[str, set[str]]:
    """The packages of lower rows that each package imports."""
    uses: dict[str, set[str]] = {}
    rank = {}
    for number, row in enumerate(LAYERS):
        for name in row:
            uses[name] = set()
            rank[name] = number
    for module, _, tree in sources():
        owner = layer(module)
        if owner:
            targets = filter(None, map(layer, ours(ast.walk(tree))))
            uses[owner] |= {target for target in targets if rank[target] < rank[owner]}
    return uses


def direct_arrows(uses: dict[str, set[str]]) -> list[tuple[str, str]]:
    """The arrows that no chain of other arrows replaces."""
    kept = []
    for owner, targets in uses.items():
        for target in targets:
            if not any(target in reached(other, uses) for other in targets if other != target):
                kept.append((owner, target))
    return sorted(kept)


def reached(owner: str, uses: dict[str, set[str]]) -> set[str]:
    """All packages that a package uses, itself or through others."""
    names: set[str] = set()
    waiting = list(uses[owner])
    while waiting:
        name = waiting.pop()
        if name not in names:
            names.add(name)
            waiting += uses[name]
    return names


def main() -> None:
    """Write docs/pictures/house.png."""
    place = {}
    for rank, row in enumerate(LAYERS):
        for k, name in enumerate(row):
            place[name] = ((k + 0.5) / len(row), rank)
    kept = direct_arrows(arrows())
    figure, axes = plt.subplots(figsize=(10, 0.72 * len(LAYERS)), layout="constrained")
    for owner, target in kept:
        colour = PALE
        width = 0.5
        if place[owner][1] - place[target][1] == 1:
            colour = INK
            width = 0.9
        axes.annotate(
            "", place[target], place[owner], zorder=1,
            arrowprops={"arrowstyle": "-|>", "color": colour, "lw": width, "shrinkA": 9,
                        "shrinkB": 9},
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
