"""The sums that tests/native/engine_bits.cpp prints: every rule, guide, governor, moving, exchange.

All builds give the same bits, so one file serves every width and processor. For 2dd7600 this was
seen with GCC at -O0 and -O2, with loops of 2, 4 and 8 float64, and with a C library without FMA.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from conftest import output

TICKS = {"engine.txt": 4_000, "engine-long.txt": 40_000}
FLAGS = ["-std=c++20", "-ffp-contract=off"]


def sums(tree, ticks, *, wide=False, width=0, compiler="g++"):
    """The lines that a build of a source tree's engine prints, as {scene: (sums, rest)}.

    Parameters
    ----------
    tree : Path
        The source tree whose headers are used; the program is this tree's.
    ticks : int
        Ticks a scene.
    wide : bool
        Compile the loops of every width with -O2; otherwise the baseline alone with -O0, which
        takes a fifth of the time.
    width : int
        float64 in a register: 2, 4 or 8; 0 takes the most that the processor has.
    """
    source = Path(__file__).parents[1] / "native" / "engine_bits.cpp"
    build = ["-O2"] if wide else ["-O0", "-DVFPLAN_NARROW"]
    include = f"-I{tree / 'vfplan' / 'native' / 'include'}"
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "engine_bits"
        output(compiler, *FLAGS, *build, include, source, "-o", program, timeout=3600)
        return parsed(output(program, ticks, width, timeout=3600))


def parsed(text):
    """{scene: what stands behind its colon} of the lines that are no comments."""
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return dict(line.split(": ", 1) for line in lines)


def text(tree, name):
    """What tests/data/oracle/NAME holds for a source tree."""
    long = name == "engine-long.txt"
    lines = [f"{scene}: {rest}" for scene, rest in sums(tree, TICKS[name], wide=long).items()]
    header = (
        f"# What `engine_bits {TICKS[name]}` (tests/native/engine_bits.cpp) prints, built with\n"
        f"# g++ {' '.join(FLAGS)}. To the bit.\n"
        f"# Renew: python tests/oracle/renew.py {name}\n"
    )
    return header + "\n".join(lines) + "\n"
