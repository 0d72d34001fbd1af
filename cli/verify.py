"""`vfplan verify`: does a trusted key vouch for this bundle?"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from vfplan.cli.options import FIXTURE, signature, trust
from vfplan.cli.run import Report, command

from vfplan.fixture import Fixture


@command("verify")
@FIXTURE
@signature("--keys", required=True)
def command(fixture, **given) -> Report:
    """Check that FIXTURE.h5 is sound and signed by a trusted key; exit 4 if it is not."""
    from vfplan.bundle import read_sealed

    signed, seal = read_sealed(fixture, trust=trust(given))
    reviewed = None if signed.reviewed is None else asdict(signed.reviewed)
    data = {
        **seal.describe(),
        "ok": True,
        "findings": [finding.as_dict() for finding in signed.findings],
        "reviewed": reviewed,
    }
    lines = [f"sound, signed by key {data['key_id']}", *seal_lines(data)]
    lines += finding_lines(data["findings"], reviewed)
    if seal.despite_findings:
        lines.append(f"  {'but':<11} signed although {_why_despite(signed)}")
    return Report(data, "\n".join(lines))


def _why_despite(signed: Fixture) -> str:
    """What should have kept somebody from signing."""
    reasons = []
    if signed.open_findings:
        reasons.append("findings were not answered")
    if signed.reviewed is None:
        reasons.append("nobody had reviewed it")
    return " and ".join(reasons)


def seal_lines(seal: dict[str, Any]) -> list[str]:
    """What a signature is for: case, robot and time, a line each that is there."""
    names = {"case": "case", "robot_serial": "robot", "signed_utc": "time"}
    return [f"  {word:<11} {seal[name]}" for name, word in names.items() if name in seal]


def finding_lines(findings: list[dict[str, Any]], reviewed: dict[str, str] | None) -> list[str]:
    """Who reviewed the plan, and what was found, a line each."""
    lines = []
    if reviewed is None:
        lines.append("  reviewed    by nobody")
    else:
        lines.append(f"  reviewed    by {reviewed['by']}, {reviewed['utc']}")
    for finding in findings:
        line = f"  {finding['severity']:<11} {finding['code']}: {finding['text']}"
        if finding["answered_by"] is not None:
            line += f" (accepted by {finding['answered_by']}, {finding['answered_utc']})"
        elif finding["severity"] == "doubt":
            line += " (not answered)"
        lines.append(line)
    return lines
