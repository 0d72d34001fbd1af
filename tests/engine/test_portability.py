"""What the engine's headers ask of a compiler, and what they refuse with a reason."""

import subprocess

import pytest
from conftest import file_with, need_program, output
from motion import INCLUDE, NATIVE

pytestmark = pytest.mark.slow


def compiled(tmp_path, *flags, band="1e-5", compiler="g++"):
    """(program, messages) of an engine built with these flags."""
    program = need_program(compiler, compiler)
    words = [program, "-std=c++20", "-ffp-contract=off", "-DVFPLAN_NARROW", f"-DBAND={band}"]
    words += [f"-I{INCLUDE}", *flags, NATIVE / "portable.cpp", "-o", tmp_path / "main"]
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False)
    return (tmp_path / "main" if done.returncode == 0 else None), done.stderr


# Told that there is no NaN, without vector extensions, or with the rules compiled apart.
@pytest.mark.parametrize("flag, reason", [
    *((f"-f{word}", "a NaN would become a force") for word in ("fast-math", "finite-math-only")),
    ("-Ofast", "a NaN would become a force"), ("-U__GNUC__", "build with g++, clang or MinGW"),
    ("-DVFPLAN_COMPILED", "make_impl")])  # fmt: skip
def test_what_cannot_be_built_is_refused_with_its_reason(flag, reason, tmp_path):
    program, says = compiled(tmp_path, flag)
    assert program is None
    assert reason in says


@pytest.mark.parametrize("header", ["engine", "guide", "moving", "telemetry", "bundle/fixture"])
def test_an_older_standard_is_told_what_to_give_and_nothing_else(header, tmp_path):
    file = file_with(tmp_path / "main.cpp", f'#include "vfplan/{header}.hpp"\n')
    words = [need_program("g++", "g++"), "-std=c++14", f"-I{INCLUDE}", "-fsyntax-only", file]
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    first, *more = [line for line in done.stderr.splitlines() if "error: " in line]
    assert "needs C++20: compile with -std=c++20" in first
    assert len(more) == 1  # the file that is not there


def test_without_exceptions_a_bad_setting_ends_the_program_with_its_reason(tmp_path):
    program, says = compiled(tmp_path, "-fno-exceptions", "-fno-rtti", band="-1")
    assert program, says
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert done.stderr == (
        "vfplan: band is -1 m. Give a value above 0 and at most 0.005 m (at most contact_radius).\n"
    )


def test_the_rules_compiled_once_give_the_same_engine(tmp_path):
    """With VFPLAN_COMPILED the header only declares the rules; engine.cpp has them."""
    apart, says = compiled(tmp_path, "-DVFPLAN_COMPILED", INCLUDE / "vfplan" / "engine.cpp")
    assert apart, says
    output(apart)
