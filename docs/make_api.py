"""The reference of Python and C++ from docstrings and header comments, as pages: `make api`.

Writes build/api/python (by pdoc) and build/api/cpp (by doxygen); needs no network.
"""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path

import pdoc

import vfplan

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "build" / "api"
# What a program may import beside vfplan's own names; the other rooms are the house's inside.
ROOMS = ("errors", "bundle", "campaign", "live", "stability", "surface", "scenes")


def python_pages(folder: Path) -> None:
    """The pages of `vfplan`'s own names and of its public rooms; a warning is an error."""
    for name in vfplan.__all__:  # names are loaded when they are used; pdoc looks before
        vars(vfplan)[name] = getattr(vfplan, name)
    pdoc.render.configure(docformat="numpy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pdoc.pdoc("vfplan", *(f"vfplan.{room}" for room in ROOMS), output_directory=folder)


def main() -> None:
    """Both references, under build/api."""
    OUT.mkdir(parents=True, exist_ok=True)
    os.chdir(OUT)  # in the root pdoc asks whether the folder vfplan is meant
    python_pages(OUT / "python")
    done = subprocess.run(["doxygen", "docs/Doxyfile"], cwd=ROOT, check=False)
    print("build/api/python/index.html", "build/api/cpp/index.html", sep="\n")
    sys.exit(done.returncode)


if __name__ == "__main__":
    main()
