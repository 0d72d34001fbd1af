"""The Slicer scripts: a plan by its files, the view on a real MRML scene (`slicer-core`)."""

from __future__ import annotations

import runpy
from types import SimpleNamespace

import numpy as np
import pytest
import vector_files
from click.testing import CliRunner
from conftest import ROOT
from vfplan.cli.main import cli

import vfplan


def test_a_drawn_curve_and_two_lists_become_a_plan(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "samples" / "slicer"))
    from plan_words import plan_words

    rng = np.random.default_rng(1)
    marks = np.array([[-30, 20, 12], [40, 15, 16], [0, 70, 13], [20, 30, 10], [-35, 60, 17.0]])
    shift = np.array([500, 200, 100.0])
    touched = marks + shift + rng.normal(0, 0.01, marks.shape)
    files = [vector_files.slicer(tmp_path, vector_files.RING_MM, "ClosedCurve")]
    for name, places, axes in (("m", marks, "LPS"), ("r", touched * [-1, -1, 1], "RAS")):
        words = tmp_path, places, "Fiducial", f"{name}.mrk.json"
        files.append(vector_files.slicer(*words, coordinateSystem=axes))
    words, bundle = plan_words(*files, tmp_path)
    run = CliRunner().invoke(cli, words[1:])
    assert run.exit_code == 0, run.output
    ring = 1e3 * vfplan.read_fixture(bundle).points - shift
    assert np.abs(np.hypot(ring[:, 0], ring[:, 1]) - 10).max() < 0.05
    with pytest.raises(ValueError, match="no single fiducial list"):
        plan_words(*files[:2], files[0], tmp_path)


def test_everything_gets_its_look(monkeypatch):
    """What the extension SlicerOpenIGTLink makes of the devices is set up by hand here."""
    slicer = pytest.importorskip("slicer", reason="needs pip install slicer-core")
    scene, seen = slicer.vtkMRMLScene(), []
    view = SimpleNamespace(resetFocalPoint=lambda: seen.append("focus"))
    views = SimpleNamespace(threeDWidget=lambda k: SimpleNamespace(threeDView=lambda: view))
    monkeypatch.setattr(slicer, "mrmlScene", scene, raising=False)
    monkeypatch.setattr(slicer, "app", SimpleNamespace(layoutManager=lambda: views), raising=False)
    script = runpy.run_path(str(ROOT / "samples" / "slicer" / "vfplan_live.py"))
    assert not script["set_up_scene"]()
    cloud, contact = (scene.AddNewNodeByClass("vtkMRMLModelNode", f"vfplan_{name}")
                      for name in ("cloud", "contact"))  # fmt: skip
    assert not script["set_up_scene"](), "the proxy has not come yet"
    proxy = scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", "vfplan_proxy")
    assert script["set_up_scene"]()
    assert seen == ["focus"]
    assert contact.GetTransformNodeID() == proxy.GetID()
    assert cloud.GetTransformNodeID() is None
    for node, name in ((cloud, "CLOUD"), (contact, "CONTACT")):
        display = node.GetDisplayNode()
        assert display.GetColor() == pytest.approx(script[f"{name}_COLOUR"])
        assert display.GetOpacity() == script[f"{name}_OPACITY"]
