"""What a release is made of: the list of parts, one version everywhere, a reproducible wheel."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib

import pytest
from conftest import ROOT, output
from docs_modules import load

import vfplan

sbom = load(ROOT / "release" / "make_sbom.py")


def test_one_version_is_written_everywhere():
    version = vfplan.__version__
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n## {version} - " in (ROOT / "CHANGELOG.md").read_text()
    header = (ROOT / "vfplan/native/include/vfplan/version.hpp").read_text()
    assert f'VFPLAN_VERSION "{version}"' in header
    for recipe in ("vcpkg/vcpkg.json", "conan/conanfile.py", "conda/recipe.yaml"):
        found = re.search(r'"?version"?( =|:) "([^"]*)"', (ROOT / "release" / recipe).read_text())
        assert found[2] == version, recipe


def test_a_build_can_import_the_core_where_there_is_no_numpy():
    """As its environment of a fresh clone, in which the stubs of the core are made."""
    code = (
        "import importlib.util, sys; sys.modules['numpy'] = None; name, path = sys.argv[1:]; "
        "spec = importlib.util.spec_from_file_location(name, path); "
        "spec.loader.exec_module(importlib.util.module_from_spec(spec))"
    )
    output(sys.executable, "-c", code, "_core", vfplan._core.__file__)


# Stand-ins for the functions of vcpkg that the port calls: each does what vcpkg's own says it does.
VCPKG = r"""
macro(run)
  execute_process(COMMAND ${CMAKE_COMMAND} ${ARGN} COMMAND_ERROR_IS_FATAL ANY)
endmacro()
macro(vcpkg_cmake_configure name source)
  run(-S "${source}" -B "${WORK}" "-DCMAKE_INSTALL_PREFIX=${CURRENT_PACKAGES_DIR}")
endmacro()
macro(vcpkg_cmake_install)
  run(--build "${WORK}" --target install)
endmacro()
macro(vcpkg_cmake_config_fixup name folder)
  set(share "${CURRENT_PACKAGES_DIR}/share")
  file(COPY "${CURRENT_PACKAGES_DIR}/${folder}/" DESTINATION "${share}/vfplan")
  file(REMOVE_RECURSE "${share}/cmake")
  file(GLOB files "${share}/vfplan/*.cmake")
  set(up "get_filename_component(_IMPORT_PREFIX \"\${_IMPORT_PREFIX}\" PATH)\n")
  foreach(file IN LISTS files)
    file(READ "${file}" text)
    string(REPLACE "LIST_DIR}/../../../" "LIST_DIR}/../../" text "${text}")
    string(REPLACE "${up}${up}${up}" "${up}${up}" text "${text}")
    file(WRITE "${file}" "${text}")
  endforeach()
endmacro()
macro(vcpkg_fixup_pkgconfig)
  file(READ "${CURRENT_PACKAGES_DIR}/lib/pkgconfig/vfplan.pc" text)
endmacro()
macro(vcpkg_install_copyright name)
  file(COPY ${ARGN} DESTINATION "${share}")
endmacro()
include("${CURRENT_PORT_DIR}/portfile.cmake")
"""


@pytest.mark.slow
def test_the_port_of_vcpkg_makes_a_package_that_cmake_finds(tmp_path):
    (tmp_path / "port.cmake").write_text(VCPKG)
    package = tmp_path / "package"
    words = f"-DCURRENT_PORT_DIR={ROOT}/release/vcpkg", f"-DCURRENT_PACKAGES_DIR={package}"
    output("cmake", *words, f"-DWORK={tmp_path}/work", "-P", tmp_path / "port.cmake")
    assert (package / "share" / "LICENSE").is_file()
    # CMake refuses a package whose library is not where the package says.
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.22)\nproject(user CXX)\nfind_package(vfplan REQUIRED)\n"
    )
    output("cmake", "-S", tmp_path, "-B", tmp_path / "user", f"-DCMAKE_PREFIX_PATH={package}")


def test_the_changelog_is_short():
    lines = (ROOT / "CHANGELOG.md").read_text().splitlines()
    assert len(lines) <= 80
    for line in lines:
        assert len(line.split()) <= 30, line


def test_the_list_of_parts_holds_what_an_install_needs(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    document = sbom.bill_of_materials("vfplan", set())
    assert document == sbom.bill_of_materials("vfplan", set())
    assert (document["bomFormat"], document["specVersion"]) == ("CycloneDX", "1.6")
    assert document["metadata"]["timestamp"] == "1970-01-01T00:00:00Z"
    assert document["metadata"]["component"]["version"] == vfplan.__version__
    parts = {part["name"]: part for part in document["components"]}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for requirement in project["dependencies"]:
        assert re.match(r"[\w-]+", requirement)[0] in parts
    with_live = sbom.bill_of_materials("vfplan", {"live"})["components"]
    assert "mcap" in {part["name"] for part in with_live} - parts.keys()
    assert "mujoco" not in parts
    assert "nanobind" in parts
    for part in parts.values():
        assert part["licenses"][0]["license"]["name"]
    references = {part["bom-ref"] for part in parts.values()}
    for entry in document["dependencies"]:
        assert set(entry["dependsOn"]) <= references


@pytest.mark.full
def test_the_same_commit_gives_the_same_wheel(tmp_path):
    wheels = []
    for name in ("one", "another-folder"):
        source = tmp_path / name
        ignored = shutil.ignore_patterns(".git", ".venv*", "build", "dist", "__pycache__", "tests")
        shutil.copytree(ROOT, source, ignore=ignored)
        command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-build-isolation", "--no-deps"]
        env = {**os.environ, "SOURCE_DATE_EPOCH": "1700000000"}
        subprocess.run([*command, "-w", "out", "."], cwd=source, env=env, check=True)
        (wheel,) = (source / "out").glob("*.whl")
        wheels.append(wheel.read_bytes())
    assert wheels[0] == wheels[1]
