"""Whether PyVista can render here.

VTK ends the whole process where it finds no OpenGL library. The ways to render are therefore first
tried in a process of their own.
"""

from __future__ import annotations

import functools
import os
import subprocess
from importlib.util import find_spec
from typing import Any

from vfplan.errors import MissingExtra
from vfplan.io.sandbox import isolated_python

# What VTK may render into without a screen, and the Debian package that each of them needs.
WINDOWS = {"vtkOSOpenGLRenderWindow": "libosmesa6", "vtkEGLRenderWindow": "libegl1"}
VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"

PROBE_LIMIT_S = 60
"""Seconds that the first picture may take. It takes one or two; a cold disk some more."""

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
    for name in WINDOWS:
        if not rendering_fault(name):
            return name
    return None


@functools.cache
def rendering_fault(window: str | None) -> str:
    """Why nothing can be drawn, in a line; empty where it can.

    window: a window class of VTK, which needs no screen; `None`: a window on the screen
    """
    environment = dict(os.environ)
    if window is not None:
        environment[VARIABLE] = window
    try:
        done = subprocess.run(
            isolated_python(PROBE.format(off=window is not None)),
            capture_output=True,
            text=True,
            errors="replace",
            stdin=subprocess.DEVNULL,
            timeout=PROBE_LIMIT_S,
            env=environment,
            # Matplotlib, which PyVista loads, would read settings of the current folder.
            cwd="/",
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"a first picture was not there after {PROBE_LIMIT_S} s"
    except OSError as error:
        return str(error)
    if done.returncode == 0 and "drawn True" in done.stdout:
        return ""
    reason = "nothing was drawn"
    for line in done.stderr.splitlines():
        if line.strip():
            reason = line.strip()[:200]
    if done.returncode < 0:
        reason += f" (ended by signal {-done.returncode})"
    return reason


def ready_pyvista(*, screen: bool) -> Any:
    """PyVista, ready to render; raises `MissingExtra` where it would crash."""
    if find_spec("pyvista") is None:
        raise MissingExtra(
            "three-dimensional views need the package pyvista. Run pip install pyvista",
            code="pyvista-missing",
        )
    if screen:
        if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise MissingExtra("there is no screen here. Give --screenshot PNG", code="no-screen")
        fault = rendering_fault(None)
        if fault:
            raise MissingExtra(
                f"nothing can be drawn on this screen: {fault}. Run apt install libgl1",
                code="no-opengl",
            )
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
