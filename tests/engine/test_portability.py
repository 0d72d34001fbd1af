"""What the engine's headers ask of a compiler, and what they refuse with a reason."""

import subprocess

import pytest
from conftest import need_program
from motion import INCLUDE

pytestmark = pytest.mark.slow

SOURCE = """
#include "vfplan/engine.hpp"
#include "vfplan/governor.hpp"
#include "vfplan/guide.hpp"
#include "vfplan/telemetry.hpp"
int main() {
    const double point[3] = {0, 0, 0};
    vfplan::Parameters p;
    p.band = VALUE;
    return vfplan::Engine(point, 1, p).planar();
}
"""


def compiled(tmp_path, *flags, value="1e-5", compiler="g++"):
    """(program, messages) of an engine built with these flags."""
    program = need_program(compiler, compiler)
    (tmp_path / "main.cpp").write_text(SOURCE.replace("VALUE", value))
    words = [program, "-std=c++20", "-ffp-contract=off", "-DVFPLAN_NARROW", f"-I{INCLUDE}", *flags]
    words += [tmp_path / "main.cpp", "-o", tmp_path / "main"]
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False)
    return (tmp_path / "main" if done.returncode == 0 else None), done.stderr


@pytest.mark.parametrize("flag", ["-ffast-math", "-ffinite-math-only", "-Ofast"])
def test_a_compiler_told_that_there_is_no_nan_is_refused(flag, tmp_path):
    program, says = compiled(tmp_path, flag)
    assert program is None
    assert "a NaN would become a force" in says


@pytest.mark.parametrize("header", ["engine", "guide", "moving", "telemetry", "bundle/fixture"])
def test_an_older_standard_is_told_what_to_give_and_nothing_else(header, tmp_path):
    (tmp_path / "main.cpp").write_text(f'#include "vfplan/{header}.hpp"\n')
    words = [need_program("g++", "g++"), "-std=c++14", f"-I{INCLUDE}", "-fsyntax-only"]
    words.append(tmp_path / "main.cpp")
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    first, *more = [line for line in done.stderr.splitlines() if "error: " in line]
    assert "needs C++20: compile with -std=c++20" in first
    assert len(more) == 1  # the file that is not there


def test_a_compiler_without_vector_extensions_is_told_what_works(tmp_path):
    program, says = compiled(tmp_path, "-U__GNUC__")
    assert program is None
    assert "build with g++, clang or MinGW" in says


def test_without_exceptions_a_bad_setting_ends_the_program_with_its_reason(tmp_path):
    program, says = compiled(tmp_path, "-fno-exceptions", "-fno-rtti", value="-1")
    assert program, says
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert done.stderr == (
        "vfplan: band is -1 m. Give a value above 0 and at most 0.005 m (at most contact_radius).\n"
    )


def test_the_rules_compiled_once_give_the_same_engine(tmp_path):
    """With VFPLAN_COMPILED the header only declares the rules; engine.cpp has them."""
    engine = INCLUDE / "vfplan" / "engine.cpp"
    apart, says = compiled(tmp_path, "-DVFPLAN_COMPILED", engine)
    assert apart, says
    assert subprocess.run([apart], check=False).returncode == 0
    missing, says = compiled(tmp_path, "-DVFPLAN_COMPILED")
    assert missing is None
    assert "make_impl" in says
