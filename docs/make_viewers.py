"""Make docs/pictures/rerun.jpg, the sample's replay as Rerun shows it:  python docs/make_viewers.py

Needs `pip install rerun-sdk`, and Debian's xvfb, xauth, mesa-vulkan-drivers and libxkbcommon-x11-0.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
SAMPLES = ROOT / "samples"
PROGRAMS = Path(sys.executable).parent
SCREEN = "1400x900"


def main() -> None:
    """Plan the sample, replay its session into an MCAP file, and open that in the viewer."""
    with tempfile.TemporaryDirectory() as name:
        fixture, run, shot = (Path(name) / file for file in ("elbow.h5", "run.mcap", "shot.png"))
        plan = ["plan", SAMPLES / "elbow.png", SAMPLES / "elbow_markers_image.csv"]
        plan += [SAMPLES / "elbow_markers_robot.csv", "--pixel-spacing", "0.5", "-o", fixture]
        replay = ["replay", fixture, SAMPLES / "elbow_session.csv", "--mcap", run]
        for command in (plan, replay):
            subprocess.run([PROGRAMS / "vfplan", *command, "-q"], check=True)
        screen = ["xvfb-run", "-a", "-s", f"-screen 0 {SCREEN}x24"]
        viewer = [PROGRAMS / "rerun", run, "--window-size", SCREEN, "--screenshot-to", shot]
        subprocess.run([*screen, *viewer], check=True)
        picture = Image.open(shot).convert("RGB").resize((1000, 643), Image.Resampling.LANCZOS)
        picture.save(ROOT / "docs" / "pictures" / "rerun.jpg", quality=85)


if __name__ == "__main__":
    main()
