"""What tests of the engine share: grids of points, runs from a start, and what every run keeps."""

from __future__ import annotations

import numpy as np
from conftest import ROOT, need_program, output
from scipy.spatial.transform import Rotation

from vfplan import Status
from vfplan.geometry.lines import step_lengths

BROKEN = ("inside", "grown", "limit", "through", "restless", "stuck")
R, K = 5e-3, 1000.0
FIELDS = ("proxy", "normal", "force", "state", "status")
INCLUDE = ROOT / "vfplan" / "native" / "include"
NATIVE = ROOT / "tests" / "native"
STRICT = ("-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Werror")


def grid(x, y, z=0.0):
    """(N, 3) points at each x and y, at the height z."""
    x, y = (side.ravel() for side in np.meshgrid(x, y))
    return np.column_stack([x, y, np.full(x.size, z)])


def even(half, spacing):
    """Numbers from -half to half, evenly spaced."""
    return np.arange(-half, half + spacing / 2, spacing)


SHEET = grid(even(0.02, 5e-4), even(0.02, 5e-4))


def turned(axis, angle):
    """(3, 3) a rotation."""
    return Rotation.from_rotvec(angle * np.asarray(axis) / np.linalg.norm(axis)).as_matrix()


def unit_circle(turn):
    """(N, 3) places on the unit circle around z."""
    return np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])


def play(engine, hips, start=None):
    """The trace of a path, from its first HIP on or from a start."""
    engine.reset(hips[0] if start is None else start)
    return engine.run(hips)


def hold(engine, hip, ticks=300):
    return engine.run(np.tile(hip, (ticks, 1)))


def sizes(rows, before=None):
    """(T,) how far each row is from the one before it; the first from `before`, if given."""
    if before is not None:
        rows = np.vstack([before, rows])
    return step_lengths(rows)


def same(one, other, fields=FIELDS):
    """Assert that two traces, or a trace and steps, are the same to the bit."""
    for name in fields:
        rows = [getattr(step, name) for step in other] if isinstance(other, list) else None
        assert np.array_equal(getattr(one, name), getattr(other, name) if rows is None else rows)


def led_out(trace, hips):
    """Assert that a proxy that starts inside is led out, once and without a jump of the force.

    No force is further than K (R / 256 + |step of the HIP|) from the one before it, to the tick in
    which the rule takes over. Returns that tick, and how much a force went beyond.
    """
    told = trace.status & Status.INSIDE > 0
    assert told[0]
    end = np.flatnonzero(told)[-1] + 1
    assert end < len(hips)
    assert told[:end].all()
    beyond = sizes(trace.force, np.zeros(3)) - K * (R / 256 + sizes(hips, hips[0]))
    assert beyond[: end + 1].max() < 1e-9
    return end


def compiled(folder, source, *flags, compiler="g++"):
    """The program of a file of tests/native, built as the exported CMake target builds it."""
    program = folder / (source.stem + "".join(flags).replace("/", "_").replace("=", "_"))
    if not program.exists():
        words = [need_program(compiler, compiler), "-std=c++20", *STRICT, *flags, f"-I{INCLUDE}"]
        output(*words, f"-I{NATIVE}", source, "-o", program, timeout=900)
    return program


# A program's own peak memory, as an expression; that of getrusage begins with its parent's.
PEAK_KIB = 'int(open("/proc/self/status").read().split("VmHWM:")[1].split()[0])'


def drag(engine, tally, draw, proxy, held, distance, slack=(1e-13, 0.0), late=False):
    """Twelve paths of `draw(proxy, normal)`, the last HIP of each held: (trace, hips, before, out).

    Counts ticks inside R - band of what `distance` measures, and ticks in which the proxy went
    further from the HIP, each beyond its slack. `out` says where the proxy did not start inside;
    with `late` also not in the tick before.
    """
    radius, band, normal = engine.parameters.R, engine.parameters.band, np.array([1.0, 0, 0])
    engine.reset(proxy)
    for _ in range(12):
        hips = draw(proxy, normal)
        hips = np.vstack([hips, np.repeat(hips[-1:], held, axis=0)])
        trace = engine.run(hips)
        before = np.vstack([proxy, trace.proxy[:-1]])
        pull, pull_before = (np.linalg.norm(x - hips, axis=1) for x in (trace.proxy, before))
        out = (trace.status & Status.INSIDE) == 0
        if late:
            out[1:] &= out[:-1]
        assert np.isfinite(trace.force).all()
        low = radius - band - distance(trace.proxy)
        tally["ticks"] += len(hips)
        tally["contact"] += int((trace.state > 0).sum())
        tally["inside"] += int((out & (low > slack[0])).sum())
        tally["grown"] += int((out & (pull - pull_before > band + slack[1])).sum())
        tally["limit"] += int((trace.status & Status.LIMIT > 0).sum())
        yield trace, hips, before, out
        proxy, normal = trace.proxy[-1], trace.normal[-1]


def unbroken(tally, broken=BROKEN):
    """Assert that no guarantee was broken in any tick that was counted."""
    print(dict(tally))  # pytest -s: the numbers of docs/algorithm.md
    assert not any(tally[name] for name in broken), tally
