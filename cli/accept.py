"""`vfplan accept`: a script's way to approve what somebody saw on the review sheet."""

from __future__ import annotations

import click
from vfplan.cli.next_commands import sign_command
from vfplan.cli.options import FIXTURE, option, options_in_order, output_option
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, command


@command("accept")
@FIXTURE
@options_in_order(
    option("--digest", required=True, metavar="DIGEST",
           help="The 64 hexadecimal digits on the sheet that the person looked at."),
    option("--by", required=True, metavar="NAME", help="Name of the person who looked at it."),
    option("--answer", "answers", multiple=True, metavar="CODE",
           help="Answer the findings of this code; repeatable."),
    option("--answer-all", is_flag=True, help="Answer every finding."),
    output_option("Write the accepted bundle to this file."),
)  # fmt: skip
def vfplan_accept(fixture, output, digest, by, answers, answer_all) -> CommandResult:
    """Accept FIXTURE.h5 by the digest on its review sheet, and write it with name and time.

    The command refuses the digest of another plan, and a finding without an answer (exit 1).
    """
    from vfplan.bundle import read_sealed, write_fixture
    from vfplan.review.acceptance import accept

    if answers and answer_all:
        raise click.UsageError("--answer and --answer-all exclude each other. Give one")
    before, seal = read_sealed(fixture)
    accepted = accept(before, digest, by, answers=answers, answer_all=answer_all)
    with outputs(output) as (path,):
        write_fixture(accepted, path)
    answered = [finding.code for finding in accepted.findings if finding not in before.findings]
    data = {
        "output": str(output),
        "digest": accepted.reviewed.digest,
        "by": by,
        "answered": answered,
    }
    return CommandResult(
        data, f"wrote {output}", findings=accepted.findings,
        verdict=f"accepted by {by}",
        next_step=sign_command(output, case=seal.case, robot_serial=seal.robot_serial),
    )  # fmt: skip
