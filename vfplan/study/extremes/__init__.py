"""Extreme cases: one table of what must come of each (`table`), and probes that try them."""

from __future__ import annotations

from typing import Any

from vfplan.errors import VfplanError
from vfplan.fixture import Fixture
from vfplan.stability.rows import Row
from vfplan.study.extremes import probes
from vfplan.study.extremes.ground import Ground, of_fixture, patch
from vfplan.study.extremes.table import TABLE, Extreme

__all__ = ["TABLE", "Extreme", "chosen", "try_extreme", "try_group"]

NOT_OF_A_BUNDLE = {
    "cloud": "the bundle's cloud is what it is",
    "setting": "the bundle's settings are what they are",
}
ON_GROUND = {"hip", "long"}  # groups that are tried on the bundle's own points


def chosen(fixture: Fixture | None, full: bool) -> tuple[dict[str, list[Extreme]], dict[str, str]]:
    """The cases to try, by group, and why the others are left out."""
    groups: dict[str, list[Extreme]] = {}
    left_out: dict[str, str] = {}
    for case in TABLE:
        if fixture is not None and case.group in NOT_OF_A_BUNDLE:
            left_out[f"extreme/{case.group}"] = NOT_OF_A_BUNDLE[case.group]
        elif fixture is not None and case.probe == "medial":
            left_out[f"extreme/hip/{case.name}"] = "the bundle is no ring"
        elif case.full and not full:
            left_out[f"extreme/{case.group}/{case.name}"] = "a long run: --full"
        else:
            groups.setdefault(case.group, []).append(case)
    return groups, left_out


def try_group(cases: list[Extreme], fixture: Fixture | None = None) -> list[Row]:
    """The rows of several cases, tried one after the other."""
    ground = patch() if fixture is None else of_fixture(fixture)
    return [] if ground is None else [try_extreme(case, ground) for case in cases]


def try_extreme(case: Extreme, ground: Ground | None = None) -> Row:
    """Try one case and hold what came of it against the table."""
    probe = getattr(probes, case.probe)
    args: dict[str, Any] = dict(case.args)
    if case.group in ON_GROUND and case.probe != "medial":
        args["ground"] = ground or patch()
    name = f"extreme/{case.group}/{case.name}"
    values = {"expected": case.expected}
    try:
        measured = probe(**args)
    except VfplanError as error:
        good = error.kind in case.refusal
        detail = f"expected {case.expected}; refused: {error.kind}: {error.message}"
        return Row(name, "pass" if good else "fail", detail, case.limit, None, case.unit, values)
    if case.limit is None:
        detail = f"expected {case.expected}; was taken, and gave {measured:.3g}"
        return Row(name, "fail", detail, None, None, case.unit, values)
    good = measured <= case.limit  # false on NaN
    detail = f"expected {case.expected}; {measured:.3g} {case.unit}"
    return Row(name, "pass" if good else "fail", detail, case.limit, measured, case.unit, values)
