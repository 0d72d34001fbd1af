"""Draw the README's pictures from the demo:  python docs/make_pictures.py

The slice is a photograph-like picture and goes to JPEG; the plot stays a PNG.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import cv2

PICTURES = Path(__file__).with_name("pictures")


def main() -> None:
    """Run the demo in a folder of its own and keep the two pictures."""
    PICTURES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        program = Path(sys.executable).with_name("vfplan")
        subprocess.run([program, "demo", "-o", folder, "--overwrite", "-q"], check=True)
        overlay = cv2.imread(f"{folder}/overlay.png")
        target = str(PICTURES / "demo_overlay.jpg")
        cv2.imwrite(target, overlay, [cv2.IMWRITE_JPEG_QUALITY, 85])
        for name in ("scene", "force"):
            picture = Path(folder, f"{name}.png").read_bytes()
            (PICTURES / f"demo_{name}.png").write_bytes(picture)


if __name__ == "__main__":
    main()
