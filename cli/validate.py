"""`vfplan validate`: everything that is wrong with a bundle."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict

import click
from vfplan.cli.run import Report, command
from vfplan.cli.values import FILE


@command("validate")
@click.argument("fixture", type=FILE, metavar="FILE.h5")
def command(fixture) -> Report:
    """List every issue of FILE.h5, not the first one only; exit 1 if any is an error."""
    from vfplan.bundle import validate

    issues = validate(fixture)
    valid = not any(issue.severity == "error" for issue in issues)
    lines = [f"{i.severity}: {i.location}: {i.message} [{i.code}]" for i in issues]
    counts = Counter(issue.severity for issue in issues)
    grave = [(severity, counts[severity]) for severity in ("error", "warning", "note")]
    found = ", ".join(f"{n} {severity}{'s' * (n > 1)}" for severity, n in grave if n) or "no issues"
    lines.append(f"{fixture} is {'valid' if valid else 'NOT valid'}: {found}")
    data = {"valid": valid, "issues": [asdict(issue) for issue in issues]}
    failed = "" if valid else f"{fixture} is NOT valid: {found}"
    if valid:
        verdict, next_step = "valid", "vfplan review FIXTURE.h5 shows what it holds"
    else:
        verdict, next_step = "not valid", "make the bundle anew; a robot refuses this one"
    return Report(data, "\n".join(lines), failed=failed, verdict=verdict, next_step=next_step)
