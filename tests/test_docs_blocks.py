"""What the pages show is what happens: transcripts are current, and blocks of Python run."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest
from conftest import ROOT, output
from docs_modules import load

import vfplan

transcripts = load(ROOT / "docs" / "make_transcripts.py")

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# What the blocks of a page take for granted, as the sentences before them say.
BEFORE = {
    "review": """
import cv2
picture = cv2.imread("samples/elbow.png")
for start, end in (((420, 60), (840, 60)), ((840, 60), (840, 420))):
    cv2.line(picture, start, end, (32, 25, 232), 3, cv2.LINE_AA)
cv2.imwrite("slice.png", picture)
rows = []
for side in ("image", "robot"):
    with open(f"samples/elbow_markers_{side}.csv") as file:
        rows.append([line.strip().split(",") for line in file if line.strip()])
with open("markers.csv", "w") as file:
    for image, robot in zip(*rows, strict=True):
        file.write(",".join([*image, *robot[1:]]) + "\\n")
""",
    "registration": """
points = [[400.0, 300.0], [500.0, 350.0]]
""",
    "replay": """
import os
os.makedirs("demo")
os.replace("fixture.h5", "demo/fixture.h5")
""",
    "guidance": """
import numpy as np
import vfplan
points = np.column_stack([np.linspace(0, 0.1, 200), np.zeros(200), np.zeros(200)])
hip = points[50]
""",
    "moving": """
import numpy as np
import vfplan
points = np.column_stack([np.linspace(0, 0.1, 2000), np.zeros(2000), np.zeros(2000)])
engine = e = vfplan.ProxyEngine(points)
other = vfplan.ProxyEngine(points + [0.0, 0.01, 0.0])
new_points = points[:3] + [0.0, 0.02, 0.0]
stamp, t, hip, base_from_fixture = 0.0, 0.001, np.array([0.05, 0.02, 0.0]), np.eye(4)
engine.reset(hip)
""",
}


def link_sources(folder):
    for name in ("samples", "tests"):
        (folder / name).symlink_to(ROOT / name)


def run_shell(script, folder):
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return output(
        "bash", "-e", "-c", script, cwd=folder, timeout=900, env={**os.environ, "PATH": path}
    )


def with_python(page):
    return PYTHON.search(page.read_text())


def with_transcripts(page):
    return transcripts.BLOCK.search(page.read_text())


@pytest.mark.slow
@pytest.mark.parametrize("page", list(filter(with_python, PAGES)), ids=lambda page: page.stem)
def test_blocks_of_python_run(page, tmp_path):
    link_sources(tmp_path)
    run_shell(transcripts.PLAN, tmp_path)
    code = "\n".join(PYTHON.findall(page.read_text()))
    printed = output(sys.executable, "-c", BEFORE.get(page.stem, "") + code, cwd=tmp_path)
    if page.stem == "README":  # its block stands above what it prints
        block = r"^```python\n[^`]*```\n\n((?: {4}.*\n)+)"
        shown = re.search(block, page.read_text(), re.MULTILINE)
        assert printed.split() == shown[1].split()


@pytest.mark.slow
@pytest.mark.parametrize("page", list(filter(with_transcripts, PAGES)), ids=lambda page: page.stem)
def test_transcripts_are_what_is_printed_now(page):
    text = page.read_text()
    assert transcripts.renewed(page.name, text) == text, f"run docs/make_transcripts.py {page}"


CPP = re.compile(r"^```cpp\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CMAKE = re.compile(r"^```cmake\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SHELL = re.compile(r"^```\n(cmake .*?)^```$", re.MULTILINE | re.DOTALL)
INCLUDE = vfplan.cmake_dir().parents[2] / "include"
# Makes the files that the blocks of C++ read.
SIGNED = """
vfplan keygen -o planner.key -q
vfplan review fixture.h5 --slice samples/elbow.png --sheet-out sheet.png --json > review.json
digest=$(python -c "import json; print(json.load(open('review.json'))['digest'])")
vfplan accept fixture.h5 --digest $digest --by "A. Planner" --answer-all -o accepted.h5 -q
vfplan sign accepted.h5 --key planner.key --case 2026-117 --robot-serial R-0042 -o approved.h5 -q
cp approved.h5 elbow.h5
cp approved.h5 signed.h5
cp planner.pub keys.pub
cp tests/data/bundles/2.0-mesh.h5 mesh.h5
"""
CPP_BEFORE = """
double x = 0, y = 0, z = 0;
const vfplan::Vec3 tip{{x, y, z}};
double jacobian[21] = {};
"""
CPP_OF_ENGINE = """
#include "vfplan/cloud/band.hpp"
std::vector<double> cloud = {0.1, 0, 0, 0.1, 0.001, 0, 0.1, 0, 0.001};
const double* points = cloud.data();
std::size_t n = 3, k = 1;
std::int32_t triangles[] = {0, 1, 2};
vfplan::Stroke stroke{cloud, {0, 0, 0}, false};
vfplan::Parameters p;
auto fixture = vfplan::bundle::read_fixture("mesh.h5");
"""
# Lines and arcs are rendered across an axis, a mesh is not.
CPP_OF_STROKE = "vfplan::Parameters p; p.ignore_axis = vfplan::Vec3{{0, 0, 1}};"
CPP_OF_GOVERNOR = 'vfplan::Engine engine(vfplan::bundle::read_fixture("signed.h5"));'
CPP_OF_LIVE = "const double t = 0; const vfplan::Step step{};"
# A page with blocks of C++: the header and the names that its sentences take for granted.
CPP_PAGES = {
    "README.md": ("bundle/engine.hpp", CPP_BEFORE),
    "docs/controller.md": ("bundle/engine.hpp", CPP_BEFORE + CPP_OF_GOVERNOR),
    "docs/engine.md": ("bundle/engine.hpp", CPP_BEFORE + CPP_OF_ENGINE),
    "docs/live.md": ("engine.hpp", CPP_BEFORE + CPP_OF_LIVE),
}


def make_files(folder):
    link_sources(folder)
    run_shell(transcripts.PLAN + SIGNED, folder)


def test_every_block_of_cpp_stands_on_a_page_that_is_tried():
    with_cpp = {str(page.relative_to(ROOT)) for page in PAGES if CPP.search(page.read_text())}
    assert with_cpp == set(CPP_PAGES)


@pytest.mark.slow
@pytest.mark.parametrize("name", CPP_PAGES)
def test_blocks_of_cpp_run(name, tmp_path):
    make_files(tmp_path)
    header, before = CPP_PAGES[name]
    includes = [f'#include "vfplan/{header}"']
    code = []
    for block in CPP.findall((ROOT / name).read_text()):
        lines = block.splitlines()
        includes += [line for line in lines if line.startswith("#include")]
        body = [line for line in lines if not line.startswith("#include")]
        if name == "docs/controller.md":  # its second block goes on with the engine of the first
            code += [re.sub(r"for \(;;\) \{.*", "{", line) for line in body]
        else:
            code += ["{", *[CPP_OF_STROKE] * ("{stroke}" in block), *body, "}"]
    source = tmp_path / "blocks.cpp"
    source.write_text("\n".join([*includes, before, "int main() {", *code, "}"]) + "\n")
    flags = f"-std=c++20 -O0 -ffp-contract=off -DVFPLAN_SIGNED -I{INCLUDE}"
    run_shell(f"g++ {flags} blocks.cpp -o blocks -lcrypto && ./blocks", tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["docs/controller.md"])
def test_blocks_of_cmake_configure_and_build(name, tmp_path):
    (tmp_path / "main.cpp").write_text('#include "vfplan/version.hpp"\nint main() {}\n')
    blocks = CMAKE.findall((ROOT / name).read_text())
    assert blocks
    for number, block in enumerate(blocks):
        (tmp_path / "CMakeLists.txt").write_text(block)
        script = f"cmake -S . -B {number} -Dvfplan_DIR=$(vfplan --cmake-dir)"
        run_shell(f"{script} && cmake --build {number}", tmp_path)


@pytest.mark.slow
def test_the_shell_block_of_the_tutorial_builds_the_samples(tmp_path):
    make_files(tmp_path)
    (block,) = SHELL.findall((ROOT / "docs" / "tutorial.md").read_text())
    in_cpp = run_shell(block, tmp_path).splitlines()[-1]
    in_python = run_shell("python samples/02_render.py signed.h5", tmp_path).splitlines()[-1]
    assert in_cpp == in_python
