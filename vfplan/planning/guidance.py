"""A planned curve as a guide: the tube it allows, and whether it leads into what is forbidden."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from vfplan.errors import CheckFailed, SettingError
from vfplan.findings import Finding, doubt
from vfplan.fixture import Fixture, Guidance
from vfplan.planning.settings import FixtureSettings


def add_guidance(
    fixture: Fixture, settings: FixtureSettings
) -> tuple[Fixture, dict[str, Any], tuple[Finding, ...]]:
    """The fixture with the guidance that was asked for, its part of the report, and findings.

    Raises SettingError: a tube that runs into itself or is wider than a bend, or a stroke that is
        not there
    Raises CheckFailed: the guide leads into the forbidden region of the other strokes; the message
        has the place
    """
    from vfplan.engine.guide import Guide

    stroke = settings.guide_stroke
    if fixture.curve is None or not len(fixture.curve.closed):
        raise SettingError(
            "a guide needs a drawn curve; this fixture is a surface or a cloud. Leave --guide out",
            code="guide-without-curve",
        )
    stroke_count = len(fixture.curve.closed)
    if stroke is not None and stroke_count == 1:
        raise SettingError(
            f"guide stroke {stroke}: the curve is one stroke, which guides without it. Leave "
            "--guide-stroke out",
            code="guide-stroke",
        )
    if stroke is not None and not 0 <= stroke < stroke_count:
        raise SettingError(
            f"guide stroke {stroke} is not among the {stroke_count} strokes. Give 0 to "
            f"{stroke_count - 1}, or leave it out and all guide",
            code="guide-stroke",
        )
    guiding = fixture.curve.closed
    if stroke is not None:
        guiding = guiding[[stroke]]
    if settings.guide_ends is not None and guiding.all():
        raise SettingError(
            "a closed curve has no ends that could stop or let go. Leave --ends out",
            code="guide-ends",
        )
    guidance = Guidance(
        settings.guide_m, min(settings.stiffness), settings.guide_ends or "stop", stroke,
        *settings.guide_pull,
    )  # fmt: skip
    fixture = replace(fixture, guidance=guidance)
    # The finding below says what the guide warns of.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        guide = Guide.of(fixture, cut_bends=settings.guide_cut_bends)
    report = {
        "radius_m": guidance.radius,
        "stiffness_n_per_m": guidance.stiffness,
        "ends": guidance.ends,
        "lead_force_n": guidance.lead_force or 0.0,
        "lengths_m": guide.lengths_m,
    }
    findings = []
    if guide.tight_bend:
        findings.append(doubt("guide-tight-bend", "plan", guide.tight_bend))
    if stroke is not None:
        report["stroke"] = stroke
        report["clearance_min_m"], overlap = clearance(fixture, guide)
        findings += overlap
    return fixture, {"guide": report}, tuple(findings)


def clearance(fixture: Fixture, guide: Any) -> tuple[float, list[Finding]]:
    """The smallest distance [m] between the guide's curve and the proxy's forbidden positions.

    Raises CheckFailed: the curve itself is forbidden somewhere
    """
    from vfplan.engine.proxy import ProxyEngine

    radius = fixture.contact_radius + fixture.point_radius
    region = ProxyEngine.of(fixture.region, offline=True)
    step = min(guide.radius, 0.1 * radius)
    arcs = np.linspace(0, guide.lengths_m[0], 2 + int(guide.lengths_m[0] / step))
    places = guide.at(arcs)
    clearances = region.distance(places) - radius
    worst = int(clearances.argmin())
    smallest = float(clearances[worst])
    x, y, z = 1e3 * places[worst]
    where = f"at arc {1e3 * arcs[worst]:.4g} mm, [{x:.4g}, {y:.4g}, {z:.4g}] mm"
    if smallest < 0:
        raise CheckFailed(
            f"the guide leads into the forbidden region: {where}, it comes within "
            f"{1e3 * (smallest + radius):.4g} mm, and R = {1e3 * radius:g} mm is the least. "
            "Draw it further away, or give a smaller --contact-radius",
            code="guide-forbidden",
            numbers={"distance_m": smallest + radius, "allowed_m": radius},
        )
    if smallest >= guide.radius:
        return smallest, []
    text = (
        f"The guide's tube of {1e3 * guide.radius:g} mm reaches into the forbidden region "
        f"{where}: {1e3 * smallest:.4g} mm are free there, and both forces act. Give a "
        "narrower --guide."
    )
    place = tuple(places[worst].tolist())
    return smallest, [doubt("guide-in-forbidden", "plan", text, place_m=place)]
