"""Fixtures and sessions that the replay tests share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vfplan.fixture import Curve, Fixture, Pieces, Provenance, Rendering
from vfplan.session.session import Session

BORN = Provenance("2026-01-01T00:00:00Z", "vfplan 0")


def fixture_of(points, *, axis=(0.0, 0.0, 1.0), stiffness=1000.0, curve=True, rv=0.0, band=1e-5):
    """A fixture of points in the robot's frame; planar unless `axis` is `None`."""
    points = np.asarray(points, float)
    return Fixture(
        "robot_base",
        points,
        BORN,
        curve=Curve(np.zeros(len(points), np.int32), np.array([False])) if curve else None,
        rendering=Rendering(
            np.broadcast_to(np.asarray(stiffness, float), 3).copy(),
            5e-3,
            band,
            rv,
            None if axis is None else np.asarray(axis, float),
        ),
    )


def of_pieces(pieces, **more):
    """A fixture of lines and arcs."""
    fixture = fixture_of(pieces.vertices, **more)
    return replace(fixture, curve=Curve(pieces.stroke, pieces.closed, pieces=pieces))


def of_lines(vertices):
    """A fixture of one open stroke of lines."""
    one = np.zeros(len(vertices), np.int32), np.array([False])
    return of_pieces(Pieces(vertices, np.zeros(len(vertices)), *one))


def meshed(points, triangles, axis=None):
    """A fixture of triangles."""
    return replace(fixture_of(points, axis=axis, curve=False), mesh=triangles)


def line(length=0.1, spacing=0.5e-3):
    """A straight planned curve along x."""
    x = np.arange(0.0, length, spacing)
    return np.stack([x, 0 * x, 0 * x], axis=1)


def probing(seconds=3.0, seed=None):
    """A hand that slides along x and presses into the line once every 1.5 s."""
    t = np.arange(round(seconds * 1000.0)) / 1000.0
    y = 0.015 - (0.015 - 1e-3) * np.sin(2 * np.pi * t / 1.5) ** 2
    hip = np.stack([0.02 + 0.02 * t, y, 0.001 * np.sin(t)], axis=1)
    if seed is not None:
        hip += np.random.default_rng(seed).normal(0, 1e-5, hip.shape)
    return Session(t, hip)


def at_1_khz(hip):
    """A session of these positions (T, 3)."""
    return Session(1e-3 * np.arange(len(hip)), hip)


def write_session(path, session, **columns):
    """A session as CSV, with more columns where these are given."""
    rows = np.column_stack([session.time, session.hip, *columns.values()])
    head = ",".join(["t", "x", "y", "z", *columns])
    np.savetxt(path, rows, "%.17g", ",", header=head, comments="")


def codes_of(replayed):
    """The codes of a replay's findings."""
    return {finding["code"] for finding in replayed.metrics["findings"]}
