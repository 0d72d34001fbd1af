"""Extreme clouds and settings: the right value within the limit, or a refusal by name."""

from dataclasses import replace
from itertools import pairwise

import curves
import numpy as np
import pytest
from motion import grid, play, unit_circle

from vfplan import ProxyEngine
from vfplan.geometry.lines import interpolated
from vfplan.stability.cases import ROUNDING_M, breach, energy_balance, random_path
from vfplan.stability.contacts import Contact, patch

R, UP = 5e-3, np.array([[0.0, 1.0, 0.0]])


def engine_at(place, **settings):
    settings = {"contact_radius": place.radius, "ignore_axis": place.ignore_axis} | settings
    engine = ProxyEngine(place.points, **settings)
    engine.reset(place.start)
    return engine


def walked(place, **settings):
    """The breach over a random walk."""
    engine = engine_at(place, **settings)
    place = replace(place, radius=engine.parameters.R)
    return breach(engine, play(engine, random_path(place, 3000), place.start))


ALONG = np.array([np.cos(np.pi / 360), np.sin(np.pi / 360)])
WEDGE = 20 * np.array([-ALONG, [0, 0], ALONG * [-1, 1]])
# Strokes [mm], and by how much the points beyond the middle are denser.
OUTLINES = {
    "flat": ([[[-20, 0], [0, 0], [20, 0]]], 1), "1 degree wedge": ([WEDGE], 1),
    "1 degree notch": ([-WEDGE], 1), "gap of 2 R": ([[[-20, 0], [-5, 0]], [[5, 0], [20, 0]]], 1),
    "density 100:1": ([[[-20, 0], [0, 0], [20, 0]]], 100),
}  # fmt: skip


def engines(outline, scale, offset, noise, stiffness):
    """Each rule's engine at R = 5 mm times the scale, and what it renders."""
    strokes, density = OUTLINES[outline]
    unit, settings = 1e-3 * scale, {"contact_radius": R * scale, "stiffness": stiffness}
    strokes = [unit * np.asarray(stroke, float) for stroke in strokes]
    points, corners, triangles = [], [], []
    for i, (p, q) in enumerate(side for stroke in strokes for side in pairwise(stroke)):
        count = 1 + round(2 * np.linalg.norm(q - p) / unit) * (density if i else 1)
        points += [*np.linspace([*p, 0], [*q, 0], count)]
        corners += [[*end, z] for end in (p, q) for z in (-20 * unit, 20 * unit)]
        triangles += [[4 * i, 4 * i + 1, 4 * i + 2], [4 * i + 1, 4 * i + 3, 4 * i + 2]]
    away = offset * np.ones(3)
    cloud = np.array(points) + away
    cloud += noise * 0.5 * unit * np.random.default_rng(3).normal(size=cloud.shape)
    yield ProxyEngine(cloud, ignore_axis="z", **settings), Contact(cloud, away, UP, "z")
    if noise == 0 and density == 1:
        curve = curves.pieces([(v, np.zeros(len(v)), False) for v in strokes], offset)
        curve = replace(curve, vertices=curve.vertices * [1, 1, 0] + away * [0, 0, 1])
        exact = Contact(curve.vertices, away, UP, "z", exact_shape=curve)
        yield ProxyEngine.along(curve, ignore_axis="z", **settings), exact
        mesh, faces = np.array(corners) + away, np.array(triangles, np.int32)
        yield ProxyEngine.on(mesh, faces, **settings), Contact(mesh, away, UP, exact_shape=faces)


@pytest.mark.parametrize("scale, offset", [(1, 0), (1, 1), (1, 999_999), (1e-6, 0), (1e3, 0)])
@pytest.mark.parametrize("noise", [0, 0.2])
@pytest.mark.parametrize("outline", OUTLINES)
def test_every_rule_keeps_its_promises_on_extreme_geometry(outline, noise, scale, offset):
    """Outside; never receding by more than the band; K times the stretch; at rest; let go."""
    rng = np.random.default_rng(5)
    stiffness = 10 ** rng.uniform(-3, 6)
    rounding = ROUNDING_M * max(scale, 1) + 1e-15 * offset
    for engine, place in engines(outline, scale, offset, noise, stiffness):
        r, band, axis = engine.parameters.R, engine.parameters.band, place.ignore_axis
        start = offset + np.array([0.0, 2.5 * r, 0.0])
        turns = start + r * (rng.normal(size=(7, 3)) - 3 * UP) * [1, 1, 0]
        way = np.vstack([start, turns, turns[-1]])
        at = np.linspace(0, len(way) - 1, 500 * (len(way) - 1))
        hips = interpolated(at, np.arange(len(way)), way)
        trace = play(engine, hips, start)
        case = engine.rule, axis
        assert breach(engine, trace) <= rounding, case
        stretch = (trace.proxy - hips) * [1, 1, axis is None]
        assert np.abs(trace.force / stiffness - stretch).max() <= rounding, case
        axis = None if axis is None else np.array([0.0, 0.0, 1.0])
        assert energy_balance(trace, hips, stiffness, axis)[1] <= band + rounding, case
        assert np.ptp(trace.proxy[-100:], axis=0).max() <= rounding, case
        # A hand that goes to where the proxy is feels nothing there.
        back = engine.run(np.linspace(hips[-1], trace.proxy[-1], 300))
        assert np.abs(back.force[-1] / stiffness).max() <= band + rounding, case


def row(count, spacing):
    x = (np.arange(count) - count // 2) * spacing
    return Contact(np.column_stack([x, 0 * x, 0 * x]), R * UP[0], UP, "z")


def sheet(side, spacing=5e-4):
    x = (np.arange(side) - side // 2) * spacing
    return Contact(grid(x, x)[:, [0, 2, 1]], R * UP[0], UP)


def blob(points, top=0.0):
    return Contact(np.array(points), (R + top) * UP[0], UP)


def tilted():
    u, v, _ = grid(np.linspace(-0.01, 0.01, 41), np.linspace(-0.01, 0.01, 41)).T
    return np.column_stack([u, 0.3 * u - 0.2 * v, v])


def scattered(count, extent):
    return np.random.default_rng(0).uniform(-0.5, 0.5, (count, 3)) * extent


CLOUDS = {
    "cloud of 1 µm": lambda: blob(scattered(100, 1e-6), 1e-6),
    "cloud of 1 km, 1e6 points": lambda: row(1_000_001, 1e-3),
    "one point": lambda: blob(np.zeros((1, 3))),
    "all points equal": lambda: blob(np.zeros((1000, 3))),
    "every point three times": lambda: blob(np.repeat(tilted(), 3, axis=0), 5e-3),
    "curve, spacing 0.001 R": lambda: row(20_001, 5e-6),
    "sheet, spacing 0.02 R": lambda: sheet(401, 1e-4),
    "sheet, spacing R": lambda: sheet(41, R),
    "dust, 1e5 points in 1 cm³": lambda: blob(scattered(100_000, 0.01), 5e-3),
    # No engine can hold what leaks: it must stay outside every ball.
    "sheet, spacing 1.5 R, leaks": lambda: sheet(31, 1.5 * R),
}


@pytest.mark.parametrize("cloud", [
    *(pytest.param(cloud, id=name) for name, cloud in CLOUDS.items()),
    pytest.param(lambda: sheet(3163), marks=pytest.mark.full, id="ten million points"),
])  # fmt: skip
def test_the_proxy_stays_outside_of_any_cloud(cloud):
    assert walked(cloud()) <= ROUNDING_M


def cusp():
    t = np.linspace(-1, 1, 801)  # semicubical: both branches leave the tip along one tangent
    return 0.04 * t * t, 0.02 * t**3


def needle():
    s = np.linspace(-0.03, 0.03, 301)  # a channel that the proxy does not fit
    return np.tile(s, 2), np.repeat([-4.95e-3, 4.95e-3], 301)


@pytest.mark.parametrize("curve", [cusp, needle])
def test_the_proxy_stays_outside_of_curves_with_every_trap(curve):
    """Met along the whole curve and across it."""
    x, y = curve()
    points = np.column_stack([x, y, 0 * x])
    place = Contact(points, points.min(axis=0) - 2 * R, -UP, "z")
    engine, way = engine_at(place), [place.start]
    for p in points[:: max(1, len(points) // 60)]:
        way += [p + np.array([2e-3, 1e-3, 0]), p - np.array([1e-3, 3e-3, 0])]
    at = np.linspace(0, len(way) - 1, 40 * len(way))
    hips = interpolated(at, np.arange(len(way)), np.array(way))
    assert breach(engine, engine.run(hips)) <= ROUNDING_M


@pytest.mark.parametrize("settings", [
    {"band": 1e-9}, {"band": 5e-11}, {"band": 5e-3, "outer_radius": 11e-3}, {"point_radius": 1e3},
    {"point_radius": 10e-3}, {"point_radius": 100e-3}, {"outer_radius": 2e6},
    {"band": 1e-5, "outer_radius": 5.01e-3 * (1 + 1e-12)},
    {"band": 1e-5, "outer_radius": 0.501}], ids=str)  # fmt: skip
def test_the_proxy_stays_outside_with_settings_at_the_ends_of_their_ranges(settings):
    lift = settings.get("point_radius", 0.0) * UP[0]
    assert walked(replace(patch(), touch=patch().touch + lift), **settings) <= ROUNDING_M


def test_nothing_is_felt_on_the_medial_axis_of_a_ring():
    ring = 0.02 * unit_circle(np.linspace(0, 2 * np.pi, 360, endpoint=False))
    trace = play(ProxyEngine(ring, R, ignore_axis="z"), np.zeros((1000, 3)), [1e-3, 0.0, 0.0])
    assert not trace.proxy.any()
    assert not trace.force.any()
