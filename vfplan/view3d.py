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
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.display import MAX_DRAWN, nice_length
from vfplan.errors import MissingExtra
from vfplan.fixture import Fixture
from vfplan.geometry.lines import Array, ring_of, row_lengths
from vfplan.images.read import PlannedImage, as_uint8, plane_of_slice
from vfplan.io.sandbox import isolated_python
from vfplan.io.writing import write_whole
from vfplan.palette import CLOUD, FORCE, PROXY, TIP, TUBE, WALL
from vfplan.session.result import TickBlock

# What VTK may render into without a screen. Debian's libosmesa6 and libegl1 have them.
WINDOWS = ("vtkOSOpenGLRenderWindow", "vtkEGLRenderWindow")
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
        done = subprocess.run(command, check=True, **how)
    except (OSError, subprocess.SubprocessError) as error:
        said = str(getattr(error, "stderr", None) or "").strip().splitlines() or [""]
        # The whole command stands before how it ended.
        ending = str(error).rpartition("' ")[2]
        return f"{said[-1][:200]} ({ending})".strip()
    return "" if "drawn True" in done.stdout else "nothing was drawn"


def ready_pyvista(*, screen: bool) -> Any:
    """PyVista, ready to render; raises `MissingExtra` where it would crash."""
    if screen and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise MissingExtra("there is no screen here. Give --screenshot PNG", code="no-screen")
    window = None if screen else offscreen_window()
    fault = "" if window else rendering_fault(None if screen else WINDOWS[-1])
    if fault or not (screen or window):
        where, package = ("on this", "libgl1") if screen else ("without a", "libosmesa6")
        raise MissingExtra(
            f"nothing can be drawn {where} screen: {fault}. Run apt install {package}",
            code="no-opengl",
        )
    if window:
        # VTK reads the variable when it is first imported.
        os.environ[VARIABLE] = window
    import pyvista

    return pyvista


# Width and height of a view.
SIZE_PX = (1200, 900)

# Grey of the slice's border, and of the slice in the legend.
SLICE = "#6b6b6b"


def draw_view(
    fixture: Fixture, path: Path, ticks: TickBlock | None = None, image: PlannedImage | None = None
) -> None:
    """Write one view as a PNG, without a screen; of a replay, its deepest tick.

    fixture: its cloud
    ticks: a replay's ticks; `None`: the cloud alone
    image: the slice that the curve was drawn on; `None`: its border alone
    Raises MissingExtra: nothing here can render; the message names the package that helps
    """
    plotter = set_up(fixture, ticks, image)
    data = io.BytesIO()
    plotter.screenshot(data)
    plotter.close()
    write_whole(path, [data.getvalue()], overwrite=True)


def show(
    fixture: Fixture, ticks: TickBlock | None = None, image: PlannedImage | None = None
) -> None:
    """Open a window: turn and zoom by mouse, move through time by the slider.

    Raises `MissingExtra` where there is no screen or no OpenGL.
    """
    plotter = set_up(fixture, ticks, image, screen=True)
    if ticks is not None:
        times, radius = ticks.time, fixture.contact_radius

        def move(time: float) -> None:
            show_tick(plotter, ticks, radius, int(np.searchsorted(times[1:], time, "right")))

        deepest = float(times[ticks.penetration.argmax()])
        ends = float(times[0]), float(times[-1])
        plotter.add_slider_widget(move, ends, value=deepest, title="time [s]")
    plotter.show(interactive_update=True)
    handle_events(plotter)


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


def set_up(
    fixture: Fixture, ticks: TickBlock | None, image: PlannedImage | None, screen: bool = False
) -> Any:
    """A plotter with the slice, the cloud and paths, a scale, a legend, and the deepest tick.

    fixture, ticks, image: as for `draw_view`
    screen: whether to open a window; without one the plotter's screenshot shows the view
    Raises MissingExtra: nothing here can render
    """
    pyvista = ready_pyvista(screen=screen)
    plotter = pyvista.Plotter(off_screen=not screen, window_size=SIZE_PX)
    plotter.set_background("white")
    legend = add_cloud(plotter, fixture)
    if ticks is not None:
        for path, colour in ((ticks.hip, TIP), (ticks.proxy, PROXY)):
            if len(path) > 1:
                line = pyvista.lines_from_points(path)
                plotter.add_mesh(line, color=colour, line_width=3, opacity=0.8)
        legend += [("tool tip", TIP), ("proxy and normal", PROXY), ("force", FORCE)]
    plotter.add_axes()
    add_scale(plotter, fixture)
    plotter.camera_position = "iso"
    plotter.camera.zoom(1.2)
    # The slice is far larger than the curve: the camera shows the curve, and what of the slice lies
    # around it.
    legend += add_slice(plotter, fixture, image)
    size = (0.14, 0.035 * len(legend))
    plotter.add_legend(legend, bcolor="white", face="circle", loc="upper right", size=size)
    if ticks is not None:
        show_tick(plotter, ticks, fixture.contact_radius, int(ticks.penetration.argmax()))
    return plotter


def add_scale(plotter: Any, fixture: Fixture) -> None:
    """A bar of a round length along the longest side of the cloud, beside it at its top."""
    import pyvista

    sides = np.ptp(fixture.points, axis=0)
    across, along = np.argsort(sides)[1:]
    start = fixture.points.max(axis=0)
    start[along] = fixture.points[:, along].min()
    start[across] = fixture.points[:, across].min() - 0.08 * sides[along]
    length = nice_length(max(float(sides[along]), 1e-3) / 4)
    stop = start + length * np.eye(3)[along]
    words = f"{length:g} px" if fixture.frame == "image" else f"{1e3 * length:g} mm"
    # A white edge shows the bar on a dark slice.
    for colour, width in (("white", 10), ("black", 6)):
        plotter.add_mesh(pyvista.Line(start, stop), color=colour, line_width=width)
    # The words begin at the end that is on the right of the picture.
    plotter.add_point_labels(
        [start if along == 0 else stop], [words], font_size=18, shape_color="white",
        shape_opacity=0.8, show_points=False, always_visible=True, text_color="black",
    )  # fmt: skip


def add_cloud(plotter: Any, fixture: Fixture) -> list[tuple[str, str]]:
    """The points, the wall around strokes that forbid, and the tube around strokes that guide.

    Returns the rows of the legend.
    """
    import pyvista

    stride = -(-len(fixture.points) // MAX_DRAWN)
    points, size = pyvista.PolyData(fixture.points[::stride]), 3.0 if stride > 1 else 5.0
    look = {"render_points_as_spheres": True, "lighting": False, "point_size": size}
    plotter.add_mesh(points, color=CLOUD, **look)
    rows = [("line", CLOUD)]
    if fixture.rendering is not None and fixture.region is not None:
        radius = fixture.contact_radius + fixture.point_radius
        lines = [ring_of(stroke.points, stroke.closed) for stroke in fixture.region.strokes]
        for part in tubes(lines, radius, is_capped=True):
            plotter.add_mesh(part, color=WALL, opacity=0.1)
        # Of a planar fixture it is what stands on the slice.
        rows.append(("wall near the slice", WALL))
    if fixture.guidance is not None:
        guidance = fixture.guidance
        for part in tubes(fixture.guiding_lines, guidance.radius, guidance.ends == "stop"):
            plotter.add_mesh(part, color=TUBE, opacity=0.3)
        rows.append(("tube", TUBE))
    return rows


def tubes(lines: Iterable[Array], radius: float, is_capped: bool) -> Iterator[Any]:
    """A tube around each line (n, 3), and the half spheres that close its ends."""
    import pyvista

    sides = 24
    for line in lines:
        yield pyvista.lines_from_points(line).tube(radius=radius, n_sides=sides, capping=False)
        if is_capped and (line[0] != line[-1]).any():
            for end, inner in (line[:2], line[:-3:-1]):
                half = {"direction": end - inner, "end_phi": 90.0, "theta_resolution": sides}
                yield pyvista.Sphere(radius=radius, center=end, **half)


def add_slice(plotter: Any, fixture: Fixture, image: PlannedImage | None) -> list[tuple[str, str]]:
    """The slice where it lies in front of the robot, or its border if its pixels are not given.

    A bundle that was not drawn on a slice, or does not say where the slice lies, shows none.
    Returns the rows of the legend.
    """
    import pyvista

    size = image or fixture.image
    plane = plane_of_slice(fixture, image)
    if size is None or plane is None or fixture.frame == "image":
        return []
    right, bottom = size.width_px - 0.5, size.height_px - 0.5
    pixels = [[-0.5, -0.5, 1], [right, -0.5, 1], [right, bottom, 1], [-0.5, bottom, 1]]
    square = pyvista.Quadrilateral(np.array(pixels) @ plane.T)
    if image is None:
        plotter.add_mesh(square, style="wireframe", color=SLICE, line_width=2)
    else:
        # A texture's v counts upwards from the last row.
        square.active_texture_coordinates = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
        texture = pyvista.Texture(np.ascontiguousarray(as_uint8(image.rgb)))
        plotter.add_mesh(square, texture=texture, lighting=False, opacity=0.8)
    return [("slice", SLICE)]


def show_tick(plotter: Any, ticks: TickBlock, radius: float, tick: int) -> None:
    """Put tip, proxy, contact sphere [m], normal and force where they were."""
    import pyvista

    hip, proxy = ticks.hip[tick], ticks.proxy[tick]
    for name, centre, share, colour, opacity in (
        ("hip", hip, 0.12, TIP, 1.0), ("proxy", proxy, 0.12, PROXY, 1.0),
        ("contact", proxy, 1.0, PROXY, 0.25),
    ):  # fmt: skip
        ball = pyvista.Sphere(radius=share * radius, center=centre)
        plotter.add_mesh(ball, color=colour, opacity=opacity, name=name)
    plotter.add_arrows(proxy, ticks.normal[tick], 2.0 * radius, color=PROXY, name="normal")
    force = row_lengths(ticks.force)
    scale = 1.4 * radius / max(force.max(), 1e-12)
    plotter.add_arrows(hip, ticks.force[tick], scale, color=FORCE, name="force")
    depth = 1e3 * ticks.penetration[tick]
    text = f"t = {ticks.time[tick]:z.3f} s   force {force[tick]:.3f} N   penetration {depth:.3f} mm"
    look = {"position": (20, SIZE_PX[1] - 40), "font_size": 10, "color": "black"}
    plotter.add_text(text, name="readout", **look)
