"""The numbered beginnings: each says the same in C++ and in Python."""

import subprocess
import sys

import bundles
import pytest
from conftest import ROOT, quick_compiler

import vfplan

pytestmark = pytest.mark.slow

SAMPLES = ROOT / "samples"
TWINS = sorted(path.stem for path in SAMPLES.glob("[0-9]*.cpp"))


def output(*command):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", TWINS)
def test_both_print_the_same(name, tmp_path):
    include = vfplan.cmake_dir().parents[2] / "include"
    flags = ["-std=c++20", "-O0", "-ffp-contract=off", "-DVFPLAN_NARROW", "-Wall", "-Wextra"]
    output(quick_compiler(), *flags, f"-I{include}", SAMPLES / f"{name}.cpp", "-o", tmp_path / name)
    words = []
    if "argv" in (SAMPLES / f"{name}.py").read_text():
        words = [tmp_path / "fixture.h5"]
        vfplan.write_fixture(bundles.small(), words[0])
    told = output(tmp_path / name, *words)
    assert told.count("N") >= 1
    assert told == output(sys.executable, "-P", SAMPLES / f"{name}.py", *words)


def test_cmake_builds_each_of_them():
    told = (SAMPLES / "CMakeLists.txt").read_text()
    assert TWINS
    assert set(TWINS) == {path.stem for path in SAMPLES.glob("[0-9]*.py")}
    assert all(name in told for name in TWINS)
