"""What must not change by accident is what tests/data/oracle holds; see the README there."""

import pytest
from conftest import ROOT, need_program
from oracle import engine

FROZEN = ROOT / "tests" / "data" / "oracle"


def different(frozen, new):
    """The lines of {name: line} that are not the same, each as it was and as it is."""
    lines = []
    for name in sorted(frozen.keys() | new.keys()):
        before, now = frozen.get(name, "absent"), new.get(name, "absent")
        if before != now:
            lines.append(f"{name}\n    was {before}\n    is  {now}")
    return "\n".join(lines)


def test_the_engine_gives_the_same_bits():
    compiler = need_program("g++", "g++")
    frozen = engine.parsed((FROZEN / "engine.txt").read_text())
    assert len(frozen) == 64
    changes = different(frozen, engine.sums(ROOT, engine.TICKS["engine.txt"], compiler=compiler))
    assert not changes, changes


@pytest.mark.full
@pytest.mark.parametrize("width", [2, 4, 8])
def test_the_engine_gives_the_same_bits_with_every_width(width):
    """A processor that lacks a width takes the next smaller one."""
    compiler = need_program("g++", "g++")
    frozen = engine.parsed((FROZEN / "engine-long.txt").read_text())
    ticks = engine.TICKS["engine-long.txt"]
    new = engine.sums(ROOT, ticks, wide=True, width=width, compiler=compiler)
    changes = different(frozen, new)
    assert not changes, changes
