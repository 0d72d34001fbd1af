"""Fill the tables and pictures of docs/stability.md from the folder of a full study.

vfplan stability -o DIR; python docs/make_stability.py DIR
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
PAGE = DOCS / "stability.md"


def number(value: float | None) -> str:
    """Three digits; a dash where there is none."""
    return "–" if value is None else f"{value:.3g}"


def loops(cases: list[dict]) -> list[str]:
    """The closed loop: one line a scene."""
    lines = [
        "| scene | rule | largest stable K [N/m] | of the exact bound | overshoot |"
        " at rest after [s] | limit cycle [µm] | work on the hand [µJ] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for c in cases:
        if c["case"].startswith("closed-loop/"):
            lines.append(
                f"| {c['scene']} | {c['rule']} | {c['measured']:.0f} | {c['ratio']:.4f} |"
                f" {c['overshoot']:.2f} | {number(c['rest_s'])} | {c['limit_cycle_m'] * 1e6:.2f} |"
                f" {c['energy_j'] * 1e6:.1f} |"
            )
    return lines


def passivity(cases: list[dict]) -> list[str]:
    """Passivity and receding: one line a scene and rule."""
    recede = {c["case"].partition("/")[2]: c for c in cases if c["case"].startswith("recede/")}
    lines = [
        "| scene | rule | active cycles | largest (work − bound) / stored |"
        " receded in a tick [bands] |",
        "|---|---|---|---|---|",
    ]
    for c in cases:
        if c["case"].startswith("passivity/"):
            r = recede[c["case"].partition("/")[2]]
            lines.append(
                f"| {c['scene']} | {c['rule']} | {c['active_cycles']} of {c['cycles']} |"
                f" {c['measured']:+.2g} | {r['measured'] / r['limit']:.2f} |"
            )
    return lines


def extremes(cases: list[dict]) -> list[str]:
    """Extreme cases: expected and found."""
    lines = ["| case | expected | found | outcome |", "|---|---|---|---|"]
    for c in cases:
        kind, _, name = c["case"].partition("/")
        if kind != "extreme":
            continue
        expected, _, found = c["detail"].removeprefix("expected ").partition("; ")
        found = found if len(found) < 90 else found[:87] + "..."
        lines.append(f"| {name.replace('/', ': ', 1)} | {expected} | {found} | {c['outcome']} |")
    return lines


def main(folder: Path) -> None:
    """Rewrite the page between its markers."""
    cases = json.loads((folder / "stability.json").read_text("utf-8"))["cases"]
    page = PAGE.read_text("utf-8")
    for name, made in (("loops", loops), ("passivity", passivity), ("extremes", extremes)):
        block = f"<!-- {name} -->\n" + "\n".join(made(cases)) + f"\n<!-- end {name} -->"
        old = re.compile(f"<!-- {name} -->.*?<!-- end {name} -->", re.DOTALL)
        page = old.sub(lambda _, block=block: block, page)
    PAGE.write_text(page, "utf-8")
    for name in ("stability_map.png", "passivity.png"):
        shutil.copyfile(folder / name, DOCS / "pictures" / name)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
