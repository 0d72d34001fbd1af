"""The plan on a camera's frame: line, bands, outline and tool, or why nothing is drawn."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vfplan.camera.pose import Array, Camera, Picture, Pose, find_tags, locate, make_finder
from vfplan.camera.sheet import SCALE_MM, Target, outlines_in
from vfplan.display import MM
from vfplan.errors import CheckFailed, InputError
from vfplan.fixture import Fixture
from vfplan.geometry.lines import normals, ring_of, runs
from vfplan.images.read import as_uint8, is_picture_file, read_image
from vfplan.io.writing import write_whole
from vfplan.review import paper
from vfplan.review.picture import RENDERED_COLOUR
from vfplan.review.rendered import Shown, registration_again, strokes_on_slice
from vfplan.session.result import TickBlock

# How far off the drawn line may be unless the caller says otherwise [m]: half of a pen's line,
# which the wall would else seem to stand beside.
LIMIT_M = 0.5e-3

# How exactly a ruler tells the printed scale [mm].
RULER_MM = 0.5

# Places along the line at which the bound is taken, and points of the contact circle.
BOUND_PLACES, CIRCLE_POINTS = 100, 48

# Length of the arrow of a newton, and of the line of the normal [m].
NEWTON_M, NORMAL_M = 5e-3, 10e-3


class Frames:
    """The frames of a picture, of a video, or of a camera: time [s] and (H, W, 3) red first.

    Parameters
    ----------
    source
        A file, or the number of a camera, which is asked for pictures of `size_px`.
    """

    def __init__(self, source: Path, size_px: tuple[int, int] | None = None) -> None:
        self.source, self.video, self.rate_hz = source, None, 30.0
        self.is_camera = str(source).isdecimal()
        if not self.is_camera and is_picture_file(source):
            return
        if not self.is_camera and not source.is_file():
            text = "is no picture, no video and no number of a camera. Check its name"
            raise InputError(text, where=str(source), code="camera-source")
        self.video = cv2.VideoCapture(int(str(source)) if self.is_camera else str(source))
        if self.is_camera and size_px is not None:
            self.video.set(cv2.CAP_PROP_FRAME_WIDTH, size_px[0])
            self.video.set(cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])
        self.rate_hz = self.video.get(cv2.CAP_PROP_FPS) or self.rate_hz

    def __iter__(self) -> Iterator[tuple[float, Picture]]:
        if self.video is None:
            yield 0.0, as_uint8(read_image(self.source, pixels="as-stored").rgb).copy()
            return
        number, started = 0, time.monotonic()
        while True:
            is_read, frame = self.video.read()
            if not is_read:
                break
            time_s = time.monotonic() - started if self.is_camera else number / self.rate_hz
            yield time_s, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)
            number += 1
        self.video.release()
        if not number:
            text = "gives no frame. Check that it is a video, or the number of a camera"
            raise InputError(text, where=str(self.source), code="camera-source")


@dataclass
class Overlay:
    """Draws one fixture on the frames of one camera.

    Parameters
    ----------
    limit_m
        A frame whose bound is larger shows no wall.
    measured_mm
        Length of the printed scale by a ruler; `None`: nobody measured it.
    ticks
        Of a session, by the engine; `None`: no tool is shown.
    """

    fixture: Fixture
    target: Target
    camera: Camera
    limit_m: float = LIMIT_M
    measured_mm: float | None = None
    ticks: TickBlock | None = None
    finder: Any = field(default_factory=make_finder)

    def __post_init__(self) -> None:
        """Place among the tags once what every frame shows."""
        self.outlines = outlines_in(self.target, self.fixture)
        strokes = self.fixture.strokes
        self.lines = [self.target.place(ring_of(line.points, line.closed)) for line in strokes]
        whole = np.vstack(self.lines or [self.target.place(self.fixture.points)])
        at = np.linspace(0, len(whole) - 1, min(BOUND_PLACES, len(whole))).round().astype(int)
        self.asked = whole[at]
        self.bands = self._bands_of_registration()

    def _bands_of_registration(self) -> list[Array]:
        """Both edges of the 95 % band of each line; none where nobody knows it."""
        record = self.fixture.registration
        if record is None or record.source_frame != "image" or not self.fixture.strokes:
            return []
        shown = Shown(
            "", self.fixture, strokes=strokes_on_slice(self.fixture, None),
            registration=registration_again(self.fixture),
        )  # fmt: skip
        halves = [ring_of(half[:, None], stroke.closed) for stroke, half in shown.bounds]
        edges = []
        for line, half in zip(self.lines, halves, strict=False):
            across = half * normals(line @ self.target.axes, False) @ self.target.axes.T
            edges += [line + across, line - across]
        return edges

    def see(self, frame: Picture) -> tuple[dict[str, Any], Pose | None]:
        """What is known of a frame, with the reason where no wall may show, and the pose."""
        report: dict[str, Any] = dict.fromkeys(
            ("refused", "tags", "reprojection_px", "bound_mm", "pose_T_camera_sheet")
        )
        pose = None
        try:
            if frame.shape[1::-1] != self.camera.size_px:
                raise CheckFailed(
                    f"The camera was calibrated with {self.camera.size_px} pixels, and the frame "
                    f"has {frame.shape[1::-1]}. Calibrate it in this mode",
                    code="camera-size",
                )
            if abs((self.measured_mm or SCALE_MM) - SCALE_MM) > RULER_MM:
                raise CheckFailed(
                    f"The printed scale measures {self.measured_mm:g} mm, not {SCALE_MM:g} mm. "
                    "Print the sheet at 100 %, not fitted to the page",
                    code="wrong-scale",
                )
            found = find_tags(self.finder, cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY))
            pose = locate(found, self.target, self.camera)
            bound_mm = MM * float(pose.bound_m(self.asked).max())
            report |= {
                "tags": pose.tags, "reprojection_px": pose.reprojection_px, "bound_mm": bound_mm,
                "pose_T_camera_sheet": pose.T_camera_target.tolist(),
            }  # fmt: skip
            if bound_mm > MM * self.limit_m:
                raise CheckFailed(
                    f"The line may be off by {bound_mm:.2f} mm, and {MM * self.limit_m:g} mm are "
                    "allowed. Show more tags, sharper or nearer",
                    code="bound-too-large",
                )
        except CheckFailed as refusal:
            report |= {"refused": refusal.code, "reason": refusal.message}
        return report, pose

    def show(self, frame: Picture, time_s: float) -> dict[str, Any]:
        """Draw on a frame in its time; returns what is known of it."""
        report, pose = self.see(frame)
        if report["refused"] is not None:
            write_words(frame, f"No wall: {report['reason']}", paper.WALL_COLOUR)
            return report
        self.draw(frame, pose, report["bound_mm"] / MM, time_s)
        words = f"within {report['bound_mm']:.2f} mm (95 %), {pose.tags} tags"
        write_words(frame, words, paper.BLACK)
        return report

    def draw(self, frame: Picture, pose: Pose, bound_m: float, time_s: float) -> None:
        """Draw the wall, the line with its bands, and the tool at its time."""
        # The band of the pose is as wide as the bound, and lies under the line.
        depth = float((pose.T_camera_target @ [*self.asked.mean(axis=0), 1.0])[2])
        reach_px = pose.camera.matrix[0, 0] * bound_m / depth
        for line in self.lines:
            draw_in_view(frame, pose, line, paper.WHITE, 2 * round(reach_px) + 5)
        for kind, line in self.outlines:
            draw_in_view(frame, pose, line, paper.WHITE, 4)
            draw_in_view(frame, pose, line, RENDERED_COLOUR[kind], 2)
        for line in self.lines:
            draw_in_view(frame, pose, line, paper.LINE_COLOUR, 2)
        for edge in self.bands:
            draw_in_view(frame, pose, edge, paper.BAND_COLOUR, 1)
        if self.ticks is not None and len(self.ticks):
            self._draw_tool(frame, pose, time_s)

    def _draw_tool(self, frame: Picture, pose: Pose, time_s: float) -> None:
        """Draw HIP, proxy, contact circle, normal and force of the tick at a time."""
        ticks = self.ticks
        row = min(int(np.searchsorted(ticks.time, time_s)), len(ticks) - 1)
        turn = self.target.T_target_fixture[:3, :3]
        hip, proxy = self.target.place(np.array([ticks.hip[row], ticks.proxy[row]]))
        angles = np.linspace(0, 2 * np.pi, CIRCLE_POINTS)
        circle = np.column_stack([np.cos(angles), np.sin(angles)]) @ self.target.axes.T
        draw_in_view(
            frame, pose, proxy + self.fixture.contact_radius * circle, paper.WALL_COLOUR, 2
        )
        ends = proxy + np.array([[0.0, 0, 0], NORMAL_M * turn @ ticks.normal[row]])
        draw_in_view(frame, pose, ends, paper.BAND_COLOUR, 2)
        ends = proxy + np.array([[0.0, 0, 0], NEWTON_M * turn @ ticks.force[row]])
        if pose.in_view(ends).all():
            paper.draw_arrow(frame, *pose.project(ends), paper.BLACK)
        for place, colour in ((hip, paper.GUIDE_COLOUR), (proxy, paper.BAND_COLOUR)):
            if pose.in_view(place[None]).all():
                paper.draw_disc(frame, pose.project(place[None])[0], 3, colour)


def draw_in_view(frame: Picture, pose: Pose, line: Array, colour: Any, thickness: int) -> None:
    """Draw those parts of a line (N, 3) that the camera sees."""
    for run in runs(pose.in_view(line), False):
        paper.draw_line(frame, pose.project(line[run]), colour, thickness)


def write_words(frame: Picture, words: str, colour: Any) -> None:
    """Write words on a white strip at the upper edge of a frame."""
    height = frame.shape[0] // 24
    frame[:height] = 255
    scale = height / 34
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(frame, words, (8, round(0.7 * height)), font, scale, colour, 1, cv2.LINE_AA)


# Name of an output -> the codec of its video; others are pictures.
CODECS = {".mp4": "mp4v", ".avi": "MJPG"}


class FrameWriter:
    """Writes frames as a video, as pictures in a folder, or the last one with a wall.

    Parameters
    ----------
    path
        A video or a picture; `None`: neither.
    folder
        Where each frame goes as a picture; `None`: nowhere.
    """

    def __init__(self, path: Path | None, folder: Path | None, rate_hz: float) -> None:
        self.path, self.folder, self.rate_hz = path, folder, rate_hz
        self.video: Any = None
        self.number, self.picture, self.has_wall = 0, None, False

    def write(self, frame: Picture, has_wall: bool) -> None:
        """Take in the next frame."""
        self.number += 1
        if self.folder is not None:
            write_picture(self.folder / f"frame-{self.number:06}.png", frame)
        if self.path is None:
            return
        codec = CODECS.get(self.path.suffix.lower())
        if codec is None:
            if has_wall or not self.has_wall:
                self.picture, self.has_wall = frame, has_wall
            return
        if self.video is None:
            code, size = cv2.VideoWriter.fourcc(*codec), frame.shape[1::-1]
            self.video = cv2.VideoWriter(str(self.path), code, self.rate_hz, size)
        self.video.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))

    def close(self) -> None:
        """Finish the video, or write the picture."""
        if self.video is not None:
            self.video.release()
        elif self.picture is not None:
            write_picture(self.path, self.picture)


def write_picture(path: Path, frame: Picture) -> None:
    """Write a frame in the format of a name."""
    _, data = cv2.imencode(path.suffix.lower(), cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    write_whole(path, [data.tobytes()], overwrite=True)
