"""Put the tables and pictures of a bench into docs/accuracy.md.

    python docs/make_accuracy.py --quick      # runs the quick bench: about a minute
    python docs/make_accuracy.py              # runs the whole bench: about ten minutes, idle
    python docs/make_accuracy.py DIR...       # of runs that there are, such as one for each stage

Every number between `<!-- NAME -->` and `<!-- end -->` comes from the bench.json of the folders.
Those of the paper's scenes come from `vfplan demo paper`, which this runs; those of sections
Sweeps and Feel from the programs that these name.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import make_feel
import make_sweeps
from accuracy_tables import TABLES, scenes
from PIL import Image

DOCS = Path(__file__).parent
PROGRAM = Path(sys.executable).with_name("vfplan")
PAGE = DOCS / "accuracy.md"
PICTURES = DOCS / "pictures"


def main(arguments: list[str]) -> None:
    """Fill the page and copy the diagrams, of the runs in these folders or of a run of now."""
    folders = [Path(argument) for argument in arguments if argument != "--quick"]
    if folders:
        fill(folders)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "bench"
        subprocess.run([PROGRAM, "bench", "all", "-o", folder, *arguments], check=True)
        fill([folder])


def fill(folders: list[Path]) -> None:
    """Write the page from the runs in these folders; of a stage in two of them the last counts."""
    document = joined([json.loads((folder / "bench.json").read_text()) for folder in folders])
    page = PAGE.read_text()
    for name, make in TABLES.items():
        page = filled(page, name, make(document))
    for folder in folders:
        for diagram in folder.glob("bench_*.png"):
            keep(diagram, PICTURES / diagram.name)
    page = filled(page, "scenes", scenes(papers_scenes()))
    page = filled(page, "feel", make_feel.make())
    page = filled(page, "sweeps", make_sweeps.make())
    PAGE.write_text(page)


def joined(documents: list[dict[str, Any]]) -> dict[str, Any]:
    """One document of several runs."""
    result = dict(documents[0])
    for document in documents[1:]:
        for key in ("results", "refused"):
            entries = []
            for entry in result.get(key, []):
                if entry["stage"] not in document["stages"]:
                    entries.append(entry)
            result[key] = entries + document.get(key, [])
        result["elapsed_s"] += document["elapsed_s"]
        result["chosen"] = document.get("chosen") or result.get("chosen")
    return result


def filled(page: str, name: str, text: str) -> str:
    """The page with this text in the place of that name."""
    pattern = re.compile(rf"<!-- {name} -->\n.*?<!-- end -->", re.DOTALL)
    if not pattern.search(page):
        raise SystemExit(f"{PAGE.name}: no place for {name}")
    return pattern.sub(lambda _: f"<!-- {name} -->\n{text}\n<!-- end -->", page)


def papers_scenes() -> dict[str, dict[str, Any]]:
    """Draw the figures of the paper; the numbers of each scene."""
    numbers = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([PROGRAM, "demo", "paper", "-o", folder, "-q"], check=True)
        for figure in ("fig2", "fig4", "fig5", "fig6"):
            keep(folder / f"{figure}.png", PICTURES / f"paper_{figure}.png")
        for figure in ("fig2", "fig4", "fig6"):
            numbers[figure] = json.loads((folder / f"{figure}.json").read_text())
    return {
        **numbers["fig2"],
        "Experiment 1": numbers["fig4"],
        "Experiment 2": numbers["fig6"],
    }


def keep(picture: Path, target: Path) -> None:
    """Copy a picture with a palette of 255 colours: half of the bytes, the same to the eye."""
    with Image.open(picture) as image:
        image.convert("RGB").quantize(255).save(target, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1:])
