"""The package's face: public names, cheap imports, the folder for CMake."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from itertools import chain

import pytest
from conftest import ROOT, output

import vfplan

HEAVY = {"cv2", "skimage", "scipy", "matplotlib", "pyvista", "vtk", "vtkmodules", "h5py", "pydicom",
         "numpy"}  # fmt: skip


def test_public_names_are_listed_once_and_shown_by_dir():
    promised = "ProxyEngine read_fixture write_fixture extract_curve fit_registration plan replay"
    assert {*promised.split(), "VfplanError"} <= set(vfplan.__all__)
    assert len(set(vfplan.__all__)) == len(vfplan.__all__)
    assert dir(vfplan) == sorted(vfplan.__all__)
    assert all(getattr(vfplan, name) is not None for name in vfplan.__all__)


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = vfplan.no_such_name


def test_help_is_cheap(tmp_path):
    """Of every command but `burr`, a demonstration that stands in one file."""
    code = (
        "from click.testing import CliRunner; from vfplan.cli.main import COMMANDS, cli; "
        "calls = [['--help'], *([name, '--help'] for name in COMMANDS if name != 'burr')]; "
        "assert {CliRunner().invoke(cli, words).exit_code for words in calls} == {0}; "
        "import sys; print(*{m.split('.')[0] for m in sys.modules})"
    )
    loaded = set(output(sys.executable, "-c", code, cwd=tmp_path).split())
    assert not loaded & HEAVY


def test_cmake_folder_holds_the_package_file():
    assert (vfplan.cmake_dir() / "vfplan-config.cmake").is_file()


def test_the_source_tree_says_that_it_is_not_the_installed_package():
    """Where no package is installed; where one is, it is taken: see below."""
    code = "import sys; sys.path = [p for p in sys.path if 'site-packages' not in p]; import vfplan"
    words = [sys.executable, "-c", f"{code}; vfplan._core"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 1
    assert "that is the source tree" in done.stderr.splitlines()[-1]


def test_headers_are_installed_and_the_type_marker_too():
    package = vfplan.cmake_dir().parents[2]
    assert (package / "include" / "vfplan" / "version.hpp").is_file()
    assert (package / "py.typed").is_file()


@pytest.mark.parametrize("lock", ["ci", "franka"])
def test_the_lock_holds_what_every_extra_asks_for(lock):
    """Of each package a version that pyproject.toml allows, and nothing without a hash."""
    from packaging.requirements import Requirement

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    groups = project["dependency-groups"]
    wanted = groups.pop("franka")
    if lock == "ci":
        extras = project["project"]["optional-dependencies"].values()
        wanted = [*project["project"]["dependencies"], *chain(*extras), *chain(*groups.values())]
    entries = (ROOT / f"requirements-{lock}.txt").read_text().split("\n    # via")
    locked = re.findall(r"^([\w.-]+)==([^ ;\\]+)(.*(?:\n    --hash.*)*)", "\n".join(entries), re.M)
    assert all("--hash=sha256:" in rest for *_, rest in locked)
    for requirement in map(Requirement, wanted):
        if requirement.name == "vfplan":  # the extra `all` names the other extras
            continue
        found = [version for name, version, _ in locked if name == requirement.name.lower()]
        assert found, requirement
        assert any(requirement.specifier.contains(version) for version in found), requirement


@pytest.mark.parametrize(
    "words",
    [["-c", "import vfplan; vfplan.ProxyEngine([[0.0] * 3]); print(vfplan.cmake_dir())"],
     ["-m", "vfplan", "--cmake-dir"]],
)  # fmt: skip
def test_a_clones_root_does_not_shadow_the_installed_package(words):
    assert output(sys.executable, *words, cwd=ROOT) == f"{vfplan.cmake_dir()}\n"
