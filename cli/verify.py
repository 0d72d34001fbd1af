"""`vfplan verify`: does a trusted key vouch for this bundle?"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from vfplan.cli.options import (
    FIXTURE,
    SIGNED_FOR,
    not_compared,
    not_compared_warnings,
    signature_options,
    trust,
)  # fmt: skip
from vfplan.cli.run import CommandResult, command, command_line


@command("verify")
@FIXTURE
@signature_options("--keys", required=True)
def vfplan_verify(fixture, **arguments) -> CommandResult:
    """Check that FIXTURE.h5 is sound and signed by a trusted key (exit 4 if it is not)."""
    from vfplan.bundle import read_sealed

    signed, seal = read_sealed(fixture, trust=trust(arguments))
    reviewed = asdict(signed.reviewed) if signed.reviewed is not None else None
    data = {
        **seal.describe(),
        "ok": True,
        "not_compared": not_compared(seal.describe(), arguments),
        "findings": [finding.as_dict() for finding in signed.findings],
        "reviewed": reviewed,
    }
    lines = [f"sound, signed by key {data['key_id']}", *seal_lines(data)]
    lines += finding_lines(data["findings"], reviewed)
    verdict = "signed by a trusted key"
    next_step = "load it on the robot"
    if data["not_compared"]:
        words = " and ".join(data["not_compared"]).replace("_", " ")
        verdict = f"signed by a trusted key, but its {words} was compared with nothing"
        missing = [SIGNED_FOR[name] for name in data["not_compared"]]
        next_step = f"say what it must be for: {' '.join([command_line(), *missing])}"
    if seal.despite_findings:
        reasons = []
        if signed.open_findings:
            reasons.append("findings were not answered")
        if signed.reviewed is None:
            reasons.append("nobody had reviewed it")
        reason = " and ".join(reasons)
        lines.append(f"  {'but':<11} signed although {reason}")
        verdict = f"signed by a trusted key, although {reason}"
        next_step = "ask who signed it why, before a robot loads it"
    return CommandResult(
        data, "\n".join(lines), warnings=not_compared_warnings(data, arguments), verdict=verdict,
        next_step=next_step,
    )  # fmt: skip


def seal_lines(seal: dict[str, Any]) -> list[str]:
    """What a signature is for: case, robot and time, where they are given."""
    lines = []
    for name, word in (("case", "case"), ("robot_serial", "robot"), ("signed_utc", "time")):
        if name in seal:
            lines.append(f"  {word:<11} {seal[name]}")
    return lines


def finding_lines(findings: list[dict[str, Any]], reviewed: dict[str, str] | None) -> list[str]:
    """Who reviewed the plan, and its findings, a line each."""
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
