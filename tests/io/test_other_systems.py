"""The main commands where Linux's own modules and functions are absent, as in Windows and macOS."""

from __future__ import annotations

import sys

import pytest
from conftest import ELBOW, ROOT, output

# Hides what Windows does not have from vfplan; the standard library took what it needs before.
WITHOUT = """
import os, signal, subprocess, sys, tempfile, multiprocessing.util
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name in ("fcntl", "resource"):
            raise ImportError(f"no module named {name}")
sys.meta_path.insert(0, Hidden())
for name in ("fcntl", "resource"):
    sys.modules.pop(name, None)
for name in ("memfd_create", "fork", "preadv", "geteuid", "O_DIRECTORY", "O_NOFOLLOW", "O_CLOEXEC",
             "O_NONBLOCK"):
    delattr(os, name)
del signal.SIGHUP, signal.pthread_kill
if __name__ == "__main__":
    from vfplan.cli.main import cli
    cli()
"""


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("elsewhere")
    (folder / "run.py").write_text(WITHOUT)
    bundle = folder / "f.h5"
    run(folder, "plan", *ELBOW, "--pixel-spacing", 0.5, "-o", bundle)
    return folder, bundle


def run(folder, *words, **more):
    return output(sys.executable, "-P", folder / "run.py", *words, cwd=folder, **more)


CALLS = {
    "review": ("review", "f.h5", "--slice", ELBOW[0], "--sheet-out", "s.png"),
    "replay": ("replay", "f.h5", ROOT / "samples" / "elbow_session.csv", "-o", "r.h5"),
    "info": ("info", "f.h5"),
    "validate": ("validate", "f.h5"),
    "stability": ("stability", "f.h5", "--robot", "franka", "--part", "closed-loop"),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_command_runs_without_the_modules_of_linux(name, planned):
    assert run(planned[0], *CALLS[name])
