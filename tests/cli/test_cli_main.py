"""The bare command and the commands' names."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from conftest import ROOT
from vfplan.cli.main import cli

from vfplan.errors import CurveError


def test_without_a_command_the_help_is_shown(vfplan_cli):
    assert vfplan_cli().sound.stdout == vfplan_cli("--help").stdout


@pytest.mark.parametrize(
    "word, hint",
    [("registr", "Did you mean 'register'?"), ("xyzzy", "Choose one of plan, extract, register")],
)
def test_an_unknown_command_is_answered_with_what_there_is(vfplan_cli, word, hint):
    assert vfplan_cli(word).fails(2, f"no command '{word}'. {hint}").stdout == ""


def test_numbers_of_a_fault_are_plain_json(monkeypatch, tmp_path):
    """NumPy's numbers and infinities too."""
    numbers = {"rows": np.int64(3), "far_m": np.inf, "at_px": np.array([1.5, 2.0])}

    def refuse(*_given, **_options):
        raise CurveError("the line forks", code="line-forks", numbers=numbers)

    monkeypatch.setattr("vfplan.planning.extraction.extract", refuse)
    words = ["extract", str(ROOT / "samples" / "elbow.png"), "-o", str(tmp_path / "c.h5"), "--json"]
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 3
    error = json.loads(done.stdout)["error"]
    assert error["code"] == "line-forks"
    assert error["numbers"] == {"rows": 3, "far_m": None, "at_px": [1.5, 2.0]}
