"""The small fixtures from which the conformance kit's files are made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vfplan.findings import doubt, note
from vfplan.fixture import (
    Curve,
    Fixture,
    Guidance,
    Pieces,
    Provenance,
    RegistrationRecord,
    Rendering,
    Review,
    SourceImage,
)

TIME = "2026-01-02T03:04:05Z"
AXIS = np.array([0.0, 0.0, 1.0])


def minimal() -> Fixture:
    """Six points, nothing optional."""
    points = np.array([[0.4 + 0.004 * i, 0.0, 0.1] for i in range(6)])
    return Fixture("robot_base", points, Provenance(created_utc=TIME, software="kit 1"))


def cloud() -> Fixture:
    """The same as a bare cloud that is rendered."""
    rendering = Rendering(np.array([1000.0, 1000.0, 800.0]), contact_radius=0.005, band=1e-5)
    return replace(minimal(), rendering=rendering)


def curve() -> Fixture:
    """An open and a closed stroke with every table of a curve."""
    base = cloud()
    square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]]) * 1e-3 + [0.45, 0.02]
    points = np.vstack([base.points, np.column_stack([square, np.full(4, 0.1)])])
    return replace(
        base,
        points=points,
        sigma=np.full(10, 1e-5),
        curve=Curve(
            stroke=np.repeat([0, 1], [6, 4]).astype(np.int32),
            closed=np.array([False, True]),
            bridged=np.arange(10) == 3,
            edited=np.arange(10) == 4,
        ),
        rendering=replace(base.rendering, ignore_axis=AXIS),
        provenance=replace(
            base.provenance,
            inputs={"image": "ab" * 32, "markers": "cd" * 32},
            settings={"method": "ridge", "tolerance_m": 1e-5, "robust": False},
            history=("2026-01-01T00:00:00Z made up",),
        ),
    )


def registered() -> Fixture:
    """The curve, mapped from a slice whose plane is that of the points."""
    T = np.array([[5e-4, 0, 0.25], [0, -5e-4, 0.31], [0, 0, 0.1]])
    source = np.array([[100.0, 100.0], [700.0, 100.0], [100.0, 700.0], [700.0, 700.0]])
    mapped = np.column_stack([source, np.ones(4)]) @ T.T
    shift = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]) * 2.0**-12
    target = mapped + shift
    residuals = np.linalg.norm(target - mapped, axis=1)
    record = RegistrationRecord(
        model="affine",
        source_frame="image",
        T_robot_image=T,
        labels=("a", "b", "c", "d"),
        source=source,
        target=target,
        residuals_m=residuals,
        fre_rms_m=2.0**-12,
        loo_rms_m=5e-4,
        tre_rms_m=2e-4,
        covariance=np.diag(np.full(9, 1e-12)),
        tre_m=np.full(10, 2e-4),
    )
    image = SourceImage(871, 786, (0.5, 0.5))
    return replace(curve(), registration=record, image=image)


def navigated() -> Fixture:
    """A cloud that came from a navigation system's axes."""
    T = np.eye(4)
    T[:3, 3] = (0.5, -0.25, 0.125)
    source = np.array([[0.0, 0, 0], [0.125, 0, 0], [0, 0.125, 0], [0, 0, 0.125]])
    record = RegistrationRecord(
        model="rigid",
        source_frame="patient_lps",
        T_robot_image=T,
        labels=("a", "b", "c", "d"),
        source=source,
        target=source + T[:3, 3],
        residuals_m=np.zeros(4),
        fre_rms_m=0.0,
    )
    return replace(cloud(), registration=record)


def pixels() -> Fixture:
    """A curve on a slice, not registered yet."""
    base = curve()
    points = np.array([[300.0 + 3 * i, 400.0, 0.0] for i in range(10)])
    return replace(
        base, frame="image", points=points, rendering=None, image=SourceImage(871, 786, None)
    )


def patient() -> Fixture:
    """A cloud in the patient's axes."""
    return replace(cloud(), frame="patient_lps")


def mesh(side: int = 3) -> Fixture:
    """A square sheet of `side` points a side, 3 mm apart; each square is two triangles."""
    x, y = np.meshgrid(np.arange(side) * 0.003, np.arange(side) * 0.003)
    points = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    lower = np.column_stack([corner, corner + 1, corner + side])
    upper = np.column_stack([corner + 1, corner + side + 1, corner + side])
    triangles = np.vstack([lower, upper]).astype(np.int32)
    return replace(cloud(), points=points, mesh=triangles)


def drawn_mesh() -> Fixture:
    """Two triangles of 24 mm as they were drawn, to be sampled where points are rendered."""
    corners = 0.024 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float)
    triangles = np.array([[0, 1, 2], [1, 3, 2]], dtype=np.int32)
    return replace(cloud(), points=corners, mesh=triangles, sample_radius=0.0015)


def pieces(line: int = 10, arc: int = 7, circle: int = 16) -> Fixture:
    """A line that goes on in a quarter circle, and a circle, with as many points on each."""
    along = np.linspace(0.40, 0.43, line + 1)[:-1]
    quarter = np.linspace(-np.pi / 2, 0, arc)
    ring = np.linspace(0, 2 * np.pi, circle, endpoint=False)
    x = np.concatenate([along, 0.43 + 0.01 * np.cos(quarter), 0.46 + 0.008 * np.cos(ring)])
    y = np.concatenate([0 * along, 0.01 + 0.01 * np.sin(quarter), 0.04 + 0.008 * np.sin(ring)])
    vertices = [(0.40, 0), (0.43, 0), (0.44, 0.01), (0.468, 0.04), (0.452, 0.04)]
    closed = np.array([False, True])
    drawn = Pieces(
        vertices=np.array([(*vertex, 0.1) for vertex in vertices]),
        bulges=np.array([0, np.tan(np.pi / 8), 0, 1, 1]),
        stroke=np.array([0, 0, 0, 1, 1], np.int32),
        closed=closed,
        error=1e-9,
    )
    stroke = np.repeat([0, 1], [line + arc, circle]).astype(np.int32)
    return replace(
        cloud(),
        points=np.column_stack([x, y, np.full_like(x, 0.1)]),
        curve=Curve(stroke, closed, pieces=drawn),
        rendering=replace(cloud().rendering, ignore_axis=AXIS),
    )


def mirrored_pieces() -> Fixture:
    """The same seen in a mirror: all arcs turn right."""
    base = pieces()
    curve = base.curve
    assert curve is not None
    assert curve.pieces is not None
    mirror = np.array([1.0, -1.0, 1.0])
    drawn = replace(
        curve.pieces, vertices=curve.pieces.vertices * mirror, bulges=0.0 - curve.pieces.bulges
    )
    return replace(base, points=base.points * mirror, curve=replace(curve, pieces=drawn))


def guided() -> Fixture:
    """The curve, whose closed stroke guides and whose open one is forbidden."""
    return replace(curve(), guidance=Guidance(radius=1e-3, stiffness=800.0, ends="stop", stroke=1))


def findings() -> Fixture:
    """The registered curve with an answered doubt, an open one and a note."""
    found = (
        doubt("end-other-colour", "extract", "Other ink lies here.", place_px=(318.5, 400.0)),
        note("bridge-short", "plan", "A gap was bridged.", place_m=(0.41, 0.0, 0.1)),
        replace(
            doubt("marker-suspect", "register", "Marker b is far away."),
            answered_by="A. Planner",
            answered_utc=TIME,
        ),
    )
    return replace(registered(), findings=found)


def reviewed() -> Fixture:
    """The registered curve, approved by a person."""
    return replace(registered(), reviewed=Review("A. Planner", TIME, "0f" * 32))
