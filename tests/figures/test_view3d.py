"""Three-dimensional views: pictures without a screen, and a clear word where none can be drawn."""

from __future__ import annotations

from dataclasses import replace

import bundles
import numpy as np
import pytest
from conftest import ELBOW, missing_package
from PIL import Image
from replays import fixture_of, line, probing

import vfplan
from vfplan import view3d
from vfplan.errors import MissingExtra
from vfplan.figures.replay import tube_outline
from vfplan.fixture import Guidance
from vfplan.palette import CLOUD, PROXY
from vfplan.replaying.replay import replay
from vfplan.report.page import scene_data


def need_gl():
    if view3d.offscreen_window() is None:
        missing_package("libosmesa6", "OpenGL without a screen")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    vfplan.write_fixture(fixture_of(line()), folder / "f.h5")
    vfplan.write_result(replay(fixture_of(line()), probing(1.0)), folder / "r.h5")
    return folder / "f.h5", folder / "r.h5"


def rgb(colour):
    return tuple(bytes.fromhex(colour[1:]))


def share(picture, rgb):
    """The share of pixels close to a colour."""
    pixels = np.asarray(Image.open(picture).convert("RGB"), int)
    return (np.abs(pixels - rgb).max(axis=2) < 60).mean()


def test_screenshot_without_a_screen(vfplan_cli, files, tmp_path):
    need_gl()
    png = tmp_path / "v.png"
    run = vfplan_cli("view", *files, "--screenshot", png, "--json", env={"DISPLAY": ""}).sound
    assert (run.stderr, run.json["files"], Image.open(png).size) == ("", [str(png)], (1200, 900))
    assert 0.3 < share(png, (255, 255, 255)) < 0.99
    assert share(png, rgb(CLOUD)) > 1e-4  # the cloud
    assert share(png, rgb(PROXY)) > 1e-4  # the proxy and its path


@pytest.mark.parametrize("ends, beyond", [("stop", 1e-3), ("open", 0.0)])
def test_half_spheres_close_a_guide_whose_ends_stop_and_no_other(ends, beyond):
    guide = replace(fixture_of(line()), guidance=Guidance(1e-3, 1000.0, ends=ends))
    parts = view3d.tubes(guide.guiding_lines, 1e-3, ends == "stop")
    outline = tube_outline(line()[:, :2], 1e-3, ends == "stop")
    for points in (np.vstack([part.points for part in parts]), outline):
        assert np.ptp(points[:, 0]) == pytest.approx(np.ptp(line()[:, 0]) + 2 * beyond, abs=1e-6)
    assert scene_data(guide)["tube"]["cap"] == {"stop": "round", "open": "butt"}[ends]


def test_a_curve_that_nobody_renders_is_shown_too(tmp_path):
    need_gl()
    view3d.draw_view(bundles.pixels(), tmp_path / "v.png")
    assert share(tmp_path / "v.png", rgb(CLOUD)) > 1e-4


def test_the_slice_lies_where_its_pixels_were_registered(tmp_path, vfplan_cli):
    """With the slice the ground is grey, and without it all but its border is white."""
    need_gl()
    bundle = bundles.stored(tmp_path / "f.h5", vfplan.plan(*ELBOW).fixture)
    for name, more in (("border", ()), ("slice", ("--slice", ELBOW[0]))):
        picture = tmp_path / f"{name}.png"
        assert vfplan_cli("view", bundle, "--screenshot", picture, *more, env={"DISPLAY": ""}).sound
    assert share(tmp_path / "border.png", (255, 255, 255)) > 0.8
    assert share(tmp_path / "slice.png", (255, 255, 255)) < 0.5
    other = tmp_path / "other.png"
    Image.new("RGB", (400, 300)).save(other)
    vfplan_cli("view", bundle, "--screenshot", tmp_path / "no.png", "--slice", other).fails(3)
    assert not (tmp_path / "no.png").exists()


def test_no_gl_is_said_and_nothing_crashes(monkeypatch, tmp_path):
    monkeypatch.setattr(view3d, "offscreen_window", lambda: None)
    with pytest.raises(MissingExtra, match="apt install libosmesa6"):
        view3d.draw_view(fixture_of(line()), tmp_path / "v.png")
    assert not (tmp_path / "v.png").exists()


def test_a_probe_that_crashes_is_a_no(monkeypatch):
    monkeypatch.setattr(view3d, "PROBE", "import os; os.kill(os.getpid(), 11)")
    view3d.rendering_fault.cache_clear()
    try:
        assert "SIGSEGV" in view3d.rendering_fault(None)
    finally:
        view3d.rendering_fault.cache_clear()


def test_no_screen_is_said(vfplan_cli, files):
    env = {"DISPLAY": "", "WAYLAND_DISPLAY": ""}
    vfplan_cli("view", *files, env=env).fails(2, "--screenshot PNG")


def test_a_result_of_another_fixture_is_refused(vfplan_cli, files, tmp_path):
    other, result, png = tmp_path / "o.h5", tmp_path / "r.h5", tmp_path / "v.png"
    vfplan.write_fixture(fixture_of(line(length=0.05)), other)
    vfplan.write_result(replay(files[0], probing(1.0)), result)
    said = "was replayed against the fixture with SHA-256"
    vfplan_cli("view", other, result, "--screenshot", png).fails(3, said)
    assert not png.exists()
