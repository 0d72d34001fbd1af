"""`vfplan keygen`, `sign` and `verify`: who vouches for a bundle; `accept`: who looked at it."""

from __future__ import annotations

from dataclasses import asdict

import click
from vfplan.cli import options
from vfplan.cli.next_commands import public_key_of, review_command, sign_command, verify_command
from vfplan.cli.options import FILE, FIXTURE, option, options_in_order, output_option
from vfplan.cli.outputs import is_overwriting, outputs
from vfplan.cli.run import CommandResult, command, command_line

from vfplan.display import Report, quoted, wrote
from vfplan.errors import CheckFailed
from vfplan.findings import acceptance


@command("sign")
@FIXTURE
@options_in_order(
    option("--key", type=FILE, required=True, metavar="KEY",
           help="Sign with this private key, from `vfplan keygen`."),
    option("--case", metavar="CASE",
           help="Sign it for this case only.  [default: as before]"),
    option("--robot-serial", metavar="SERIAL",
           help="Sign it for this robot only.  [default: as before]"),
    option("--registered-at", "registered_utc", metavar="UTC",
           help="Count the age of the bundle from this time, when the patient was registered, e.g. "
           "2026-01-31T12:00:00Z.  [default: now]"),
    option("--despite-findings", is_flag=True,
           help="Sign it even with open findings or without a review. The seal says so."),
    output_option("Write the signed bundle to this file."),
)  # fmt: skip
def vfplan_sign(fixture, output, key, **arguments) -> CommandResult:
    """Check FIXTURE.h5 and write it again with a signature.

    The signature covers every byte of the bundle, the time, and the case and the robot if they are
    given. The command refuses a bundle that nobody reviewed, or with findings that nobody answered
    (exit 1).
    """
    from vfplan.bundle.read import read_fixture
    from vfplan.bundle.seal import sign
    from vfplan.review.rendered import in_one_line

    for name in ("case", "robot_serial"):
        if arguments[name] == "":
            raise click.UsageError(
                f"--{name.replace('_', '-')} is empty. Give one, or leave it out"
            )
        arguments[name] = arguments[name] or ""
    with outputs(output) as (path,):
        seal = sign(fixture, path, key, **arguments)
        renders = in_one_line(read_fixture(path))
    return CommandResult(
        {"output": str(output), **seal, "renders": renders},
        f"{wrote(output)}\n  renders     {renders}",
        verdict=f"signed with key {seal['key_id']}",
        next_step=verify_command(output, public_key_of(key), seal),
    )  # fmt: skip


@command("verify")
@FIXTURE
@options.signature_options("--keys", required=True)
def vfplan_verify(fixture, **arguments) -> CommandResult:
    """Check that FIXTURE.h5 is sound and signed by a trusted key (exit 4 if it is not)."""
    from vfplan.bundle.read import read_sealed
    from vfplan.review.rendered import in_one_line

    signed, seal = read_sealed(fixture, trust=options.trust(arguments))
    warnings = options.not_compared(seal, arguments)
    data = {
        **seal,
        "renders": in_one_line(signed),
        "not_compared": list(warnings),
        "findings": [finding.as_dict() for finding in signed.findings],
        "reviewed": signed.reviewed and asdict(signed.reviewed),
    }
    lines = [f"sound, signed by key {data['key_id']}", f"  renders     {data['renders']}"]
    lines += seal_lines(data)
    lines += finding_lines(data)
    verdict = "signed by a trusted key"
    next_step = "load it on the robot"
    if warnings:
        words = " and ".join(warnings).replace("_", " ")
        verdict = f"signed by a trusted key, but its {words} was compared with nothing"
        missing = [options.SIGNED_FOR[name] for name in warnings]
        next_step = f"say what it must be for: {' '.join([command_line(), *missing])}"
    if "despite_findings" in seal:
        lacks = {"findings were not answered": signed.open_findings,
                 "nobody had reviewed it": not signed.reviewed}  # fmt: skip
        reason = " and ".join(filter(lacks.get, lacks))
        lines.append(f"  {'but':<11} signed although {reason}")
        verdict = f"signed by a trusted key, although {reason}"
        next_step = "ask who signed it why, before a robot loads it"
    return CommandResult(
        data, "\n".join(lines), warnings=list(warnings.values()), verdict=verdict,
        next_step=next_step,
    )  # fmt: skip


def seal_lines(seal: Report) -> list[str]:
    """What a signature is for: case, robot and time, where they are given."""
    words = ("case", "case"), ("robot_serial", "robot"), ("signed_utc", "time")
    return [f"  {word:<11} {seal[name]}" for name, word in words if name in seal]


def finding_lines(data: Report) -> list[str]:
    """Who reviewed the plan, and its findings, a line each."""
    reviewed = data["reviewed"]
    who = "nobody" if reviewed is None else f"{reviewed['by']}, {reviewed['utc']}"
    lines = [f"  reviewed    by {who}"]
    for finding in data["findings"]:
        line = f"  {finding['severity']:<11} {finding['code']}: {finding['text']}"
        if finding["answered_by"] is not None:
            line += acceptance(finding["answered_by"], finding["answered_utc"])
        elif finding["severity"] == "doubt":
            line += " (not answered)"
        lines.append(line)
    return lines


@command("keygen")
@output_option(
    "Write the private key to this file, and the public key beside it with the suffix .pub.",
    kind=options.OutputFile(),
)
def vfplan_keygen(output) -> CommandResult:
    """Make an Ed25519 key pair: a private key to sign with, and a public key for the robots."""
    from vfplan.bundle.seal import keygen

    public, key_id = keygen(output, overwrite=is_overwriting())
    return CommandResult(
        {"private_key": str(output), "public_key": str(public), "key_id": key_id},
        f"{wrote(output)} and {quoted(public)}", verdict=f"made key {key_id}",
        next_step=f"keep {quoted(output)} secret, give {quoted(public)} to the robots, and sign: "
        f"vfplan sign FIXTURE.h5 --key {quoted(output)} -o SIGNED.h5",
    )  # fmt: skip


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
    from vfplan.bundle.read import read_sealed
    from vfplan.bundle.write import write_fixture
    from vfplan.review.rendered import accept

    if answers and answer_all:
        raise click.UsageError("--answer and --answer-all exclude each other. Give one")
    before, seal = read_sealed(fixture)
    try:
        accepted = accept(before, digest, by, answers=answers, answer_all=answer_all)
    except CheckFailed as error:
        if error.code == "digest-other":
            image = fixture.parent if "image" in before.provenance.inputs else None
            error.message += f": {review_command(fixture, image, has_page=False)}"
        raise
    with outputs(output) as (path,):
        write_fixture(accepted, path)
    answered = [finding.code for finding in accepted.findings if finding not in before.findings]
    data = {
        "output": str(output), "digest": digest.lower(), "by": by, "answered": answered,
        "review_digest": accepted.reviewed.digest,
    }  # fmt: skip
    return CommandResult(
        data, wrote(output), findings=accepted.findings,
        verdict=f"accepted by {by}",
        next_step=sign_command(output, {"case": accepted.case, **seal}),
    )  # fmt: skip
