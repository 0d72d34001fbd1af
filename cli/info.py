"""`vfplan info`, `diff`, `validate` and `view`: what a bundle holds, and what is wrong with it."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path

import click
from vfplan.cli import options
from vfplan.cli.next_commands import approval_command
from vfplan.cli.options import FILE, FIXTURE, OVERWRITE, PNG, option, options_in_order
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, announce_if_slow, command
from vfplan.cli.sign import finding_lines, seal_lines

from vfplan.display import Report, command_of, count, millimetres, or_not, quoted, wrote


@command("info")
@FIXTURE
def vfplan_info(fixture) -> CommandResult:
    """Show what FIXTURE.h5 holds, in about ten lines. With -v, show all of it."""
    from vfplan.bundle.validation import describe

    data = describe(fixture, work=True)
    return CommandResult(
        data, summary_text(data), verdict=f"sound, {or_not(data['seal']['signed'], 'signed')}",
        next_step=approval_command(fixture, data), verdict_in_json=False,
    )  # fmt: skip


def summary_text(data: Report) -> str:
    """Frame, size, rendering, registration, leak and seal, where they are there."""
    seal = data["seal"]
    signed = f"signed by {seal['key_id']}" if seal["signed"] else "not signed"
    lines = [
        f"{data['format']} {data['version']}, frame {data['frame']}, {data['points']} points",
        f"  made        {data['/provenance@created_utc']} by {data['/provenance@software']}",
        f"  seal        sound, {signed}",
    ]

    # How it is rendered.
    if "/rendering/stiffness" in data:
        stiffness = ", ".join(f"{k:g}" for k in data["/rendering/stiffness"])
        radius_m = data["/rendering@contact_radius_m"] + data["/rendering@point_radius_m"]
        work, cost = data["tick_work"], "but no engine renders it"
        if work["us"] is not None:
            cost = (
                f"rule {work['rule']}, a tick takes at most {work['us']:.0f} us "
                f"({work['at_most_us']:.0f} us are allowed)"
            )
        lines.append(f"  rendering   K {stiffness} N/m, R {1e3 * radius_m:.6g} mm, {cost}")
    if "/guidance@radius_m" in data:
        tube_mm, ends = 1e3 * data["/guidance@radius_m"], data["/guidance@ends"]
        stiffness = data["/guidance@stiffness_n_per_m"]
        lines.append(f"  guide       tube {tube_mm:.6g} mm, K {stiffness:g} N/m, ends {ends}")
    # Where it lies, and what may slip through.
    if "/registration/source" in data:
        left_out = [f for f in data["findings"] if f["code"] == "marker-left-out"]
        markers = len(data["/registration/source"])
        used = f"{markers - len(left_out)} of {markers}" if left_out else markers
        line = (
            f"  registered  {data['/registration@model']}, {used} markers, "
            f"FRE {millimetres(data['/registration@fre_rms_m'])}"
        )
        if "/registration@tre_rms_m" in data:
            line += f", predicted TRE {millimetres(data['/registration@tre_rms_m'])} rms"
        lines.append(line)
    if "/leak@largest_m" in data:
        from vfplan.bundle.validation import opening_in_words

        certified = or_not(data["/leak@certified"], "certified")
        lines.append(f"  leak        {data['/leak@kind']}, {certified}: {opening_in_words(data)}")

    # Who answers for it.
    lines += seal_lines(seal)
    if "/rendering/stiffness" in data or data["findings"]:
        lines += finding_lines(data)
    return "\n".join(lines)


def signature_text(seal: Report) -> str:
    """Who signed a bundle for what, but for the time."""
    if not seal["signed"]:
        return "not signed"
    text = f"signed by key {seal['key_id']}"
    for name in options.SIGNED_FOR:
        if name in seal:
            text += f", for {name.replace('_', ' ')} {seal[name]!r}"
    return text


@command("diff")
@click.argument("a", type=FILE, metavar="A.h5")
@click.argument("b", type=FILE, metavar="B.h5")
@click.argument("session", type=FILE, required=False)
def vfplan_diff(a, b, session) -> CommandResult:
    """List what differs between A.h5 and B.h5 (exit 1 if anything does).

    With a SESSION the command replays both and names the first tick in which proxy or force differ.
    The exit code is also 1 if the session touches neither fixture, because that tests nothing.
    """
    from vfplan.bundle.read import read_sealed
    from vfplan.bundle.validation import diff

    # What the files hold.
    differences = diff(a, b)
    data = {"differences": differences}
    lines = []
    for found in differences:
        values = [f"{name} {found[name]}" for name in found if name not in ("path", "what")]
        line = f"{found['path']}: {found['what']}"
        lines.append(f"{line} ({', '.join(values)})" if values else line)
    failed = []
    if differences:
        failed.append(f"{count(len(differences), 'difference')} between {a} and {b}")
    else:
        lines.append("the contents are the same")

    # What they render.
    is_tested = True
    if session is not None:
        comparison, is_tested = compare_replays(a, b, session)
        data |= comparison
        tick = comparison["first_tick"]
        if tick is not None:
            failed.append(f"the first tick that differs is {tick}")
            lines.append(
                f"first tick that differs: {tick}, t = {comparison['first_tick_time_s']:.6g} s; "
                f"at most {comparison['proxy_max_m']:.3g} m and "
                f"{comparison['force_max_n']:.3g} N apart"
            )
        elif is_tested:
            lines.append("both render the session alike")
        if not is_tested:
            failed.append("not tested: the session touches neither fixture")
            lines.insert(0, "NOT TESTED: the session touches neither fixture")
            if "clearance_min_m" in comparison:
                lines.append(f"nearest: {millimetres(comparison['clearance_min_m'], 1)}")

    verdict = "pass"
    next_step = "nothing: either bundle may stand for the other"
    one, other = (signature_text(read_sealed(path)[1]) for path in (a, b))
    if one != other:
        lines.append(f"the signatures differ, which are not compared: A is {one}, B is {other}")
        calls = "; ".join(command_of("info", path) for path in (a, b))
        next_step = f"see when each was signed: {calls}"
    if not is_tested:
        verdict = "not-tested"
        next_step = "give a session that touches the fixtures"
    elif failed:
        verdict = "fail"
        calls = [("info", "-v", path) for path in (a, b)]
        if session is not None:
            calls = [("replay", path, session) for path in (a, b)]
        next_step = "; ".join(command_of(*words) for words in calls)
    # A person reads that they differ; a program, that they do not pass as the same.
    return CommandResult(
        data | {"verdict": verdict}, "\n".join(lines), failed=", ".join(failed),
        verdict=verdict.replace("fail", "differ"), next_step=next_step,
    )  # fmt: skip


def compare_replays(a: Path, b: Path, session: Path) -> tuple[Report, bool]:
    """Where the two replays of a session differ, and whether the tool touched a fixture."""
    from vfplan.replaying.findings import has_touched
    from vfplan.replaying.link import Comparison
    from vfplan.replaying.replay import replay
    from vfplan.session.read import read_session

    recorded = read_session(session)
    first, second = (replay(path, recorded) for path in (a, b))
    comparison = Comparison()
    comparison.update(first.trace, second.trace)
    report = comparison.report()
    tick = report.get("first_difference_tick")
    data = {"first_tick": tick, "ticks": len(recorded.time)}
    data |= {name: report[name] for name in ("proxy_max_m", "force_max_n")}
    if tick is not None:
        data["first_tick_time_s"] = float(recorded.time[tick])
    results = (first.metrics, second.metrics)
    clearances = [result["clearance_min_m"] for result in results if "clearance_min_m" in result]
    if clearances:
        data["clearance_min_m"] = min(clearances)
    return data, any(map(has_touched, results))


@command("validate")
@click.argument("fixture", type=FILE, metavar="FILE.h5")
def vfplan_validate(fixture) -> CommandResult:
    """List everything that is wrong or unusual in FILE.h5.

    The exit code is 1 if anything is an error, and 4 if the review is that of another plan.
    """
    from vfplan.bundle.validation import validate

    issues = validate(fixture)
    severities = Counter(issue.severity for issue in issues)
    valid = severities["error"] == 0
    lines = [f"{i.severity}: {i.location}: {i.message} [{i.code}]" for i in issues]
    told = [name for name in ("error", "warning", "note") if severities[name]]
    summary = ", ".join(count(severities[name], name) for name in told) or "no issues"
    data = {"valid": valid, "issues": [asdict(issue) for issue in issues]}
    lines.append(f"{fixture} is {'valid' if valid else 'NOT valid'}: {summary}")
    if valid:
        next_step = command_of("info", fixture)
        return CommandResult(data, "\n".join(lines), verdict="valid", next_step=next_step)
    exit_code = 4 if any(issue.code == "unsafe.review" for issue in issues) else 1
    return CommandResult(
        data, "\n".join(lines), exit_code, failed=lines[-1], verdict="not valid",
        next_step="make the bundle anew; a robot refuses this one",
    )  # fmt: skip


@command("view")
@FIXTURE
@click.argument("result", type=FILE, required=False, metavar="[RESULT.h5]")
@options_in_order(
    option("--screenshot", type=PNG, metavar="PNG",
           help="Write one view to this picture. It needs no screen."),
    option("--slice", "slice_path", type=FILE, metavar="IMAGE",
           help="Show this slice, on which the curve was drawn (checked by its SHA-256).  "
                "[default: its border only]"),
    OVERWRITE,
)  # fmt: skip
def vfplan_view(fixture, result, screenshot, slice_path) -> CommandResult:
    """Show FIXTURE.h5 in three dimensions.

    With RESULT.h5 (from `vfplan replay -o`) it also shows HIP, proxy, contact sphere and force. The
    window has a time slider. --screenshot needs an OpenGL library (Debian: libosmesa6).
    """
    from vfplan.bundle.read import read_sealed
    from vfplan.images.read import read_slice_of
    from vfplan.review.rendered import check_slice
    from vfplan.session.result import read_result

    planned, seal = read_sealed(fixture)
    ticks = None
    if result is not None:
        ticks, _ = read_result(result, seal["sha256"])
    image = None
    if slice_path is not None:
        image = read_slice_of(planned, slice_path)
        check_slice(planned, image)

    from vfplan import view3d

    with announce_if_slow("trying how pictures can be drawn here"):
        view3d.ready_pyvista(screen=screenshot is None)
    data = {"points": len(planned.points), "files": []}
    if ticks is not None:
        data["ticks"] = len(ticks)
    next_step = command_of("replay", fixture, "SESSION")
    if screenshot is None:
        view3d.show(planned, ticks, image)
        return CommandResult(data, verdict="seen and closed", next_step=next_step)
    with outputs(screenshot) as (picture,):
        view3d.draw_view(planned, picture, ticks=ticks, image=image)
    data["files"] = [str(screenshot)]
    look = f"look at {quoted(screenshot)}"
    return CommandResult(data, wrote(screenshot), verdict="drawn", next_step=look)
