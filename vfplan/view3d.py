"""Three-dimensional views by PyVista: on a screen, or without one as PNG.

VTK ends the whole process where it finds no OpenGL library. The ways to render are therefore first
tried in a process of their own.
"""

from __future__ import annotations

import functools
import io
import os
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from vfplan.display import MAX_DRAWN, nice_length
from vfplan.errors import MissingExtra
from vfplan.fixture import Fixture
from vfplan.geometry.lines import ring_of
from vfplan.images.read import PlannedImage, as_uint8, plane_of_slice
from vfplan.io.sandbox import isolated_python
from vfplan.io.writing import write_whole
from vfplan.palette import BRIDGED, CLOUD, CONTACT, FORCE, HIP, PROXY
from vfplan.session.result import TickBlock

# What VTK may render into without a screen, and the Debian package that each of them needs.
WINDOWS = {"vtkOSOpenGLRenderWindow": "libosmesa6", "vtkEGLRenderWindow": "libegl1"}
VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"

# Seconds that the first picture may take. It takes one or two; a cold disk some more.
PROBE_LIMIT_S = 60

PROBE = (
    "import pyvista as pv; p = pv.Plotter(off_screen={off}, window_size=(32, 32)); "
    "p.add_mesh(pv.Sphere(), color='red'); "
    "p.show(auto_close=False, interactive=False, interactive_update=not {off}); "
    "image = p.screenshot(return_img=True); print('drawn', int(image.max()) > int(image.min())); "
    # VTK draws without a screen where it finds none. Only then it has no window to attend to.
    "None if {off} else p.iren.process_events()"
)


@functools.cache
def offscreen_window() -> str | None:
    """The VTK window class that renders here without a screen; `None` where none does."""
    return next((name for name in WINDOWS if not rendering_fault(name)), None)


@functools.cache
def rendering_fault(window: str | None) -> str:
    """Why nothing can be drawn, in a line; empty where it can.

    window: a window class of VTK, which needs no screen; `None`: a window on the screen
    """
    chosen = {} if window is None else {VARIABLE: window}
    # Matplotlib, which PyVista loads, would read settings of the current folder.
    how = {"env": {**os.environ, **chosen}, "cwd": "/", "stdin": subprocess.DEVNULL}
    how |= {"capture_output": True, "text": True, "errors": "replace", "timeout": PROBE_LIMIT_S}
    command = isolated_python(PROBE.format(off=window is not None))
    try:
        done = subprocess.run(command, check=False, **how)
    except subprocess.TimeoutExpired:
        return f"a first picture was not there after {PROBE_LIMIT_S} s"
    except OSError as error:
        return str(error)
    if done.returncode == 0 and "drawn True" in done.stdout:
        return ""
    lines = [line.strip()[:200] for line in done.stderr.splitlines() if line.strip()]
    reason = lines[-1] if lines else "nothing was drawn"
    if done.returncode < 0:
        reason += f" (ended by signal {-done.returncode})"
    return reason


def ready_pyvista(*, screen: bool) -> Any:
    """PyVista, ready to render; raises `MissingExtra` where it would crash."""
    if screen:
        if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise MissingExtra("there is no screen here. Give --screenshot PNG", code="no-screen")
        fault = rendering_fault(None)
        if fault:
            message = f"nothing can be drawn on this screen: {fault}. Run apt install libgl1"
            raise MissingExtra(message, code="no-opengl")
    else:
        window = offscreen_window()
        if window is None:
            fault = rendering_fault(list(WINDOWS)[-1])
            packages = " or ".join(WINDOWS.values())
            raise MissingExtra(
                f"nothing can be drawn without a screen: {fault}. Install Debian's "
                f"{packages}: apt install {WINDOWS['vtkOSOpenGLRenderWindow']}",
                code="no-opengl",
            )
        # VTK reads the variable when it is first imported.
        os.environ[VARIABLE] = window
    import pyvista

    return pyvista


Array = NDArray[np.float64]

# Width and height of a view.
SIZE_PX = (1200, 900)

# Grey of the slice's border, and of the slice in the legend.
SLICE = "#8a8a8a"


def draw_view(
    fixture: Fixture, path: Path, ticks: TickBlock | None = None, image: PlannedImage | None = None
) -> None:
    """Write one view as a PNG, without a screen; of a replay, its deepest tick.

    fixture: its cloud
    ticks: a replay's ticks; `None`: the cloud alone
    image: the slice that the curve was drawn on; `None`: its border alone
    Raises MissingExtra: nothing here can render; the message names the package that helps
    """
    stage = Stage(fixture, ticks, image)
    picture = Image.fromarray(stage.plotter.screenshot(return_img=True))
    stage.plotter.close()
    data = io.BytesIO()
    picture.save(data, format="PNG")
    write_whole(path, [data.getvalue()], overwrite=True)


def show(
    fixture: Fixture, ticks: TickBlock | None = None, image: PlannedImage | None = None
) -> None:
    """Open a window: turn and zoom by mouse, move through time by the slider.

    Raises `MissingExtra` where there is no screen or no OpenGL.
    """
    stage = Stage(fixture, ticks, image, screen=True)
    if ticks is not None:
        stage.plotter.add_slider_widget(
            lambda time: stage.show_tick(int(np.searchsorted(ticks.time, time, "right")) - 1),
            (float(ticks.time[0]), float(ticks.time[-1])),
            value=float(ticks.time[ticks.penetration.argmax()]),
            title="time [s]",
        )
    stage.plotter.show(interactive_update=True)
    handle_events(stage.plotter)


def handle_events(plotter: Any) -> None:
    """Let the window react until it is closed, from Python, so that signals end it.

    VTK's own loop returns only when the window closes, and Python handles signals between calls.
    """
    closed = []
    plotter.iren.add_observer("ExitEvent", lambda *_: closed.append(True))
    try:
        while not closed and plotter.render_window is not None:
            plotter.iren.process_events()
            time.sleep(0.01)
    finally:
        plotter.close()


class Stage:
    """The slice, the cloud and paths with a scale and a legend, and the parts that move with time.

    It begins with the deepest tick.

    fixture, ticks, image: as for `draw_view`
    screen: whether to open a window; without one the plotter's screenshot shows the view
    Raises MissingExtra: nothing here can render
    """

    def __init__(
        self, fixture: Fixture, ticks: TickBlock | None, image: PlannedImage | None,
        screen: bool = False,
    ) -> None:  # fmt: skip
        self._pv = pyvista = ready_pyvista(screen=screen)
        self._fixture, self._ticks = fixture, ticks
        self._legend = []
        self.plotter = pyvista.Plotter(off_screen=not screen, window_size=SIZE_PX)
        self.plotter.set_background("white")
        self._add_cloud()
        if ticks is not None:
            for path, colour in ((ticks.hip, HIP), (ticks.proxy, PROXY)):
                if len(path) > 1:
                    line = pyvista.lines_from_points(path)
                    self.plotter.add_mesh(line, color=colour, line_width=3, opacity=0.8)
            self._legend += [("tool (HIP)", HIP), ("proxy", PROXY)]
            self._legend += [("contact sphere", CONTACT), ("force", FORCE)]
        self.plotter.add_axes()
        # A bar of a round length along the longest side of the cloud, beside it at its top.
        sides = np.ptp(fixture.points, axis=0)
        across, along = np.argsort(sides)[1:]
        start = fixture.points.max(axis=0)
        start[along] = fixture.points[:, along].min()
        start[across] = fixture.points[:, across].min() - 0.08 * sides[along]
        length = nice_length(max(float(sides[along]), 1e-3) / 4)
        stop = start + length * np.eye(3)[along]
        words = f"{length:g} px" if fixture.frame == "image" else f"{1e3 * length:g} mm"
        bar = pyvista.Line(start, stop)
        # A white edge shows the bar on a dark slice.
        self.plotter.add_mesh(bar, color="white", line_width=10)
        self.plotter.add_mesh(bar, color="black", line_width=6)
        self.plotter.add_point_labels(
            [stop], [words], font_size=18, shape_color="white", shape_opacity=0.8,
            show_points=False, always_visible=True, text_color="black",
        )  # fmt: skip
        self.plotter.camera_position = "iso"
        self.plotter.camera.zoom(1.2)
        # The slice is far larger than the curve: the camera shows the curve, and what of the slice
        # lies around it.
        self._add_slice(image)
        height = 0.035 * len(self._legend)
        self.plotter.add_legend(
            self._legend, bcolor="white", face="circle", loc="upper right", size=(0.14, height)
        )
        if ticks is not None:
            self.show_tick(int(ticks.penetration.argmax()))

    def _add_cloud(self) -> None:
        fixture = self._fixture
        stride = -(-len(fixture.points) // MAX_DRAWN)
        cloud = self._pv.PolyData(fixture.points[::stride])
        look = {"point_size": 3.0 if stride > 1 else 5.0, "render_points_as_spheres": True}
        self.plotter.add_mesh(cloud, color=CLOUD, **look)
        self._legend.append(("fixture", CLOUD))
        if fixture.guidance is not None:
            # The tube around the strokes that guide.
            for number, stroke in enumerate(fixture.strokes):
                if len(stroke.points) < 2 or fixture.guidance.stroke not in (None, number):
                    continue
                centre = self._pv.lines_from_points(ring_of(stroke.points, stroke.closed))
                tube = centre.tube(radius=fixture.guidance.radius, n_sides=24)
                self.plotter.add_mesh(tube, color=BRIDGED, opacity=0.3)
            self._legend.append(("tube that guides", BRIDGED))
        if fixture.rendering is None or fixture.ignore_axis is None or fixture.curve is None:
            return
        # A planar fixture goes on along its ignored axis: show a strip of it.
        up = 2 * fixture.contact_radius * fixture.ignore_axis
        for stroke in fixture.strokes:
            line = stroke.points
            if len(line) > 1:
                grid = np.stack([line - up, line + up], axis=1)
                x, y, z = np.moveaxis(grid, -1, 0)[:, None]
                strip = self._pv.StructuredGrid(x, y, z)
                self.plotter.add_mesh(strip, color=CLOUD, opacity=0.15)

    def _add_slice(self, image: PlannedImage | None) -> None:
        """The slice where it lies in front of the robot, or its border if its pixels are not given.

        A bundle that was not drawn on a slice, or does not say where the slice lies, shows none.
        """
        size = image or self._fixture.image
        plane = plane_of_slice(self._fixture, image)
        if size is None or plane is None or self._fixture.frame == "image":
            return
        right, bottom = size.width_px - 0.5, size.height_px - 0.5
        pixels = [[-0.5, -0.5, 1], [right, -0.5, 1], [right, bottom, 1], [-0.5, bottom, 1]]
        corners = np.array(pixels) @ plane.T
        if image is None:
            border = self._pv.lines_from_points(np.vstack([corners, corners[:1]]))
            self.plotter.add_mesh(border, color=SLICE, line_width=2)
        else:
            square = self._pv.PolyData(corners, faces=[4, 0, 1, 2, 3])
            # A texture's v counts upwards from the last row.
            places = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
            square.active_texture_coordinates = places
            texture = self._pv.Texture(np.ascontiguousarray(as_uint8(image.rgb)))
            self.plotter.add_mesh(square, texture=texture, lighting=False, opacity=0.8)
        self._legend.append(("slice", SLICE))

    def show_tick(self, tick: int) -> None:
        """Put HIP, proxy, contact sphere, normal and force where they were."""
        ticks, radius = self._ticks, self._fixture.contact_radius
        hip, proxy = ticks.hip[tick], ticks.proxy[tick]
        pv, add = self._pv, self.plotter.add_mesh
        add(pv.Sphere(radius=0.12 * radius, center=hip), color=HIP, name="hip")
        add(pv.Sphere(radius=0.12 * radius, center=proxy), color=PROXY, name="proxy")
        add(pv.Sphere(radius=radius, center=proxy), color=CONTACT, opacity=0.25, name="contact")
        self._arrow("normal", proxy, ticks.normal[tick] * 2.0 * radius, PROXY)
        peak = np.sqrt((ticks.force**2).sum(axis=1).max())
        self._arrow("force", hip, ticks.force[tick] / max(peak, 1e-12) * 1.4 * radius, FORCE)
        force = float(np.sqrt((ticks.force[tick] ** 2).sum()))
        depth = 1e3 * ticks.penetration[tick]
        text = f"t = {ticks.time[tick]:.3f} s   force {force:.3f} N   depth {depth:.3f} mm"
        self.plotter.add_text(text, font_size=10, color="black", name="readout")

    def _arrow(self, name: str, start: Array, vector: Array, colour: str) -> None:
        length = float(np.sqrt((vector**2).sum()))
        if length < 1e-9:
            self.plotter.remove_actor(name)
            return
        arrow = self._pv.Arrow(
            start=start, direction=vector, scale=length, shaft_radius=0.025, tip_radius=0.07
        )
        self.plotter.add_mesh(arrow, color=colour, name=name)
