"""What a person should look at, out of a replay's numbers."""

from __future__ import annotations

from typing import Any

from vfplan.rendering import ProxyParameters

# Rounding in the independent measurement of clearance [m].
_ROUNDING_M = 1e-9


def finding(code: str, severity: str, message: str) -> dict[str, str]:
    """One finding: "info", "warning" or "error"."""
    return {"code": code, "severity": severity, "message": message}


def findings(report: dict[str, Any], parameters: ProxyParameters) -> list[dict[str, str]]:
    """What the numbers of a run say; `report` as `Metrics.report` gives it."""
    found = []
    clearance = report["clearance_min_m"]
    if clearance < -parameters.band - _ROUNDING_M:
        found.append(
            finding(
                "proxy-inside",
                "error",
                f"the proxy came {-clearance:.3g} m inside the fixture; the band is "
                f"{parameters.band:.3g} m",
            )
        )
    if report["inside_ticks"]:
        found.append(
            finding(
                "started-inside",
                "warning",
                f"{report['inside_ticks']} ticks in which the proxy was on its way out of the "
                "fixture",
            )
        )
    if report["too_fast_ticks"]:
        found.append(
            finding(
                "too-fast",
                "warning",
                f"{report['too_fast_ticks']} ticks too fast for rule {parameters.rule!r}",
            )
        )
    active = [e["index"] for e in report["episodes"] if not e["passive"]]
    if active:
        found.append(
            finding(
                "active",
                "warning",
                f"the fixture gave energy beyond the sampling's own in {len(active)} episodes "
                f"(the first is {active[0]})",
            )
        )
    return found
