"""`vfplan validate`: everything that is wrong with a bundle."""

from __future__ import annotations

import shlex
from collections import Counter
from dataclasses import asdict

import click
from vfplan.cli.run import CommandResult, command
from vfplan.cli.units import count
from vfplan.cli.values import FILE


@command("validate")
@click.argument("fixture", type=FILE, metavar="FILE.h5")
def vfplan_validate(fixture) -> CommandResult:
    """List everything that is wrong or unusual in FILE.h5 (exit 1 if anything is an error)."""
    from vfplan.bundle import validate

    issues = validate(fixture)
    severities = Counter(issue.severity for issue in issues)
    valid = severities["error"] == 0
    lines = []
    for issue in issues:
        lines.append(f"{issue.severity}: {issue.location}: {issue.message} [{issue.code}]")
    parts = []
    for severity in ("error", "warning", "note"):
        if severities[severity]:
            parts.append(count(severities[severity], severity))
    summary = ", ".join(parts) or "no issues"
    data = {"valid": valid, "issues": [asdict(issue) for issue in issues]}
    if valid:
        lines.append(f"{fixture} is valid: {summary}")
        return CommandResult(
            data, "\n".join(lines), verdict="valid",
            next_step=shlex.join(["vfplan", "info", str(fixture)]),
        )  # fmt: skip
    failed = f"{fixture} is NOT valid: {summary}"
    lines.append(failed)
    return CommandResult(
        data, "\n".join(lines), failed=failed, verdict="not valid",
        next_step="make the bundle anew; a robot refuses this one",
    )  # fmt: skip
