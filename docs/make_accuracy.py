"""Put a bench's tables and pictures into docs/accuracy.md.

    vfplan bench all -o DIR --peer ./nanoflann_peer --surface femur.stl
    python docs/make_accuracy.py DIR

Every number between `<!-- NAME -->` and `<!-- end -->` comes from DIR/bench.json.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from PIL import Image

DOCS = Path(__file__).parent
PAGE, PICTURES = DOCS / "accuracy.md", DOCS / "pictures"
ENGINES = ("robust", "paper", "nanoflann_peer", "paper in NumPy", "nearest-point penalty")
SPACING = 0.5e-3


def micrometres(metres: float) -> str:
    """Three digits; below a nanometre it is rounding."""
    value = metres * 1e6
    return "< 0.001" if value < 1e-3 else f"{value:.3g}"


def microseconds(us: float) -> str:
    """Three digits at most, no exponent."""
    return f"{us:.2g}" if us < 10 else f"{us:.0f}"


def of(document: dict[str, Any], **wanted: Any) -> list[dict[str, Any]]:
    """Results whose keys have these values."""
    return [r for r in document["results"] if all(r.get(k) == v for k, v in wanted.items())]


def machine(document: dict[str, Any]) -> str:
    """One line on what it ran on."""
    m = document["machine"]
    return (
        f"Machine: {m['processor']}, {m['cores']} cores (shared with other work), {m['system']}, "
        f"Python {m['python']}, NumPy {m['numpy']}; {document['elapsed_s'] / 60:.1f} minutes for "
        f"{len(document['results'])} results."
    )


def engines(document: dict[str, Any]) -> str:
    """RMS proxy error and median time of each engine at 0.5 mm, by scene."""
    here = [e for e in ENGINES if of(document, stage="proxy", method=e)]
    lines = [
        "| scene | " + " | ".join(f"`{e}`" for e in here) + " |",
        "|---" * (len(here) + 1) + "|",
    ]
    for scene in dict.fromkeys(r["scene"] for r in of(document, stage="proxy")):
        cells = []
        for engine in here:
            rows = of(document, stage="proxy", scene=scene, method=engine)
            rows = [r for r in rows if r["settings"]["spacing_m"] == SPACING]
            cells.append(_cell(rows[0]) if rows else "–")
        lines.append(f"| {scene} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(result: dict[str, Any]) -> str:
    error, time = micrometres(result["error_rms"]), microseconds(result["time_us_median"])
    return f"{error} µm, {time} µs"


def chosen(document: dict[str, Any]) -> str:
    """What the tolerance chose, by scene."""
    lines = [
        "| scene | points | surface | proxy, RMS / max | force, RMS "
        "| tick, median / p99.9 | kept | against the cheapest |",
        "|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for r in of(document, stage="proxy", chosen=True):
        ratio = r["time_over_cheapest"]
        lines.append(
            f"| {r['scene']} | {r['points']} | {micrometres(r['surface_error_m'])} µm "
            f"| {micrometres(r['error_rms'])} / {micrometres(r['error_max'])} µm "
            f"| {1e3 * r['force_rms_n']:.3g} mN "
            f"| {microseconds(r['time_us_median'])} / {microseconds(r['time_us_p999'])} µs "
            f"| {'yes' if r['meets_tolerance'] else 'no'} "
            f"| {'–' if ratio is None else f'{ratio:.1f} ×'} |"
        )
    return "\n".join(lines)


def extraction(document: dict[str, Any]) -> str:
    """RMS error and time of each method at scale 1, by drawing."""
    rows = [r for r in of(document, stage="extract") if r["settings"]["scale"] == 1.0]
    methods = list(dict.fromkeys(r["method"] for r in rows))
    lines = ["| drawing | " + " | ".join(methods) + " |", "|---" * (len(methods) + 1) + "|"]
    for scene in dict.fromkeys(r["scene"] for r in rows):
        found = {r["method"]: r for r in rows if r["scene"] == scene}
        cells = [
            f"{found[m]['error_rms']:.3f} px, {found[m]['time_us_median'] / 1e3:.0f} ms"
            if m in found else "refused"
            for m in methods
        ]  # fmt: skip
        lines.append(f"| {scene} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def plans(document: dict[str, Any]) -> str:
    """The whole pipeline on the elbow."""
    lines = [
        "| markers | way | points | error of the surface, RMS / max | time |",
        "|---" * 5 + "|",
    ]
    for r in of(document, stage="plan"):
        if r["settings"].get("tolerance_m", 1e-5) == document["tolerance_m"]:
            lines.append(
                f"| {r['scene'].split(', ')[1]} | {r['method']} | {r['points']} "
                f"| {micrometres(r['error_rms'])} / {micrometres(r['error_max'])} µm "
                f"| {r['time_us_median'] / 1e3:.0f} ms |"
            )
    return "\n".join(lines)


TABLES = {
    "machine": machine,
    "engines": engines,
    "chosen": chosen,
    "extraction": extraction,
    "plans": plans,
}


def blocks(document: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Name and text of each table."""
    for name, table in TABLES.items():
        yield name, table(document)


def main(folder: Path) -> None:
    """Fill the page and copy the diagrams."""
    document = json.loads((folder / "bench.json").read_text())
    page = PAGE.read_text()
    for name, text in blocks(document):
        pattern = re.compile(rf"<!-- {name} -->\n.*?<!-- end -->", re.DOTALL)
        assert pattern.search(page), f"no place for {name}"
        page = pattern.sub(lambda _, n=name, t=text: f"<!-- {n} -->\n{t}\n<!-- end -->", page)
    PAGE.write_text(page)
    for stage in document["stages"]:
        keep(folder / f"bench_{stage}.png", PICTURES / f"bench_{stage}.png")
    with tempfile.TemporaryDirectory() as scenes:
        command = [sys.executable, "-m", "vfplan.samples.paper", "all", "-o", scenes]
        subprocess.run(command, check=True, capture_output=True, cwd=scenes)
        for figure in ("fig2", "fig4", "fig6"):
            keep(Path(scenes) / f"{figure}.png", PICTURES / f"paper_{figure}.png")


def keep(picture: Path, target: Path) -> None:
    """Copy a picture with a palette of 255 colours: half of the bytes, the same to the eye."""
    with Image.open(picture) as image:
        image.convert("RGB").quantize(255).save(target, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
