"""The help of a command: a first screen, and everything behind --help-all; options from a file."""

from __future__ import annotations

import json

import click
import pytest
from conftest import ELBOW, file_with
from vfplan.cli.main import COMMANDS, GROUPS, cli

PAGED = ("plan", "register", "extract", "replay", "stability", "bench", "campaign", "rehearse")


def options_in(text):
    """The long options that a help lists, in its first column."""
    columns = [line.strip().split("  ")[0] for line in text.splitlines() if line[:3] == "  -"]
    words = [word.rstrip(",") for column in columns for word in column.split()]
    return first_names({word for word in words if word.startswith("--")})


def options_of(name):
    command = cli.get_command(click.Context(cli), name)
    words = [word for p in command.params for word in p.opts if word.startswith("--")]
    return first_names({*words, "--help"})


def first_names(words):
    """Without the old name of --page, which `plan` and `extract` still take."""
    return words - {"--frame"} if "--page" in words else words


def test_the_help_has_four_groups_with_every_command_in_one(vfplan_cli):
    text = vfplan_cli("--help").stdout
    headings = [line for line in text.splitlines() if line.endswith(":") and line[0] != " "]
    assert headings == ["Options:", "Plan:", "Check:", "Robot:", "More:"]
    assert sum(len(group) for group in GROUPS.values()) == len(COMMANDS)


@pytest.mark.parametrize("name", PAGED)
def test_the_first_screen_is_short_and_says_where_the_rest_is(vfplan_cli, name):
    first = vfplan_cli(name, "--help").stdout
    whole = vfplan_cli(name, "--help-all").stdout
    assert len(options_in(first) - {"--help", "--help-all"}) <= 18
    assert options_in(first) < options_in(whole) == options_of(name)
    count = len(options_of(name)) - len(options_in(first))
    assert f"{count} more options: vfplan {name} --help-all" in first
    assert "more options" not in whole


def test_the_gates_of_wrong_markers_are_on_the_first_screen(vfplan_cli):
    for name in ("plan", "register"):
        first = options_in(vfplan_cli(name, "--help").stdout)
        assert {"--markers-as-given", "--common", "--seen-from", "--max-residual"} <= first


def test_help_is_a_word_too(vfplan_cli):
    assert vfplan_cli("help", "info").stdout == vfplan_cli("info", "--help").stdout


def test_a_plan_takes_the_fields_of_its_settings_in_their_units(vfplan_cli, tmp_path):
    settings = {
        "pixel_spacing_mm": [0.5, 0.5], "tolerance_m": 2e-5, "stiffness": [800],
        "point_radius": 0.001, "max_residual_m": 0.002, "max_tre_m": None, "guide_m": 0.002,
        "guide_pull": [1.0, 0.01],
    }  # fmt: skip
    path = file_with(tmp_path / "settings.json", json.dumps(settings))
    typed = "--pixel-spacing 0.5 --tolerance 0.02 --stiffness 800 --point-radius 1 "
    typed += "--max-residual 2 --max-tre none --guide 2 --guide-pull 1,10"
    for name, words in (("a.h5", ("--settings", path)), ("b.h5", typed.split())):
        assert vfplan_cli("plan", *ELBOW, *words, "--no-sheet", "-o", tmp_path / name).sound
    differing = vfplan_cli("diff", "a.h5", "b.h5", "--json", cwd=tmp_path).json["differences"]
    assert not [row for row in differing if not row["path"].startswith("/provenance")]


@pytest.mark.parametrize("text, code", [
    ('{"colour": "red", "no_such": 1}', "unknown-setting"),
    ('{"output": "x.h5"}', "unknown-setting"),
    ('{"method": "magic"}', "unknown-choice"),
    ('{"max_gap_px": "20"}', "setting-of-another-form"),
    ('{"roi": {"u": 1}}', "setting-of-another-form"),
    ('{"accept_width": 1}', "setting-of-another-form"),
    ('{"max_gap_px": NaN}', "not-json"), (f'{{"max_gap_px": {400 * "9"}}}', "not-json"),
    ('{"max_gap_px": 1e400}', "not-json"), ('{"max_gap_px": 5, "max_gap_px": 9}', "setting-twice"),
    ("[1]", "not-json"),
    ("{", "not-json"),
])  # fmt: skip
def test_a_file_that_does_not_fit_is_refused(vfplan_cli, tmp_path, text, code):
    path, out = tmp_path / "settings.json", tmp_path / "a.h5"
    path.write_text(text)
    done = vfplan_cli("extract", ELBOW[0], "--settings", path, "-o", out, "--json")
    assert done.code in (2, 3)
    assert done.json["error"]["code"] == code
    assert not out.exists()
