"""`vfplan info`: a page about a bundle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vfplan.cli.options import FIXTURE, option
from vfplan.cli.run import Report, command


@command("info")
@FIXTURE
@option("--all", "everything", is_flag=True, help="Every attribute and table of the file.")
@option("--values", is_flag=True, help="In --json, the per-point tables in full too.")
def command(fixture: Path, everything: bool, values: bool) -> Report:
    """Show what FIXTURE.h5 holds, in about ten lines; with --all, all of it.

    `--json` always holds all of it.
    """
    from vfplan.bundle import describe

    data = describe(fixture, values=values, work=True)
    return Report(data, _page(data) if everything else _summary(data))


def _summary(data: dict[str, Any]) -> str:
    """Frame, size, curve, rendering, registration, leak and seal: a line each that is there."""
    seal = data["seal"]
    signed = f"signed by {seal['key_id']}" if seal["signed"] else "not signed"
    lines = [
        f"{data['format']} {data['version']}, frame {data['frame']}, {data['points']} points",
        f"  made        {data['/provenance@created_utc']} by {data['/provenance@software']}",
        f"  seal        {'sound' if seal['ok'] else 'broken'}, {signed}",
    ]
    if "/curve/closed" in data:
        closed = [bool(c) for c in data["/curve/closed"]]
        lines.append(f"  curve       strokes {len(closed)}, of them closed {sum(closed)}")
    if "/mesh/triangles" in data:
        lines.append(f"  mesh        {data['/mesh/triangles']['shape'][0]} triangles")
    if "/rendering/stiffness" in data:
        stiffness = ", ".join(f"{k:g}" for k in data["/rendering/stiffness"])
        radius = data["/rendering@contact_radius_m"] + data["/rendering@point_radius_m"]
        line = f"  rendering   K {stiffness} N/m, R {1e3 * radius:g} mm"
        work = data["tick_work"]
        if work["us"] is not None:
            line += f", rule {work['rule']}, a tick at most {work['us']:.0f} us"
            line += f" (given {work['at_most_us']:.0f})"
        lines.append(line)
    if "/pieces/vertices" in data:
        error = 1e6 * data["/pieces@error_m"]
        count = len(data["/pieces/bulges"]) - sum(not closed for closed in data["/curve/closed"])
        lines.append(f"  rendered as {count} lines and arcs within {error:.3g} um of the curve")
    if "/guidance@radius_m" in data:
        which = f"stroke {data['/guidance@stroke']}" if "/guidance@stroke" in data else "the curve"
        lines.append(
            f"  guide       along {which}, tube {1e3 * data['/guidance@radius_m']:g} mm, K "
            f"{data['/guidance@stiffness_n_per_m']:g} N/m, ends {data['/guidance@ends']}"
            + _led(data.get("/guidance@lead_force_n"), data.get("/guidance@lead_speed_m_s"))
        )
    if "/registration@model" in data:
        line = (
            f"  registered  {data['/registration@model']}, {len(data['/registration/source'])} "
            f"markers, FRE {1e3 * data['/registration@fre_rms_m']:.3f} mm"
        )
        if "/registration@tre_rms_m" in data:
            line += f", predicted TRE {1e3 * data['/registration@tre_rms_m']:.3f} mm rms"
        lines.append(line)
    if "/leak@limit_m" in data:
        gap, limit = (1e3 * data[f"/leak@{name}_m"] for name in ("largest", "limit"))
        lines.append(f"  leak        none: largest opening {gap:.3f} mm, allowed {limit:.3f} mm")
        if "/leak@open_edges" in data:
            lines.append(f"              but an open sheet: {data['/leak@open_edges']} rim edges")
    elif "/leak@largest_m" in data:
        gap = 1e3 * data["/leak@largest_m"]
        lines.append(f"  leak        not certified: a bare cloud, points up to {gap:.3f} mm apart")
    return "\n".join(lines)


def _page(data: dict[str, Any]) -> str:
    lines = [f"{data['format']} {data['version']}, frame {data['frame']}, {data['points']} points"]
    lines += [f"  {path} = {_short(value)}" for path, value in data.items() if path[0] == "/"]
    return "\n".join(lines)


def _short(value: Any) -> str:
    if isinstance(value, dict):
        shape = " x ".join(map(str, value["shape"]))
        return f"{shape}, from {value['min']:.6g} to {value['max']:.6g}"
    return str(value.tolist() if hasattr(value, "tolist") else value)


def _led(force: float | None, speed: float | None) -> str:
    if force is None:
        return ""
    from vfplan.planning.settings import LEAD_SPEED_M_S

    most = LEAD_SPEED_M_S if speed is None else speed
    return f", led by {force:g} N up to {1e3 * most:g} mm/s"
