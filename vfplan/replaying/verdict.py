"""How a replay ended: "pass", "fail", or "not-tested" where the tool never touched the fixture."""

from __future__ import annotations

from typing import Any


def has_touched(report: dict[str, Any]) -> bool:
    """Whether the fixture did anything: it pushed the tool, or a guide had hold of the tip.

    report: as `Metrics.report` gives it
    """
    return report["contact_ticks"] > 0 or report.get("arc_m") is not None


def gap_words(report: dict[str, Any]) -> str:
    """What a "pass" leaves open, to stand after it; empty where the recording has no gap.

    In a session that was resampled lines fill the gaps, so those of the recording count.
    """
    session = report["session"]
    recorded = session.get("recorded", session)
    if not recorded["gaps"]:
        return ""
    return f", but nothing is known of {recorded['gap_s']:.3g} s without samples"


def change_words(report: dict[str, Any]) -> str:
    """That a "pass" is of another fixture than the recording's, to stand after it; else empty."""
    codes = [finding["code"] for finding in report["findings"]]
    if "session-changes" not in codes:
        return ""
    return ", but the fixture moved or changed during the recording, and here it did not"


def verdict_of(report: dict[str, Any], checks: list[dict[str, Any]]) -> str:
    """How a replay ended: "pass", "fail" or "not-tested".

    A replay passes if every limit holds and the tool touched the fixture. Limits that hold because
    the tool stayed away, and a replay without limits, test nothing. A verdict speaks of the ticks
    that were recorded; `gap_words` says what it leaves open.
    """
    if any(not check["pass"] for check in checks):
        return "fail"
    return "not-tested" if not checks or not has_touched(report) else "pass"
