"""Data flows one way: a lower module never imports an upper one, and only cli imports click."""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter

import pytest
from conftest import ROOT

# Lowest first. A module belongs to the longest name that fits it; modules of one row may not import
# each other.
LAYERS = [
    ["errors", "display"],
    ["io", "geometry", "palette", "findings", "settings"],
    ["robot"],
    ["fixture"],
    ["engine"],
    ["images", "session"],
    ["markers"],
    ["registration", "bundle", "reference", "scenes"],
    ["curve", "vectors", "conformance", "controller"],
    ["planning", "replaying"],
    ["stability"],
    ["figures", "view3d"],
    ["review"],
    ["bench", "report"],
    ["samples"],
    ["cli"],
    ["arm", "burr", "camera", "campaign", "live", "surface"],
]
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}
# h5py comes through vfplan.io.hdf5 alone, which switches plugins off before it is imported.
LEAF_ROOMS = set(LAYERS[-1])
# The command line reaches into a leaf room where an option asks for it, within a function.
REACHES = {
    ("cli.options", "campaign"),  # --margin p=P
    ("camera.command", "live"),  # --live
    ("cli.plan", "arm"),  # --rehearse
    ("cli.review", "camera"),  # --print-out
    ("cli.bench", "arm"),  # demo panda
    ("samples.panda", "arm"),
}
ONLY = {"click": {"cli"} | LEAF_ROOMS, "h5py": {"io"}, "nanobind": set()}
GUARDED = {"bundle", "session"}  # who may open HDF5 files


def layer(module, names=RANK):
    """The longest of some names that `module`, dotted and without `vfplan.`, begins with."""
    parts = module.split(".")
    beginnings = (".".join(parts[:n]) for n in range(len(parts), 0, -1))
    return next((name for name in beginnings if name in names), None)


def sources():
    """(module, path, tree) of every file of Python that is installed."""
    for folder, prefix in (("vfplan", ()), ("cli", ("cli",)), ("samples", ("samples",))):
        for path in sorted((ROOT / folder).rglob("*.py")):
            inner = path.relative_to(ROOT / folder).with_suffix("").parts
            if "native" not in inner:
                module = ".".join((*prefix, *inner)).removesuffix(".__init__")
                yield module, path, ast.parse(path.read_text())


def imported(nodes):
    """The dotted names that the imports among some nodes name."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def ours(nodes):
    """The same of our own modules, without `vfplan.`."""
    return {n.removeprefix("vfplan.") for n in imported(nodes) if n.startswith("vfplan.")}


MODULES = [source for source in sources() if source[0] not in ("__init__", "__main__")]


@pytest.mark.parametrize("module, path, tree", MODULES, ids=[row[0] for row in MODULES])
def test_module_keeps_to_its_layer(module, path, tree):
    owner = layer(module)
    assert owner, f"{path}: name its layer in LAYERS"
    room = owner.split(".")[0]
    for name in imported(ast.walk(tree)):
        top, _, rest = name.partition(".")
        if top in ONLY:
            assert room in ONLY[top], f"{path} imports {name}"
        if name.startswith("vfplan.io.hdf5"):
            assert room in GUARDED, f"{path} imports {name}"
        used = layer(rest) if top == "vfplan" else None
        if used and used != owner and (module, used) not in REACHES:
            assert RANK[used] < RANK[owner], f"{path} ({owner}) imports {name}"


def test_nobody_imports_a_leaf_room():
    """But for the command line, where an option or a command's name asks for one."""
    for module, path, tree in sources():
        at_once, ever = (set(map(layer, ours(nodes))) for nodes in (tree.body, ast.walk(tree)))
        own = {layer(module)}
        assert not (at_once & LEAF_ROOMS) - own, path
        reached = {(module, room) for room in (ever & LEAF_ROOMS) - own}
        assert reached <= REACHES, path


def test_the_click_commands_of_leaf_rooms_are_in_one_file():
    for module, path, tree in sources():
        tops = {name.split(".")[0] for name in imported(ast.walk(tree))}
        if layer(module) in LEAF_ROOMS and "click" in tops:
            assert path.name == "command.py"


def test_no_circle_of_imports():
    """Inside packages and functions too: such modules cannot be understood one at a time."""
    graph = {module: ours(ast.walk(tree)) for module, _, tree in sources()}
    graph = {m: {layer(name, graph) for name in uses} - {m, None} for m, uses in graph.items()}
    TopologicalSorter(graph).prepare()  # Its error names a circle.
