"""Draw docs/pictures/camera.jpg: the sample, printed at half its size, before a rendered camera.

python docs/make_camera.py            the picture
python docs/make_camera.py --speed N  how many frames a second the overlay draws, over N frames
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

import vfplan
from vfplan.camera.overlay import Overlay
from vfplan.camera.sheet import SCALE_MM, draw_print, plan_of, printed_tags
from vfplan.review.plan import Plan
from vfplan.session.bags import TICK

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
    shown = Plan.of(planned.fixture, "elbow.h5", planned.extracted.image)
    page = camera_scene.page(draw_print(shown, "a4")[0])
    plan = plan_of(planned.fixture)
    overlay = Overlay(plan, printed_tags(plan), camera_scene.CAMERA, measured_mm=SCALE_MM)
    if sys.argv[1:2] == ["--speed"]:
        measure_speed(overlay, page, int(sys.argv[2]))
        return
    rng = np.random.default_rng(3)
    frame = camera_scene.photograph(page, camera_scene.pose(rng, (0.42, 0.45)), rng)
    report = overlay.show(frame, 0.0)
    assert report["refused"] is None, report
    small = cv2.resize(frame, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(PICTURE), small[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])


def measure_speed(overlay: Overlay, page: np.ndarray, count: int) -> None:
    """Print how long a rendered frame takes, with a tool on it, by the clock and the processor."""
    tick = np.zeros(1, TICK)[0]
    tick["hip"] = tick["proxy"] = overlay.plan.fixture.points[0]
    tick["normal"], tick["force"] = [0, 0, 1], [0, 0, 3]
    overlay.tick_at = lambda time_s: tick
    shown, wall_s, processor_s = 0, 0.0, 0.0
    for number in range(count):
        rng = np.random.default_rng(number)
        frame = camera_scene.photograph(page, camera_scene.pose(rng), rng)
        wall, processor = time.perf_counter(), time.process_time()
        shown += overlay.show(frame, 0.0)["refused"] is None
        wall_s += time.perf_counter() - wall
        processor_s += time.process_time() - processor
    width, height = camera_scene.SIZE
    print(
        f"{shown} of {count} frames of {width} x {height} show the wall: "
        f"{count / wall_s:.1f} frames a second, {1e3 * wall_s / count:.1f} ms a frame, "
        f"{1e3 * processor_s / count:.1f} ms of processor time, {cv2.getNumThreads()} threads"
    )


if __name__ == "__main__":
    main()
