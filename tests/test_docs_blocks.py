"""What the pages show is what happens: transcripts are current, and blocks of Python run."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys

import pytest
from conftest import ROOT
from docs_modules import load

import vfplan

transcripts = load(ROOT / "docs" / "make_transcripts.py")

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
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
import shutil
for side in ("image", "robot"):
    shutil.copy(f"samples/elbow_markers_{side}.csv", ".")
points = [[400.0, 300.0], [500.0, 350.0]]
shutil.copy("samples/elbow.png", "photograph.jpg")
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
"""What the blocks of a page take for granted, as the sentences before them say."""


def with_python(page):
    return PYTHON.search(page.read_text())


def with_transcripts(page):
    return transcripts.BLOCK.search(page.read_text())


@pytest.mark.slow
@pytest.mark.parametrize("page", filter(with_python, PAGES), ids=lambda page: page.stem)
def test_blocks_of_python_run(page, tmp_path):
    for name in ("samples", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    plan = subprocess.run(
        ["bash", "-c", transcripts.PLAN.replace("vfplan ", f"{sys.executable} -m vfplan ", 1)],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert plan.returncode == 0, plan.stderr
    code = "\n".join(PYTHON.findall(page.read_text()))
    run = subprocess.run(
        [sys.executable, "-c", BEFORE.get(page.stem, "") + code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr


@pytest.mark.slow
@pytest.mark.parametrize("page", filter(with_transcripts, PAGES), ids=lambda page: page.stem)
def test_transcripts_are_what_is_printed_now(page):
    text = page.read_text()
    assert transcripts.renewed(page.name, text) == text, f"run docs/make_transcripts.py {page}"


CPP = re.compile(r"^```cpp\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CPP_BEFORE = (
    "double x = 0, y = 0, z = 0; const vfplan::Vec3 tip{{x, y, z}}; double jacobian[21] = {};"
)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["README.md", "docs/controller.md"])
def test_blocks_of_cpp_compile(name, tmp_path):
    blocks = CPP.findall((ROOT / name).read_text())
    includes = []
    functions = []
    for number, block in enumerate(blocks):
        lines = block.splitlines()
        includes += [line for line in lines if line.startswith("#include")]
        body = [line for line in lines if not line.startswith("#include")]
        functions.append([f"void block_{number}() {{", CPP_BEFORE, *body, "}"])
    if len(functions) > 1:  # a later block goes on with the engine of an earlier one
        joined = [line for function in functions for line in function[2:-1]]
        joined = [re.sub(r"for \(;;\) \{.*", "{", line) for line in joined]
        functions = [["void blocks() {", CPP_BEFORE, *joined, "}"]]
    source = tmp_path / "blocks.cpp"
    code = [*includes, *(line for function in functions for line in function)]
    source.write_text("\n".join(code) + "\n")
    include = vfplan.cmake_dir().parents[2] / "include"
    compiler = shutil.which("g++")
    assert compiler, "g++ is needed"
    run = subprocess.run(
        [compiler, "-std=c++20", "-fsyntax-only", "-ffp-contract=off", f"-I{include}", source],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
