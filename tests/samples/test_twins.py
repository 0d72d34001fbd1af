"""The numbered beginnings: each says the same in C++ and in Python."""

import subprocess
import sys

import bundles
import pytest
from conftest import ROOT, output, quick_compiler

import vfplan

pytestmark = pytest.mark.slow

SAMPLES = ROOT / "samples"
TWINS = sorted(path.stem for path in SAMPLES.glob("[0-9]*.cpp"))


def build(source, program):
    include = vfplan.cmake_dir().parents[2] / "include"
    flags = ["-std=c++20", "-O0", "-ffp-contract=off", "-DVFPLAN_NARROW", "-Wall", "-Wextra"]
    output(quick_compiler(), *flags, f"-I{include}", source, "-o", program)


def refuse(code, *command):
    """The one line with which a program ends with this code."""
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stderr
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    return line


@pytest.mark.parametrize("name", TWINS)
def test_both_print_the_same(name, tmp_path):
    build(SAMPLES / f"{name}.cpp", tmp_path / name)
    words = []
    if "argv" in (SAMPLES / f"{name}.py").read_text():
        words = [tmp_path / "fixture.h5"]
        vfplan.write_fixture(bundles.small(), words[0])
    told = output(tmp_path / name, *words)
    assert told.count("N") >= 1
    assert told == output(sys.executable, "-P", SAMPLES / f"{name}.py", *words)
    if not words:
        return
    broken, bare = tmp_path / "broken.h5", tmp_path / "bare.h5"
    broken.write_bytes(words[0].read_bytes()[:-5])
    vfplan.write_fixture(bundles.minimal(), bare)
    for program in ([tmp_path / name], [sys.executable, "-P", SAMPLES / f"{name}.py"]):
        refuse(2, *program)
        assert "none.h5" in refuse(3, *program, tmp_path / "none.h5")
        assert "broken.h5" in refuse(4, *program, broken)
        assert "rendering" in refuse(3, *program, bare)


@pytest.mark.parametrize("name, was, becomes", [
    ("01_press.cpp", "{{800, 800, 800}}", "{{800, -800, 800}}"),
    ("01_press.py", "stiffness=800", "stiffness=-800"),
    ("03_govern.cpp", "force_step = 0.5", "force_step = 0.05"),
    ("03_govern.py", "force_step_n=0.5", "force_step_n=0.05"),
])  # fmt: skip
def test_a_setting_out_of_range_is_told_in_a_line(name, was, becomes, tmp_path):
    text = (SAMPLES / name).read_text()
    assert text.count(was) == 1
    (tmp_path / name).write_text(text.replace(was, becomes))
    program = [sys.executable, "-P", tmp_path / name]
    if name.endswith(".cpp"):
        program = [tmp_path / "program"]
        build(tmp_path / name, *program)
    assert ("stiffness" if "press" in name else "force_step") in refuse(2, *program)


def test_cmake_builds_each_of_them():
    told = (SAMPLES / "CMakeLists.txt").read_text()
    assert TWINS
    assert set(TWINS) == {path.stem for path in SAMPLES.glob("[0-9]*.py")}
    assert all(name in told for name in TWINS)
