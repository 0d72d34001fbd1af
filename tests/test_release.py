"""What a release is made of: the list of parts, one version everywhere, a reproducible wheel."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib

import pytest
from conftest import ROOT
from docs_modules import load

import vfplan

sbom = load(ROOT / "release" / "make_sbom.py")


def test_one_version_is_written_everywhere():
    version = vfplan.__version__
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n## {version} - " in (ROOT / "CHANGELOG.md").read_text()
    header = (ROOT / "vfplan/native/include/vfplan/version.hpp").read_text()
    assert f'VFPLAN_VERSION "{version}"' in header


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
    assert "mujoco" not in parts
    assert "nanobind" in parts
    for part in parts.values():
        assert part["licenses"][0]["license"]["name"]
    references = {part["bom-ref"] for part in parts.values()}
    for entry in document["dependencies"]:
        assert set(entry["dependsOn"]) <= references


def test_an_extra_adds_its_parts():
    parts = {part["name"] for part in sbom.bill_of_materials("vfplan", {"live"})["components"]}
    assert "mcap" in parts


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
