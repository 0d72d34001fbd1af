"""The engine's headers without Python: g++ alone builds them; a tick is fit for a controller."""

import os
import re
import subprocess
from collections import Counter, defaultdict
from functools import cache

import pytest
from conftest import ROOT, need_header, need_program, quick_compiler
from motion import INCLUDE, NATIVE, STRICT, compiled, output

pytestmark = pytest.mark.slow

HEADERS = sorted(
    str(path.relative_to(INCLUDE))
    for folder in (".", "curve", "mesh")
    for path in (INCLUDE / "vfplan" / folder).glob("*.hpp")
)


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """Compile tests/native/NAME.cpp, with g++ unless told; returns the program."""
    folder = tmp_path_factory.mktemp("native")
    return lambda name, *flags, **more: compiled(folder, NATIVE / f"{name}.cpp", *flags, **more)


@cache
def included(name):
    """All that a header includes of ours, by others too."""
    names, waiting = set(), [name]
    while waiting:
        text = (INCLUDE / waiting.pop()).read_text()
        direct = set(re.findall(r'^#include "(vfplan/.*\.hpp)"', text, re.M))
        waiting += direct - names
        names |= direct
    assert name not in names, "headers do not include each other"
    return frozenset(names)


def chains():
    """The headers in rows, each of which includes the one before it anyway: seen as if alone."""
    rows = []
    for name in sorted(HEADERS, key=lambda name: len(included(name))):
        before = [row for row in rows if row[-1] in included(name)]
        if before:
            max(before, key=lambda row: len(included(row[-1]))).append(name)
        else:
            rows.append([name])
    return rows


def test_each_header_stands_alone(tmp_path):
    compiler = need_program("g++", "g++")
    every = tmp_path / "every.cpp"
    for row in chains():
        every.write_text("".join(f'#include "{name}"\n' for name in row))
        output(compiler, "-std=c++20", *STRICT, "-fsyntax-only", f"-I{INCLUDE}", every)


def test_clang_compiles_the_same(build):
    """With its wide loops; a warning is an error, and the answers are the same."""
    need_program("clang++", "clang")
    program = build("engine_ticks", "-O0", compiler="clang++")
    assert output(program, 40_000) == output(build("engine_ticks", "-O2"), 40_000)


def test_a_million_ticks_allocate_nothing(build):
    lines = output(build("engine_ticks", "-O2"), 1_000_000).splitlines()
    assert len(lines) >= 20
    assert all(line.endswith("no allocation") for line in lines)


def test_a_controller_keeps_its_bounds_whatever_happens(build):
    assert "stopped" in output(build("controller_ticks", "-O2", "-DVFPLAN_NARROW"), 1_000_000)


@pytest.mark.parametrize("compiler", ["g++", "g++-11"])
def test_vectors_convert_and_what_was_given_away_is_refused(build, compiler):
    optimized = "-O1" if compiler == "g++-11" else "-O0"
    output(build("types", optimized, "-DVFPLAN_NARROW", compiler=compiler))


@pytest.mark.parametrize("name", ["01_press", "02_render", "controller"])
def test_a_users_file_compiles_within_3_seconds_against_the_library(name, tmp_path):
    source = ROOT / "samples" / f"{name}.cpp"
    if name == "controller":
        source = tmp_path / "user.cpp"
        source.write_text('#include "vfplan/controller.hpp"\nint main() {}\n')
    words = ["-std=c++20", "-O2", "-DVFPLAN_COMPILED", f"-I{INCLUDE}", "-c", source, "-o", "u.o"]
    before_s = sum(os.times()[2:4])  # of the programs that were run
    output(need_program("g++", "g++"), *words, cwd=tmp_path)
    assert sum(os.times()[2:4]) < 3 + before_s


SANITIZED = "-fsanitize=address,undefined"


def sanitizing():
    """clang++ where its runtime is installed, which takes a third of the time; else g++."""
    probe = [quick_compiler(), SANITIZED, "-x", "c++", "-", "-o", "/dev/null"]
    done = subprocess.run(probe, input="int main() {}", text=True, capture_output=True)
    return probe[0] if done.returncode == 0 else "g++"


@pytest.mark.parametrize("name", ["engine_ticks", "controller_ticks"])
def test_sanitizers_find_nothing(build, name):
    # One width: the others read the same memory, and would take minutes to compile.
    flags = ["-O0", "-DVFPLAN_NARROW", SANITIZED, "-fno-sanitize-recover=all"]
    output(build(name, *flags, compiler=sanitizing()), 40_000)


def test_each_state_runs_only_the_loops_it_needs(build):
    """Counted by the engine's own loops, wrapped: what a state does not use is not run."""
    calls, points, ticks = defaultdict(Counter), Counter(), {}
    for line in output(build("engine_counts", "-O1", "-DVFPLAN_NARROW")).splitlines():
        rule, dimension, state, count, loop, called, seen = line.split()
        key = rule, int(dimension), int(state)
        ticks[key] = int(count)
        calls[key][loop], points[*key, loop] = int(called), int(seen)
    for (rule, dimension, state), count in ticks.items():
        made = calls[rule, dimension, state]
        if rule == "paper":
            for loop in ("first", "distances"):  # roots, mean distances
                assert made[loop] == 0 or state == 0
            assert made["distances"] <= made["first"]
            # A proxy that has not moved still knows its normal; the path stands for half its time.
            assert made["normal"] < 0.9 * count or count < 100
            assert made["out"] == 0 or state == 2
            for loop in ("meet", "within", "patch", "nearest2"):
                assert made[loop] == 0
        else:
            for loop in ("normal", "first", "distances", "out"):
                assert made[loop] == 0
        if dimension == 2:  # a small cloud: no grid, no list
            assert made["gather"] == 0
        elif state == 1 and count > 0:  # the list serves many ticks and many loops
            assert made["gather"] < count
    # Far from the cloud no point is looked at by the paper's rule's sums.
    assert points["paper", 3, -1, "normal"] < 10 * ticks["paper", 3, -1]
    # Roots are looked for only where a sphere lies within the step.
    assert calls["paper", 3, 0]["first"] < 0.1 * ticks["paper", 3, 0]
    # A radius that covers millions of empty cells: one look at all points, once a tick.
    assert ticks["wide", 3, 0] > 200
    assert points["wide", 3, 0, "nearest2"] == 1000 * ticks["wide", 3, 0]
    # Free motion needs no surfaces.
    assert calls["robust", 3, -1]["patch"] < 0.01 * ticks["robust", 3, -1]


def test_the_grid_hands_out_all_that_is_near_at_bounded_cost(build):
    """Against a look at every point; and no question takes more than O(N), however large."""
    sizes = set()
    for line in output(build("neighbours", "-O2", "-DVFPLAN_NARROW")).splitlines():
        *scene, _dimension, radius, size, stretches, seen = line.split()
        assert int(stretches) <= 1 + int(size) / 32, line
        assert int(seen) <= int(size), line
        sizes.add((" ".join(scene), float(radius)))
    assert len(sizes) >= 130


def test_speed_benchmark_runs(build):
    """Ratios are for docs/engine.md; here only that the program works and agrees with itself."""
    need_header("nanoflann.hpp", "libnanoflann-dev")
    program = build("engine_speed", "-O0", "-DVFPLAN_NARROW", compiler=quick_compiler())
    text = output(program, "--brief")
    for word in ("brute force", "nanoflann", "paper", "robust"):
        assert word in text
    assert "DISAGREE" not in text
