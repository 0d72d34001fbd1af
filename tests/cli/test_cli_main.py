"""The bare command and the commands' names."""

import pytest

import vfplan


def test_without_a_command_the_help_is_shown(vfplan_cli):
    run = vfplan_cli()
    assert run.code == 0
    assert run.stdout == vfplan_cli("--help").stdout


@pytest.mark.parametrize(
    ("word", "hint"),
    [("registr", "did you mean 'register'?"), ("xyzzy", "they are plan, extract, register")],
)
def test_an_unknown_command_is_answered_with_what_there_is(vfplan_cli, word, hint):
    run = vfplan_cli(word)
    assert (run.code, run.stdout) == (2, "")
    assert f"no command '{word}'; {hint}" in run.error_line


def test_cmake_dir_is_the_packages(vfplan_cli):
    assert vfplan_cli("--cmake-dir").stdout.strip() == str(vfplan.cmake_dir())
