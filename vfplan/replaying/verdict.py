"""How a replay ended: "pass", "fail", or "not-tested" where the tool never touched the fixture."""

from __future__ import annotations

from typing import Any


def has_touched(report: dict[str, Any]) -> bool:
    """Whether the fixture did anything: it pushed the tool, or a guide had hold of the tip.

    report: as `Metrics.report` gives it
    """
    return report["contact_ticks"] > 0 or report.get("arc_m") is not None


def verdict_of(report: dict[str, Any], checks: list[dict[str, Any]]) -> str:
    """How a replay ended: "pass", "fail" or "not-tested".

    A replay passes if every limit holds and the tool touched the fixture. Limits that hold because
    the tool stayed away, and a replay without limits, test nothing.
    """
    if any(not check["pass"] for check in checks):
        return "fail"
    if not checks or not has_touched(report):
        return "not-tested"
    return "pass"
