"""Draw docs/pictures/camera.jpg: the sample, printed at half its size, before a rendered camera.

python docs/make_camera.py
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

import vfplan
from vfplan.camera.overlay import Overlay
from vfplan.camera.sheet import draw_print, plan_of, printed_tags
from vfplan.review.rendered import Shown

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "making"))

import camera_scene  # noqa: E402

PICTURE = ROOT / "docs" / "pictures" / "camera.jpg"


def main() -> None:
    """Plan, print, photograph and draw."""
    slice_file, image, robot = (
        ROOT / "samples" / f"elbow{end}"
        for end in (".png", "_markers_image.csv", "_markers_robot.csv")
    )
    places = np.loadtxt(robot, str, delimiter=",")
    places[1:, 1:] = places[1:, 1:].astype(float) / 2
    with tempfile.TemporaryDirectory() as folder:
        half = Path(folder) / "half.csv"
        np.savetxt(half, places, "%s", ",")
        planned = vfplan.plan(slice_file, image, half)
    shown = Shown(planned.fixture, "elbow.h5", planned.extracted.image)
    page = camera_scene.page(draw_print(shown, "a4"))
    rng = np.random.default_rng(3)
    frame = camera_scene.photograph(page, camera_scene.pose(rng, (0.42, 0.45)), rng)
    plan = plan_of(planned.fixture)
    report = Overlay(plan, printed_tags(plan), camera_scene.CAMERA).show(frame, 0.0)
    assert report["refused"] is None, report
    small = cv2.resize(frame, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(PICTURE), small[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])


if __name__ == "__main__":
    main()
