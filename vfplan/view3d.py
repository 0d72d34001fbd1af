"""Three-dimensional views by PyVista: on a screen, or without one as PNG."""

from __future__ import annotations

import io
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from vfplan.errors import SettingError
from vfplan.fixture import Fixture
from vfplan.io.opengl import ready_pyvista
from vfplan.io.staging import write_whole
from vfplan.palette import CLOUD, CONTACT, FORCE, HIP, PROXY
from vfplan.replaying.thinning import contact_marks
from vfplan.session import TickBlock

Array = NDArray[np.float64]

_CLOUD = 5000  # points drawn: of more, every n-th


def draw_view(
    fixture: Fixture,
    path: Path,
    *,
    ticks: TickBlock | None = None,
    at_s: float | None = None,
    mark_hz: float | None = None,
    size: tuple[int, int] = (1200, 900),
) -> None:
    """Write one view as a PNG, without a screen.

    fixture: its cloud
    ticks: a replay's ticks; `None`: the cloud alone
    at_s: the time shown [s]; `None`: the deepest tick
    mark_hz: instead of one tick, contact circles and normals so often a second (the paper's Fig.
        4b).
    size: (width, height) [px]
    Raises MissingExtra: nothing here can render; the message names the package that helps
    Raises SettingError: a time outside the replay
    """
    stage = Stage(fixture, ticks, size)
    if mark_hz is not None and ticks is not None:
        stage.show_marks(contact_marks(ticks, mark_hz))
    else:
        stage.show_tick(stage.tick_at(at_s))
    image = stage.image()
    stage.plotter.close()
    _save(path, image, "PNG")


def _save(path: Path, image: Any, kind: str, **how: Any) -> None:
    held = io.BytesIO()
    image.save(held, format=kind, **how)
    write_whole(path, [held.getvalue()], overwrite=True)


def show(fixture: Fixture, ticks: TickBlock | None = None) -> None:
    """Open a window: turn and zoom by mouse, move through time by the slider.

    Raises `MissingExtra` where there is no screen or no OpenGL.
    """
    stage = Stage(fixture, ticks, (1200, 900), screen=True)
    stage.show_tick(stage.tick_at(None))
    if ticks is not None:
        stage.plotter.add_slider_widget(
            lambda time: stage.show_tick(stage.tick_at(time)),
            (float(ticks.time[0]), float(ticks.time[-1])),
            value=float(ticks.time[stage.tick_at(None)]),
            title="time [s]",
        )
    stage.plotter.show(interactive_update=True)
    _attend(stage.plotter)


def _attend(plotter: Any) -> None:
    """Let the window answer until it is closed, in Python's hands: signals are heeded.

    VTK's own loop returns only when the window closes, and Python hears of signals between calls.
    """
    closed: list[bool] = []
    plotter.iren.add_observer("ExitEvent", lambda *_: closed.append(True))
    try:
        while not closed and plotter.render_window is not None:
            plotter.iren.process_events()
            time.sleep(0.01)
    finally:
        plotter.close()


class Stage:
    """The cloud and paths, and the parts that move with time.

    fixture, ticks, size: as for `draw_view`
    screen: whether it is to be seen there; else `image` gives what is to be seen
    Raises MissingExtra: nothing here can render
    """

    def __init__(
        self, fixture: Fixture, ticks: TickBlock | None, size: tuple[int, int], screen: bool = False
    ) -> None:
        self._pv = pyvista = ready_pyvista(screen=screen)
        self._fixture, self._ticks = fixture, ticks
        self.plotter = pyvista.Plotter(off_screen=not screen, window_size=size)
        self.plotter.set_background("white")
        self._add_cloud()
        if ticks is not None:
            for path, colour, width in ((ticks.hip, HIP, 3), (ticks.proxy, PROXY, 3)):
                if len(path) > 1:
                    line = pyvista.lines_from_points(path)
                    self.plotter.add_mesh(line, color=colour, line_width=width, opacity=0.8)
        self.plotter.add_axes()
        self._look()

    def image(self) -> Image.Image:
        """What is to be seen now."""
        return Image.fromarray(self.plotter.screenshot(return_img=True))

    def _add_cloud(self) -> None:
        fixture = self._fixture
        thin = -(-len(fixture.points) // _CLOUD)
        self.plotter.add_mesh(
            self._pv.PolyData(fixture.points[::thin]),
            color=CLOUD,
            point_size=5.0 if thin == 1 else 3.0,
            render_points_as_spheres=True,
        )
        if fixture.guidance is not None:
            self._add_tube()
        if fixture.rendering is None or fixture.ignore_axis is None or fixture.curve is None:
            return
        # A planar fixture goes on along its ignored axis: show a strip of it.
        up = 2 * fixture.contact_radius * fixture.ignore_axis
        for stroke in range(len(fixture.curve.closed)):
            line = fixture.points[fixture.curve.stroke == stroke]
            if len(line) > 1:
                grid = np.stack([line - up, line + up], axis=1)
                strip = self._pv.StructuredGrid(*(grid[..., i][None] for i in range(3)))
                self.plotter.add_mesh(strip, color=CLOUD, opacity=0.15)

    def _add_tube(self) -> None:
        """The tube around the strokes that guide."""
        fixture = self._fixture
        for stroke, closed in enumerate(fixture.curve.closed):
            line = fixture.points[fixture.curve.stroke == stroke]
            if len(line) < 2 or fixture.guidance.stroke not in (None, stroke):
                continue
            around = self._pv.lines_from_points(np.vstack([line, line[:1]]) if closed else line)
            tube = around.tube(radius=fixture.guidance.radius, n_sides=24)
            self.plotter.add_mesh(tube, color=PROXY, opacity=0.2)

    def _look(self) -> None:
        fixture = self._fixture
        middle = fixture.points.mean(axis=0)
        spread = max(float(np.ptp(fixture.points, axis=0).max()), 1e-3)
        thin = np.linalg.eigh(np.cov((fixture.points - middle).T + 1e-12))[1][:, 0]
        if self._ticks is not None:
            thin = thin * (1 if (self._ticks.hip - middle).mean(axis=0) @ thin >= 0 else -1)
        side = np.cross(thin, np.eye(3)[np.argmin(np.abs(thin))])
        self.plotter.camera_position = [
            tuple(
                middle + 2.0 * spread * (0.75 * thin + 0.55 * side + 0.35 * np.cross(thin, side))
            ),
            tuple(middle),
            tuple(thin),
        ]
        self.plotter.reset_camera()
        self.plotter.camera.zoom(1.1)

    def tick_at(self, time: float | None) -> int:
        """The tick at a time, or the deepest one."""
        if self._ticks is None:
            if time is not None:
                raise SettingError("a time needs a result to show")
            return 0
        if time is None:
            return int(np.argmax(self._ticks.penetration))
        first, last = self._ticks.time[0], self._ticks.time[-1]
        if not first <= time <= last:
            raise SettingError(f"time {time:g} s; {first:g} to {last:g} s wanted")
        return int(np.searchsorted(self._ticks.time, time, "right")) - 1

    def show_tick(self, tick: int) -> None:
        """Put HIP, proxy, contact sphere, normal and force where they were."""
        if self._ticks is None:
            return
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

    def show_marks(self, marks: NDArray[np.intp]) -> None:
        """Contact circles, in the plane of normal and motion, and normals at some ticks."""
        ticks, radius = self._ticks, self._fixture.contact_radius
        for k in marks:
            normal, proxy = ticks.normal[k], ticks.proxy[k]
            if not normal.any():
                continue
            ahead = ticks.proxy[min(k + 50, len(ticks) - 1)] - proxy
            across = np.cross(normal, ahead if np.abs(ahead).max() > 1e-6 else np.eye(3)[0])
            ring = self._pv.Polygon(center=proxy, radius=radius, normal=across, n_sides=48)
            self.plotter.add_mesh(ring.extract_feature_edges(), color=CONTACT, line_width=2.5)
            self._arrow(f"normal {k}", proxy, 1.4 * radius * normal, PROXY)

    def _arrow(self, name: str, start: Array, vector: Array, colour: str) -> None:
        length = float(np.sqrt((vector**2).sum()))
        if length < 1e-9:
            self.plotter.remove_actor(name)
            return
        arrow = self._pv.Arrow(
            start=start, direction=vector, scale=length, shaft_radius=0.025, tip_radius=0.07
        )
        self.plotter.add_mesh(arrow, color=colour, name=name)
