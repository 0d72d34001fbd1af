"""Whether PyVista can render here.

VTK ends the whole process where it finds no OpenGL library, so the ways to render are first tried
in a process of their own.
"""

from __future__ import annotations

import functools
import os
import subprocess
from importlib.util import find_spec
from typing import Any

from vfplan.errors import MissingExtra
from vfplan.io.sandbox import isolated_python

# What VTK may render into without a screen, and the Debian package each one needs.
WINDOWS = {"vtkOSOpenGLRenderWindow": "libosmesa6", "vtkEGLRenderWindow": "libegl1"}
_VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"
_PATIENCE_S = 60
_PROBE = (
    "import pyvista as pv; p = pv.Plotter(off_screen={off}, window_size=(32, 32)); "
    "p.add_mesh(pv.Sphere(), color='red'); "
    "p.show(auto_close=False, interactive=False, interactive_update=not {off}); "
    "image = p.screenshot(return_img=True); print('drawn', int(image.max()) > int(image.min())); "
    # VTK draws without a screen where it finds none; only then it has no window to attend to.
    "None if {off} else p.iren.process_events()"
)


@functools.cache
def offscreen_window() -> str | None:
    """The VTK window class that renders here without a screen; `None` where none does."""
    return next((name for name in WINDOWS if not _fault(name)), None)


@functools.cache
def _fault(window: str | None) -> str:
    """Why nothing can be drawn, in a line; empty where it can.

    With a window class of VTK: without a screen; with `None`: on the screen.
    """
    try:
        done = subprocess.run(
            isolated_python(_PROBE.format(off=window is not None)),
            capture_output=True,
            text=True,
            errors="replace",
            stdin=subprocess.DEVNULL,
            timeout=_PATIENCE_S,
            env={**os.environ, **({_VARIABLE: window} if window else {})},
            cwd="/",  # Matplotlib, which PyVista loads, would read settings of the current folder
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"a first picture was not there after {_PATIENCE_S} s"
    except OSError as error:
        return str(error)
    if done.returncode == 0 and "drawn True" in done.stdout:
        return ""
    said = [line for line in done.stderr.splitlines() if line.strip()] or ["nothing was drawn"]
    ended = f" (ended by signal {-done.returncode})" if done.returncode < 0 else ""
    return said[-1].strip()[:200] + ended


def ready_pyvista(*, screen: bool) -> Any:
    """PyVista, ready to render; raises `MissingExtra` where it would crash."""
    if find_spec("pyvista") is None:
        raise MissingExtra("three-dimensional views need the package pyvista: pip install pyvista")
    if screen:
        if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise MissingExtra("no screen here; --screenshot PNG and --movie GIF work without one")
        if fault := _fault(None):
            raise MissingExtra(
                f"nothing can be drawn on this screen: {fault}; Debian's package libgl1 has OpenGL"
            )
    else:
        window = offscreen_window()
        if window is None:
            packages, fault = " or ".join(WINDOWS.values()), _fault(list(WINDOWS)[-1]) or "?"
            raise MissingExtra(
                f"nothing can be drawn without a screen: {fault}; where an OpenGL library that "
                f"renders without a screen is missing, Debian's {packages} helps "
                f"(apt install {WINDOWS['vtkOSOpenGLRenderWindow']})"
            )
        os.environ[_VARIABLE] = window  # VTK reads it when it is first imported
    import pyvista

    return pyvista
