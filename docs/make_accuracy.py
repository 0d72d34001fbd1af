"""Put a bench's tables and pictures into docs/accuracy.md.

    python docs/make_accuracy.py              # runs the whole bench: about 10 minutes, idle
    python docs/make_accuracy.py DIR          # of a run that there is

Every number between `<!-- NAME -->` and `<!-- end -->` comes from DIR/bench.json, those of
the paper's scenes from `vfplan demo paper`, which this runs.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from accuracy_tables import TABLES, scenes
from PIL import Image

DOCS = Path(__file__).parent
PROGRAM = Path(sys.executable).with_name("vfplan")
PAGE, PICTURES = DOCS / "accuracy.md", DOCS / "pictures"


def main(arguments: list[str]) -> None:
    """Fill the page and copy the diagrams, of a run's folder or of a run of now."""
    if arguments:
        fill(Path(arguments[0]))
        return
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made) / "bench"
        subprocess.run([PROGRAM, "bench", "all", "-o", folder], check=True)
        fill(folder)


def fill(folder: Path) -> None:
    """The page, from a run's folder."""
    document = json.loads((folder / "bench.json").read_text())
    page = PAGE.read_text()
    for name, make in TABLES.items():
        page = filled(page, name, make(document))
    for stage in document["stages"]:
        keep(folder / f"bench_{stage}.png", PICTURES / f"bench_{stage}.png")
    page = filled(page, "scenes", scenes(papers_scenes()))
    page = filled(page, "since", "")  # what an older run's numbers lack
    PAGE.write_text(page)


def filled(page: str, name: str, text: str) -> str:
    """The page with this text in the place of that name."""
    pattern = re.compile(rf"<!-- {name} -->\n.*?<!-- end -->", re.DOTALL)
    if not pattern.search(page):
        raise SystemExit(f"{PAGE.name}: no place for {name}")
    return pattern.sub(lambda _: f"<!-- {name} -->\n{text}\n<!-- end -->", page)


def papers_scenes() -> dict[str, dict[str, Any]]:
    """Draw the paper's figures; the numbers of each scene."""
    with tempfile.TemporaryDirectory() as made:
        subprocess.run([PROGRAM, "demo", "paper", "-o", made, "-q"], check=True)
        for figure in ("fig2", "fig4", "fig5", "fig6"):
            keep(Path(made) / f"{figure}.png", PICTURES / f"paper_{figure}.png")
        told = {
            name: json.loads((Path(made) / f"{name}.json").read_text())
            for name in ("fig2", "fig4", "fig6")
        }
    return {**told["fig2"], "Experiment 1": told["fig4"], "Experiment 2": told["fig6"]}


def keep(picture: Path, target: Path) -> None:
    """Copy a picture with a palette of 255 colours: half of the bytes, the same to the eye."""
    with Image.open(picture) as image:
        image.convert("RGB").quantize(255).save(target, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1:])
