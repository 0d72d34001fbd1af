"""The C++ reader: same values and same verdicts as Python's, on libhdf5 from apt."""

import importlib.util
import json
import os
import subprocess

import bundles
import pytest
from conftest import ROOT, need_header, need_program

import vfplan


@pytest.fixture(scope="session")
def bundle_info(tmp_path_factory):
    """The sample program samples/bundle_info, built against the installed package."""
    need_header("hdf5.h", "libhdf5-dev", "/usr/include/hdf5/serial")
    need_header("openssl/evp.h", "libssl-dev")
    need_program("g++", "g++")
    build = tmp_path_factory.mktemp("bundle_info")
    source = ROOT / "samples" / "bundle_info"
    for command in (
        ["cmake", "-S", source, "-B", build, f"-Dvfplan_DIR={vfplan.cmake_dir()}"],
        ["cmake", "--build", build],
    ):
        done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    return build / "bundle_info"


@pytest.mark.parametrize("make", [bundles.minimal, bundles.full], ids=["minimal", "everything"])
def test_json_equals_that_of_vfplan_info(make, bundle_info, vfplan_cli, tmp_path):
    path = tmp_path / "a.h5"
    vfplan.write_fixture(make(), path)
    for options in ([], ["--values"]):
        theirs = vfplan_cli("info", path, "--json", *options).json
        theirs.pop("elapsed_s")
        ours = subprocess.run([bundle_info, path, *options], capture_output=True, check=True)
        assert json.loads(ours.stdout) == theirs


def test_constants_are_those_of_the_schema():
    spec = importlib.util.spec_from_file_location("make_format", ROOT / "docs" / "make_format.py")
    make_format = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_format)
    assert make_format.HEADER.read_text() == make_format.header(), "run `make docs`"


def test_a_program_that_asks_for_no_hdf5_needs_none(tmp_path):
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.24)\nproject(plain LANGUAGES CXX)\n"
        "find_package(vfplan REQUIRED)\n"
        "if(TARGET vfplan::hdf5 OR HDF5_FOUND)\n  message(FATAL_ERROR found)\nendif()\n"
    )
    command = ["cmake", "-S", tmp_path, "-B", tmp_path / "b", f"-Dvfplan_DIR={vfplan.cmake_dir()}"]
    done = subprocess.run([*map(str, command)], capture_output=True, check=False, env=os.environ)
    assert done.returncode == 0, done.stderr
