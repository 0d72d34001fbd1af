"""Made-up fixtures for the bundle's tests: a minimal one, and one with every part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import vfplan
from vfplan.bundle import review_digest
from vfplan.conformance import fixtures
from vfplan.findings import doubt, note
from vfplan.fixture import (
    Curve,
    Fixture,
    Provenance,
    RegistrationRecord,
    Rendering,
    Review,
    SourceImage,
)

PROVENANCE = Provenance(created_utc="2026-01-02T03:04:05Z", software="vfplan 0.1.0")


def stored(path, fixture):
    """The path, at which the fixture then stands."""
    vfplan.write_fixture(fixture, path)
    return path


def minimal():
    """Twelve points, nothing optional."""
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    points = np.column_stack([0.4 + 0.002 * np.cos(angle), 0.002 * np.sin(angle), 0.1 + 0 * angle])
    return Fixture("robot_base", points, PROVENANCE)


def small():
    """The minimal one with rendering parameters: small enough for a sweep over every byte."""
    return replace(minimal(), rendering=fixtures.cloud().rendering)


def guided():
    """The whole one, whose ring guides and whose arc is forbidden."""
    return replace(whole(), guidance=fixtures.guided().guidance)


def large(count=100_000):
    """A closed curve of many points."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    points = np.column_stack([0.4 + 0.1 * np.cos(angle), 0.1 * np.sin(angle), 0.1 + 0 * angle])
    curve = Curve(np.zeros(count, np.int32), np.array([True]))
    return replace(small(), points=points, sigma=np.full(count, 1e-5), curve=curve)


def sheet():
    """A square of triangles, 3 mm a side of each, with an open rim."""
    made = fixtures.mesh(side=8)
    return replace(small(), points=made.points, mesh=made.mesh)


def pixels():
    """A curve of the frame image, not registered yet."""
    base = whole()
    points = np.column_stack([base.sigma * 0 + 300, np.arange(70.0), np.zeros(70)])
    return replace(base, frame="image", points=points, rendering=None, registration=None)


def patient():
    """Points of a 3-D registration from a navigation system's axes."""
    return replace(small(), registration=fixtures.navigated().registration)


def whole():
    """An arc and a ring of points in a tilted plane, every optional part present."""
    arc = np.linspace(0, np.pi, 40)
    ring = np.linspace(0, 2 * np.pi, 30, endpoint=False)
    u = np.concatenate([300 + 60 * np.cos(arc), 520 + 20 * np.cos(ring)])
    v = np.concatenate([400 - 60 * np.sin(arc), 400 + 20 * np.sin(ring)])
    T = np.array([[5.9e-4, 1e-6, 0.25], [-2e-6, -5.8e-4, 0.31], [3e-5, 4e-5, 0.12]])
    points = np.column_stack([u, v, np.ones_like(u)]) @ T.T
    normal = np.cross(T[:, 0], T[:, 1])
    markers = np.array([(u, v) for v in (100.0, 390.0, 700.0) for u in (80.0, 430.0, 790.0)])
    target = np.column_stack([markers, np.ones(9)]) @ T.T
    noise = 3e-4 * np.sin(np.arange(27.0)).reshape(9, 3)
    residuals = np.linalg.norm(noise, axis=1)
    n = len(points)
    return Fixture(
        frame="robot_base",
        points=points,
        provenance=replace(
            PROVENANCE,
            inputs={"image": "ab" * 32, "markers": "cd" * 32},
            settings={"method": "ridge", "tolerance_m": 1e-5, "max_gap_px": 20, "robust": False},
        ),
        sigma=np.full(n, 1.2e-5),
        curve=Curve(
            stroke=np.repeat([0, 1], [40, 30]).astype(np.int32),
            closed=np.array([False, True]),
            bridged=np.arange(n) % 9 == 0,
        ),
        image=SourceImage(871, 786, (0.5954, 0.5954)),
        rendering=Rendering(
            stiffness=np.array([1000.0, 1000.0, 800.0]),
            contact_radius=0.005,
            band=1e-5,
            point_radius=0.0,
            ignore_axis=normal / np.linalg.norm(normal),
        ),
        registration=RegistrationRecord(
            model="affine",
            source_frame="image",
            T_robot_image=T,
            labels=tuple(f"x{i + 1}" for i in range(9)),
            source=markers,
            target=target + noise,
            residuals_m=residuals,
            fre_rms_m=float(np.sqrt(np.mean(residuals**2))),
            loo_rms_m=5.1e-4,
            tre_rms_m=2.3e-4,
            covariance=np.diag(np.geomspace(1e-14, 1e-8, 9)),
            tre_m=np.linspace(1.9e-4, 2.6e-4, n),
        ),
    )


def drawn():
    """A line that goes on in a quarter circle, and a circle, as pieces and as points on them."""
    return replace(fixtures.pieces(line=30, arc=17, circle=50), provenance=PROVENANCE)


def answered(finding):
    return replace(finding, answered_by="A. Planner", answered_utc="2026-01-02T03:05:06Z")


FINDINGS = (
    doubt("end-other-colour", "extract", "The end lies under other ink.", place_px=(318.5, 400.0)),
    note("bridge-short", "extract", "A gap of 4 px was bridged.", place_px=(352.0, 341.25)),
    doubt("tick-too-long", "plan", "A tick may take 0.4 ms.", place_m=(0.41, 0.05, 0.13)),
    answered(doubt("marker-suspect", "register", "Marker x3 lies 1.2 mm off.")),
)


def doubtful():
    """The whole one with findings, of which two are open, and with points moved by hand."""
    base = whole()
    edited = np.arange(len(base.points)) % 7 == 3
    return replace(base, curve=replace(base.curve, edited=edited), findings=FINDINGS)


def reviewed():
    """The same with all findings answered, approved by a person."""
    return approved(replace(doubtful(), findings=tuple(map(answered, FINDINGS))))


def approved(fixture):
    """A fixture that a person has approved."""
    review = Review("A. Planner", "2026-01-02T03:06:00Z", review_digest(fixture))
    return replace(fixture, reviewed=review)


def same(a, b, path="fixture"):
    """Assert that two fixtures hold the same values, bit for bit."""
    assert type(a) is type(b), path
    if hasattr(a, "__dataclass_fields__"):
        for name in a.__dataclass_fields__:
            same(getattr(a, name), getattr(b, name), f"{path}.{name}")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, path
        assert a.shape == b.shape, path
        assert a.tobytes() == b.tobytes(), path
    elif isinstance(a, tuple):
        assert len(a) == len(b), path
        for i, (one, other) in enumerate(zip(a, b, strict=True)):
            same(one, other, f"{path}[{i}]")
    else:
        assert a == b, path


def largest():
    """As many points as a bundle may hold, with every per-point table."""
    count = 4_000_000
    base = large(count)
    return replace(
        base,
        curve=replace(base.curve, bridged=np.zeros(count, bool)),
        rendering=replace(base.rendering, ignore_axis=np.array([0.0, 0.0, 1.0])),
        registration=replace(patient().registration, tre_m=np.full(count, 1e-4)),
    )


def largest_cloud():
    """As many points as a bundle may hold, bare, at random in a cube."""
    points = np.random.default_rng(0).uniform(-0.2, 0.2, (4_000_000, 3))
    return replace(small(), points=points, sigma=np.full(len(points), 1e-5))
