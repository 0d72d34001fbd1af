"""Data flows one way: a lower module never imports an upper one, and only cli imports click."""

from __future__ import annotations

import ast

import pytest
from conftest import ROOT

# Lowest first. Modules of one row may not import each other unless named in WITHIN.
LAYERS = [
    ["errors"],
    ["checks", "choosing", "disk", "hdf5", "spacing"],
    ["rendering"],
    ["dicom"],
    ["image", "fixture", "markers", "session", "robot"],
    ["renderable"],
    ["extraction", "registration", "marker_finding", "bundle", "proxy", "reference", "scenes"],
    ["centreline", "vector"],
    ["sampling"],
    ["pipeline", "replay"],
    ["accuracy", "stability"],
    ["figures", "view3d"],
    ["report"],
    ["samples"],
    ["cli"],
]
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}
# h5py comes through vfplan.hdf5 alone, which switches plugins off before it is imported.
ONLY = {"click": {"cli"}, "h5py": {"hdf5"}, "nanobind": set()}
GUARDED = {"bundle", "session"}  # who may open HDF5 files


def sources():
    for folder, prefix in (("vfplan", ""), ("cli", "cli"), ("samples", "samples")):
        for path in sorted((ROOT / folder).rglob("*.py")):
            if "native" in path.parts:
                continue
            inner = path.relative_to(ROOT / folder).with_suffix("").parts
            yield path, (prefix or inner[0])


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            if node.module == "vfplan":
                yield from (f"vfplan.{alias.name}" for alias in node.names)


@pytest.mark.parametrize(("path", "owner"), list(sources()), ids=lambda v: getattr(v, "name", v))
def test_module_keeps_to_its_layer(path, owner):
    if owner in {"__init__", "__main__"}:
        return
    assert owner in RANK, f"{path}: name its layer in LAYERS"
    for name in imports(path):
        top, *rest = name.split(".")
        if top in ONLY:
            assert owner in ONLY[top], f"{path} imports {name}"
        if name.startswith("vfplan.hdf5"):
            assert owner in GUARDED, f"{path} imports {name}"
        if top == "vfplan" and rest and rest[0] in RANK and rest[0] != owner:
            assert RANK[rest[0]] < RANK[owner], f"{path} ({owner}) imports {name}"
