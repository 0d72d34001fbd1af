"""What is certified is what is rendered: values of a bundle that must agree.

Each file here holds sound values that do not fit together. It cannot be written by `write_fixture`,
and under a good seal it is refused.
"""

from __future__ import annotations

from dataclasses import replace

import bundles
import curves
import damage
import numpy as np
import pytest
from refusals import refuses

import vfplan
from vfplan.bundle.content import to_content
from vfplan.bundle.read import read_bundle
from vfplan.bundle.validation import validate
from vfplan.bundle.write import completed, to_payload
from vfplan.errors import SettingError, UnsafeError
from vfplan.fixture import Pieces, StabilityVerdict


def with_pieces(fixture, **change):
    return replace(fixture, curve=replace(fixture.curve, pieces=replace(fixture.pieces, **change)))


def vertices(change):
    """The drawn fixture with vertices that `change` makes of the true ones."""
    return lambda: with_pieces(bundles.drawn(), vertices=change(bundles.drawn().pieces.vertices))


def with_inserted(at, places):
    """The drawn fixture with more vertices in its first stroke, joined by lines."""
    fixture = bundles.drawn()
    old, count = fixture.pieces, len(places)
    return with_pieces(
        fixture,
        vertices=np.insert(old.vertices, at, places, axis=0),
        bulges=np.insert(old.bulges, at, np.zeros(count)),
        stroke=np.insert(old.stroke, at, np.zeros(count, np.int32)),
    )


def spur():
    """5 mm and back, in the middle of the first line."""
    return with_inserted(1, [[0.415, 0, 0.1], [0.415, 0.005, 0.1], [0.415, 0, 0.1]])


def turned_over():
    return with_pieces(bundles.drawn(), bulges=bundles.drawn().pieces.bulges * [1, -1, 1, 1, 1])


def shortened():
    """The pieces stop half way: the rest of the points is certified and not rendered."""
    fixture = bundles.drawn()
    old = fixture.pieces
    keep = np.array([True, True, False, True, True])
    return with_pieces(
        fixture, vertices=old.vertices[keep], bulges=old.bulges[keep], stroke=old.stroke[keep]
    )


def short_cut():
    """A second way along the first stroke: every vertex and every point lies on the curve."""
    return with_inserted(3, bundles.drawn().pieces.vertices[[2, 0, 1]])


def reversed_pieces():
    fixture = bundles.drawn()
    old = fixture.pieces
    order = np.array([2, 1, 0, 3, 4])
    bulges = old.bulges.copy()
    bulges[:2] = -old.bulges[[1, 0]]
    return with_pieces(fixture, vertices=old.vertices[order], bulges=bulges)


def verdict(**change):
    """The stability gate's verdict on the K of `bundles.whole`, 1000 N/m across its axis."""
    axis, K = bundles.whole().ignore_axis, bundles.whole().stiffness
    across = np.eye(3) - np.outer(axis, axis)
    felt = float(np.linalg.eigvalsh(across @ np.diag(K) @ across).max())
    known = {"mass_kg": 1.0, "damping_n_s_per_m": 5.0, "rate_hz": 1000.0, "delay_ticks": 1}
    numbers = {"k_n_per_m": felt, "k_max_n_per_m": 3338.0, "margin": 1.25}
    return StabilityVerdict("franka", **known | numbers | change)


def much_stiffer():
    rendering = replace(bundles.whole().rendering, stiffness=np.full(3, 1e6))
    return replace(bundles.whole(), rendering=rendering, stability=verdict())


def off_the_slice():
    fixture = bundles.whole()
    return replace(fixture, points=fixture.points + 0.01 * fixture.ignore_axis)


def other_markers():
    fixture = bundles.patient()
    target = fixture.registration.target + np.array([0.01, 0, 0])
    return replace(fixture, registration=replace(fixture.registration, target=target))


def free_point():
    fixture = bundles.sheet()
    return replace(fixture, points=np.vstack([fixture.points, [[0.05, 0.05, 0.05]]]))


# What does not agree, how it is made, and the code of what is refused of it.
CASES = {
    "vertices collapsed to a dot": (vertices(lambda v: 0 * v + v[0]), "pieces"),
    "a stroke torn off by 54 mm": (
        vertices(lambda v: v + np.outer([0, 0, 0, 1, 1], [0.054, 0, 0])), "pieces"),
    "a spur of 5 mm": (spur, "pieces"), "an arc turned over": (turned_over, "pieces"),
    "pieces that stop half way": (shortened, "pieces"),
    "pieces that go back and begin again": (short_cut, "pieces"),
    "pieces drawn the other way": (reversed_pieces, "pieces"),
    "K of 1e6 beside a verdict on 1000": (much_stiffer, "stability"),
    "a guide that no verdict is about": (
        lambda: replace(bundles.guided(), stability=verdict()), "stability"),
    "points that do not lie on the slice": (off_the_slice, "registration"),
    "markers that were moved": (other_markers, "registration"),
    "a point of no triangle": (free_point, "mesh"),
}  # fmt: skip


@pytest.mark.parametrize("make, part", CASES.values(), ids=CASES)
def test_parts_that_do_not_agree_are_not_written_and_not_read(make, part, tmp_path):
    code = f"unsafe.{part}"
    with refuses(SettingError, code):
        vfplan.write_fixture(make(), tmp_path / "a.h5")
    assert not (tmp_path / "a.h5").exists()
    data = damage.sealed(to_payload(completed(to_content(make()))))
    with refuses(UnsafeError, code):
        read_bundle(data)
    assert [i.code for i in validate(data) if i.severity == "error"] == [code]


def test_what_agrees_is_written(tmp_path):
    with_the_guide = verdict(k_n_per_m=verdict().k_n_per_m + bundles.guided().guidance.stiffness)
    whole = replace(bundles.whole(), stability=verdict())
    guided = replace(bundles.guided(), stability=with_the_guide)
    for number, fixture in enumerate((bundles.drawn(), whole, guided)):
        vfplan.write_fixture(fixture, tmp_path / f"{number}.h5")


def unit(vector):
    return vector / np.linalg.norm(vector)


def drawn_at_random(draw):
    """Strokes of lines and arcs in a plane at random, and points on them: closed forms."""
    axis = unit(draw.normal(size=3))
    x = unit(np.cross(axis, draw.normal(size=3)))
    frame = np.array([x, np.cross(axis, x)])
    points, strokes = [], []
    for _ in range(draw.integers(1, 4)):
        count = int(draw.integers(2, 8))
        corners = 0.02 * np.cumsum(draw.uniform(-1, 1, (count, 2)), axis=0)
        bends = np.where(draw.random(count) < 0.4, 0.0, draw.uniform(-1, 1, count))
        is_closed = bool(draw.random() < 0.5)
        links = curves.links(curves.pieces([(corners, bends, is_closed)]))
        places = np.vstack([curves.on_link(*link, 2e-3)[:-1] for link in links])
        if is_closed:
            places = np.roll(places, -int(draw.integers(0, len(places))), axis=0)
        else:
            places = np.vstack([places, corners[-1:]])
        height = draw.uniform(-0.1, 0.1, (len(places), 1))
        points.append(places @ frame + height * axis)
        strokes.append((corners @ frame, bends, is_closed))
    pieces = replace(Pieces.joined(strokes), error=1e-8)
    owners = np.repeat(np.arange(len(points), dtype=np.int32), [len(places) for places in points])
    curve = bundles.Curve(owners, pieces.closed, pieces=pieces)
    rendering = replace(bundles.small().rendering, ignore_axis=axis)
    return replace(bundles.small(), points=np.vstack(points), curve=curve, rendering=rendering)


@pytest.mark.parametrize("seed", range(150))
def test_curves_at_random_agree_with_points_on_them_and_not_with_others(seed, tmp_path):
    draw = np.random.default_rng(seed)
    fixture = drawn_at_random(draw)
    path = bundles.stored(tmp_path / "a.h5", fixture)
    assert vfplan.ProxyEngine.of(fixture, "exact").distance(fixture.points).max() < 2e-8
    move = draw.normal(size=3)
    move -= (move @ fixture.ignore_axis) * fixture.ignore_axis
    move *= 1e-4 / np.linalg.norm(move)
    moved = with_pieces(fixture, vertices=fixture.pieces.vertices + move)
    apart = vfplan.ProxyEngine.of(moved, "exact").distance(fixture.points).max()
    if apart > 2e-6:
        with pytest.raises(SettingError):
            vfplan.write_fixture(moved, path, overwrite=True)
