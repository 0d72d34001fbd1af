"""The Slicer script on a real MRML scene, as far as it goes without a window (`slicer-core`)."""

from __future__ import annotations

import runpy
from types import SimpleNamespace

import pytest
from conftest import ROOT

slicer = pytest.importorskip("slicer", reason="needs pip install slicer-core")


def test_everything_gets_its_look(monkeypatch):
    """What the extension SlicerOpenIGTLink makes of the devices is set up by hand here."""
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
