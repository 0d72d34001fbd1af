"""The plan on a camera's frame, line, bands, outline and tool, or why nothing is drawn.

`Window` shows the frames of `vfplan ar --window` in a page of the browser, with their latency.
"""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import cv2
import numpy as np

from vfplan.camera import CODECS, LIMIT_MM
from vfplan.camera.pose import Array, Camera, Picture, Pose, find_tags, locate, make_finder
from vfplan.camera.sheet import SCALE_MM, Plan, TagCorners
from vfplan.display import MM, Report
from vfplan.errors import CheckFailed, InputError
from vfplan.geometry.lines import in_space, normals, ring_of, runs
from vfplan.images.read import as_uint8, is_picture_file, read_image
from vfplan.io.files import opened_file
from vfplan.io.sandbox import Loopback, reply
from vfplan.io.writing import write_whole
from vfplan.report.page import document, part
from vfplan.review import paper
from vfplan.review.markers import bound95_m
from vfplan.review.picture import RENDERED
from vfplan.review.rendered import registration_again, strokes_on_slice
from vfplan.review.server import HEADERS

# How exactly a ruler tells the printed scale [mm].
RULER_MM = 0.5

# Number of places of the plan at which the bound is taken.
BOUND_PLACES = 100

# Number of points of the contact circle.
CIRCLE_POINTS = 48

# Length of the arrow of a newton [m].
NEWTON_M = 5e-3

# Length of the line of the normal [m].
NORMAL_M = 10e-3

# Distance of a place from the middle of the picture up to which a line is drawn, in halves of the
# picture's width and height. The model of the lens holds no further out.
MAX_FROM_MIDDLE = 1.3


def frames_of(source: Path, size: tuple[int, int]) -> Iterator[tuple[float, float, Picture]]:
    """Time [s], frames a second, and frame, red first, of a picture, a video or a camera.

    source: a file, or the number of a camera, which is asked for pictures of this size
    """
    if is_picture_file(source):
        yield 0.0, 1.0, as_uint8(read_image(source, pixels="as-stored").rgb).copy()
        return
    is_camera, started, number = str(source).isdecimal(), time.monotonic(), 0
    # Else OpenCV and FFmpeg print lines of their own about a file that is no video.
    cv2.utils.logging.setLogLevel(0)
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    if not is_camera:
        # OpenCV would wait for whoever writes into a pipe.
        opened_file(source).close()
    video = cv2.VideoCapture(int(str(source)) if is_camera else str(source))
    if is_camera:
        video.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
        video.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
        # No frame waits for the one before.
        video.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    rate_hz = video.get(cv2.CAP_PROP_FPS) or 30.0
    while (read := video.read())[0]:
        time_s = time.monotonic() - started if is_camera else number / rate_hz
        yield time_s, rate_hz, cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB)
        number += 1
    if not number:
        text = "gives no frame. Name a picture, a video, or the number of a camera"
        raise InputError(text, where=source, code="camera-source")


@dataclass(eq=False)
class Overlay:
    """Draws one plan on the frames of one camera.

    Parameters
    ----------
    tags
        Number -> (4, 3) corners on the sheet [m].
    is_printed
        Whether they were printed with this plan, so that any other number is another plan's.
    limit_mm
        A frame whose bound is larger shows no wall.
    measured_mm
        Length of the printed scale by a ruler. A camera cannot know it: a print of half the size
        looks the same from half the distance. Where it is `None`, each frame of a print says so.
    tick_at
        The tick of `vfplan.session.bags.TICK` at the time of a frame [s], and words; `None`: no
        tool is shown, and the words say why.
    """

    plan: Plan
    tags: TagCorners
    camera: Camera
    is_printed: bool = True
    limit_mm: float = LIMIT_MM
    measured_mm: float | None = None
    tick_at: Callable[[float], tuple[Any, str]] = lambda time_s: (None, "")
    finder: Any = field(default_factory=make_finder)
    # How far the plan may lie from its place, in words; empty where its registration is not known.
    plan_bound: str = field(default="", init=False)
    # How many frames showed a tool.
    tools_shown: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        """Find once what every frame shows: colour, width [px] and line, the lowest first."""
        lines, fixture = self.plan.lines(), self.plan.fixture
        whole = np.vstack(lines or [self.plan.place(fixture.points)])
        self.places = whole[:: -(-len(whole) // BOUND_PLACES)]
        outlines = [(RENDERED[kind].colour, line) for kind, line in self.plan.outlines()]
        self.drawn = [(paper.WHITE, 4, line) for _, line in outlines]
        self.drawn += [(colour, 2, line) for colour, line in outlines]
        self.drawn += [(paper.LINE_COLOUR, 2, line) for line in lines]
        if fixture.registration is None or fixture.registration.source_frame != "image":
            return
        strokes, registration = strokes_on_slice(fixture, None), registration_again(fixture)
        if registration is None:
            return
        bound = bound95_m(registration, strokes, None)
        self.plan_bound = f", the plan within {MM * bound.max():.2f} mm"
        bounds = np.split(bound, np.cumsum([len(stroke.points) for stroke in strokes])[:-1])
        for line, stroke, bound_of_points in zip(lines, strokes, bounds, strict=False):
            # From each point of the line to the border of its band.
            widths = ring_of(bound_of_points[:, None], stroke.closed)
            across = in_space(widths * normals(line[:, :2], False))
            self.drawn += [(paper.BAND_COLOUR, 1, line + side * across) for side in (-1, 1)]

    def see(self, frame: Picture) -> tuple[Report, Pose | None]:
        """The report of a frame, with the reason where no wall may be drawn, and the pose."""
        names = ("refused", "reprojection_px", "bound_mm", "pose_T_camera_sheet")
        report, pose = dict.fromkeys(names), None
        try:
            if frame.shape[1::-1] != self.camera.size:
                sizes = f"{self.camera.size} pixels, not {frame.shape[1::-1]}"
                text = f"The camera was calibrated in {sizes}"
                raise CheckFailed(text, code="camera-size")
            if abs((self.measured_mm or SCALE_MM) - SCALE_MM) > RULER_MM:
                text = f"The scale is {self.measured_mm:g} mm long. Print the sheet at 100 %"
                raise CheckFailed(text, code="wrong-scale")
            found = find_tags(self.finder, cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY))
            pose = locate(found, self.tags, self.camera, is_printed=self.is_printed)
            bound_mm = MM * float(pose.bound_m(self.places).max())
            report |= {
                "reprojection_px": float(np.sqrt(np.mean(pose.residuals**2))),
                "bound_mm": bound_mm, "pose_T_camera_sheet": pose.T_camera_sheet.tolist(),
            }  # fmt: skip
            # Written so that a bound of NaN refuses the frame too.
            if not bound_mm <= self.limit_mm:
                raise CheckFailed(
                    f"The line may be off by {bound_mm:.2f} mm. Show more tags, sharper or nearer",
                    code="bound-too-large",
                )
        except CheckFailed as refusal:
            report |= {"refused": refusal.code, "reason": refusal.message}
        except (cv2.error, np.linalg.LinAlgError):
            reason = "The tags do not lie as a camera sees them. Check --tags"
            report |= {"refused": "tags-misplaced", "reason": reason}
        return report, pose

    def show(self, frame: Picture, time_s: float) -> Report:
        """Draw the plan on a frame that was taken at this time; returns the frame's report."""
        report, pose = self.see(frame)
        words, colour = f"No wall: {report.get('reason')}", paper.WALL_COLOUR
        if report["refused"] is None:
            self.draw(frame, pose, report["bound_mm"] / MM)
            tick, why_none = self.tick_at(time_s)
            if tick is not None:
                self.draw_tool(frame, pose, tick)
                self.tools_shown += 1
            words = f"the camera within {report['bound_mm']:.2f} mm{self.plan_bound} (95 %)"
            colour = paper.BLACK
            if self.is_printed and self.measured_mm is None:
                words, colour = f"Scale not measured; {words}", paper.WALL_COLOUR
            if why_none:
                words, colour = f"{why_none}; {words}", paper.WALL_COLOUR
        # In a narrow frame the words are small.
        font = cv2.FONT_HERSHEY_SIMPLEX
        size = min(0.8, 0.8 * (frame.shape[1] - 16) / cv2.getTextSize(words, font, 0.8, 1)[0][0])
        frame[:30] = 255
        cv2.putText(frame, words, (8, 21), font, size, colour, 1, cv2.LINE_AA)
        return report

    def draw(self, frame: Picture, pose: Pose, bound_m: float) -> None:
        """Draw the line on a white band as wide as the pose's bound, the wall and its own band."""
        width = 5 + round(2 * bound_m * pose.camera.camera_matrix[0, 0] / pose.vector[5])
        for line in self.plan.lines():
            draw_in_view(frame, pose, line, paper.WHITE, width)
        for colour, thickness, line in self.drawn:
            draw_in_view(frame, pose, line, colour, thickness)

    def draw_tool(self, frame: Picture, pose: Pose, tick: Any) -> None:
        """Draw tip, proxy, contact circle, normal and force of a tick."""
        hip, proxy = tick["hip"], tick["proxy"]
        arms = (NORMAL_M * tick["normal"], NEWTON_M * tick["force"])
        places = self.plan.place(np.array([proxy, hip, *(proxy + arm for arm in arms)]))
        angle = np.linspace(0, 2 * np.pi, CIRCLE_POINTS)
        circle = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        circle = places[0] + self.plan.fixture.contact_radius * circle
        draw_in_view(frame, pose, circle, paper.PROXY_COLOUR, 2)
        draw_in_view(frame, pose, places[[0, 2]], paper.PROXY_COLOUR, 2)
        if in_view(pose, places).all():
            at = pose.project(places)
            paper.draw_arrow(frame, at[0], at[3], paper.BLACK)
            paper.draw_disc(frame, at[1], 3, paper.TIP_COLOUR)
            paper.draw_disc(frame, at[0], 3, paper.PROXY_COLOUR)


def in_view(pose: Pose, places: Array) -> Any:
    """(N,) whether places lie in front of the camera, within or close around its picture."""
    T, camera = pose.T_camera_sheet, pose.camera
    x, y, z = camera.camera_matrix @ (places @ T[:3, :3].T + T[:3, 3]).T
    half = np.reshape(camera.size, (2, 1)) / 2
    return (z > 0) & (np.abs([x, y] - half * z) < MAX_FROM_MIDDLE * half * z).all(axis=0)


def draw_in_view(frame: Picture, pose: Pose, line: Array, colour: Any, thickness: int) -> None:
    """Draw those parts of a line (N, 3) that the camera sees."""
    for run in runs(in_view(pose, line), False):
        paper.draw_line(frame, pose.project(line[run]), colour, thickness)


class Film:
    """The file that keeps the frames: a video, or the last frame with a wall, or no file.

    path: where to write; its suffix tells a video from a picture; `None`: nowhere
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.codec = None if path is None else CODECS.get(path.suffix.lower())
        self.video: Any = None
        # The last frame with a wall.
        self.picture: Picture | None = None

    def add(self, frame: Picture, rate_hz: float, refused: str | None) -> None:
        """Take a frame, with the reason where it shows no wall."""
        if refused is None:
            self.picture = frame
        if self.codec is None:
            return
        if self.video is None:
            code = cv2.VideoWriter.fourcc(*self.codec)
            self.video = cv2.VideoWriter(str(self.path), code, rate_hz, frame.shape[1::-1])
        self.video.write(frame)

    def close(self) -> None:
        """Finish the file; without a wall in any frame there is none."""
        if self.video is not None:
            self.video.release()
            if self.picture is None:
                self.path.unlink()
        elif self.picture is not None and self.path is not None:
            data = cv2.imencode(self.path.suffix.lower(), self.picture)[1].tobytes()
            write_whole(self.path, [data], overwrite=True)


# Seconds after which a page that waits for a frame is looked after: it may have gone.
WAIT_S = 0.2

# The page's own policy stands in it, because its script does too.
PAGE_HEADERS = HEADERS.copy()
del PAGE_HEADERS["Content-Security-Policy"]


class Window(Loopback):
    """Serves one page, and its frames to whoever has the token, until it is closed.

    A page gets the newest frame once it has drawn the one before, so that none waits in a queue.

    name: stands on the page
    port: 0: one that the system chooses
    Raises MissingExtra: without the package websockets
    Raises OutputError: the port is taken
    """

    def __init__(self, name: str, port: int) -> None:
        # From the reading of a frame to the page's answer that it is drawn [ms].
        self.latencies_ms: list[float] = []
        self.frame, self.words, self.read_s = None, {"frame": 0}, 0.0
        self.has_changed = threading.Condition()
        title = f"Camera: {escape(name)}"
        body = f"<header><h1>{title}</h1></header>" + part("window.html", "vfplan.camera")
        body += f"<script>{part('window.js', 'vfplan.camera')}</script>"
        self.page = document(title, body, live=True).encode()
        super().__init__(port, self.answer, self.talk)

    def show(self, frame: Picture, refused: str | None, read_s: float) -> None:
        """Show a frame, blue first, that was read at a time of `time.monotonic`."""
        with self.has_changed:
            self.words = {"frame": self.words["frame"] + 1, "refused": refused}
            self.frame, self.read_s = frame, read_s
            self.has_changed.notify_all()

    def answer(self, connection: Any, request: Any) -> Any:
        """The page, or `None` where whoever asks may have the frames; else a refusal."""
        address = urlsplit(request.path)
        if address.path == "/":
            return reply(connection, self.page, "text/html; charset=utf-8", PAGE_HEADERS)
        if address.path != "/frames":
            return connection.respond(404, "there is one page, /")
        if not self.has_token(parse_qs(address.query)):
            return connection.respond(403, "the address lacks the token of this run")
        return None

    def talk(self, connection: Any) -> None:
        """Send frames until the connection is closed, which sending or receiving raises."""
        shown, latency_ms = 0, None
        while True:
            with self.has_changed:
                if self.words["frame"] == shown:
                    self.has_changed.wait(WAIT_S)
                words, frame, read_s = self.words, self.frame, self.read_s
            if words["frame"] == shown:
                # This raises where the page has gone.
                connection.ping()
                continue
            connection.send(json.dumps(words | {"latency_ms": latency_ms}))
            connection.send(cv2.imencode(".jpg", frame)[1].tobytes())
            connection.recv()
            shown, latency_ms = words["frame"], 1e3 * (time.monotonic() - read_s)
            self.latencies_ms.append(latency_ms)
