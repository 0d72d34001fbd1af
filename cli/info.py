"""`vfplan info`: a page about a bundle."""

from __future__ import annotations

from typing import Any

from vfplan.cli.next_commands import approval_command
from vfplan.cli.options import FIXTURE, option
from vfplan.cli.run import CommandResult, command
from vfplan.cli.units import millimetres
from vfplan.cli.verify import finding_lines, seal_lines


@command("info")
@FIXTURE
@option("--all", "everything", is_flag=True, help="Print every attribute and table of the file.")
@option("--values", is_flag=True, help="Put the whole tables into --json.")
def vfplan_info(fixture, everything, values) -> CommandResult:
    """Show what FIXTURE.h5 holds, in about ten lines. With --all, show all of it.

    `--json` always has all of it.
    """
    from vfplan.bundle import describe

    data = describe(fixture, values=values, work=True)
    text = full_text(data) if everything else summary_text(data)
    verdict = "broken seal"
    next_step = "make the bundle anew; a robot refuses this one"
    if data["seal"]["ok"]:
        verdict = "sound, signed" if data["seal"]["signed"] else "sound, not signed"
        image = "IMAGE" if any(path.startswith("/image@") for path in data) else None
        next_step = approval_command(
            fixture,
            data["seal"],
            is_reviewed=data["reviewed"] is not None,
            image=image,
            has_page="/curve/stroke" in data and "/mesh/triangles" not in data,
        )
    return CommandResult(data, text, verdict=verdict, next_step=next_step, verdict_in_json=False)


def summary_text(data: dict[str, Any]) -> str:
    """Frame, size, curve, rendering, registration, leak and seal, where they are there."""
    lines = [f"{data['format']} {data['version']}, frame {data['frame']}, {data['points']} points"]
    lines.append(
        f"  made        {data['/provenance@created_utc']} by {data['/provenance@software']}"
    )
    seal = data["seal"]
    line = "  seal        broken" if not seal["ok"] else "  seal        sound"
    if seal["signed"]:
        line += f", signed by {seal['key_id']}"
    else:
        line += ", not signed"
    lines.append(line)

    # The geometry.
    closed = data.get("/curve/closed", ())
    closed_count = sum(map(bool, closed))
    if len(closed):
        lines.append(f"  curve       strokes {len(closed)}, of them closed {closed_count}")
    if "/mesh/triangles" in data:
        lines.append(f"  mesh        {data['/mesh/triangles']['shape'][0]} triangles")

    # How it is rendered.
    if "/rendering/stiffness" in data:
        stiffness = ", ".join(f"{k:g}" for k in data["/rendering/stiffness"])
        radius_m = data["/rendering@contact_radius_m"] + data["/rendering@point_radius_m"]
        line = f"  rendering   K {stiffness} N/m, R {1e3 * radius_m:.6g} mm, "
        work = data["tick_work"]
        if work["us"] is None:
            line += "but no engine renders it"
        else:
            line += (
                f"rule {work['rule']}, a tick takes at most {work['us']:.0f} us "
                f"({work['at_most_us']:.0f} us are allowed)"
            )
        lines.append(line)
    if "/pieces/vertices" in data:
        pieces = len(data["/pieces/bulges"]) - (len(closed) - closed_count)
        error_um = 1e6 * data["/pieces@error_m"]
        lines.append(f"  rendered as {pieces} lines and arcs within {error_um:.3g} µm of the curve")
    if "/guidance@radius_m" in data:
        which = f"stroke {data['/guidance@stroke']}" if "/guidance@stroke" in data else "the curve"
        line = (
            f"  guide       along {which}, tube {1e3 * data['/guidance@radius_m']:.6g} mm, K "
            f"{data['/guidance@stiffness_n_per_m']:g} N/m, ends {data['/guidance@ends']}"
        )
        force_n = data.get("/guidance@lead_force_n")
        if force_n is not None:
            from vfplan.planning.settings import LEAD_SPEED_M_S

            speed_m_s = data.get("/guidance@lead_speed_m_s", LEAD_SPEED_M_S)
            line += f", led by {force_n:g} N up to {1e3 * speed_m_s:g} mm/s"
        lines.append(line)

    # Where it lies, and what may slip through.
    if "/registration/source" in data:
        line = (
            f"  registered  {data['/registration@model']}, {len(data['/registration/source'])} "
            f"markers, FRE {millimetres(data['/registration@fre_rms_m'])}"
        )
        if "/registration@tre_rms_m" in data:
            line += f", predicted TRE {millimetres(data['/registration@tre_rms_m'])} rms"
        lines.append(line)
    if "/leak@limit_m" in data:
        lines.append(
            f"  leak        none: largest opening {millimetres(data['/leak@largest_m'])}, allowed "
            f"{millimetres(data['/leak@limit_m'])}"
        )
        if "/leak@open_edges" in data:
            lines.append(f"              but an open sheet: {data['/leak@open_edges']} rim edges")
    elif "/leak@largest_m" in data:
        lines.append(
            "  leak        not certified: a bare cloud, points up to "
            f"{millimetres(data['/leak@largest_m'])} apart"
        )

    # Who answers for it.
    lines += seal_lines(seal)
    if "/rendering/stiffness" in data or data["findings"]:
        lines += finding_lines(data["findings"], data["reviewed"])
    return "\n".join(lines)


def full_text(data: dict[str, Any]) -> str:
    """Every attribute and table, a line each; a long table as its shape and range."""
    lines = [f"{data['format']} {data['version']}, frame {data['frame']}, {data['points']} points"]
    for path, value in data.items():
        if path[0] != "/":
            continue
        if isinstance(value, dict):
            shape = " x ".join(map(str, value["shape"]))
            value = f"{shape}, from {value['min']:.6g} to {value['max']:.6g}"
        elif hasattr(value, "tolist"):
            value = value.tolist()
        lines.append(f"  {path} = {value}")
    return "\n".join(lines)
