"""`vfplan info`: a page about a bundle."""

from __future__ import annotations

from typing import Any

from vfplan.cli.options import FIXTURE, option
from vfplan.cli.run import Report, command
from vfplan.cli.telling import told
from vfplan.cli.verify import finding_lines, seal_lines

LINES = (
    "{format} {version}, frame {frame}, {points} points",
    "\n  made        {/provenance@created_utc} by {/provenance@software}",
    "\n  seal        {sound}, {signed}",
    "\n  curve       strokes {strokes}, of them closed {closed}",
    "\n  mesh        {/mesh/triangles[shape][0]} triangles",
    "\n  rendering   K {k} N/m, R {radius_m:mm.6g}",
    ", rule {work[rule]}, a tick at most {work[us]:.0f} us (given {work[at_most_us]:.0f})",
    "\n  rendered as {pieces} lines and arcs within {/pieces@error_m:um.3g} of the curve",
    "\n  guide       along {which}, tube {/guidance@radius_m:mm.6g}, K "
    "{/guidance@stiffness_n_per_m:g} N/m, ends {/guidance@ends}{led}",
    "\n  registered  {/registration@model}, {markers} markers, FRE {/registration@fre_rms_m:mm}",
    ", predicted TRE {/registration@tre_rms_m:mm} rms",
)
CERTIFIED = (
    "\n  leak        none: largest opening {/leak@largest_m:mm}, allowed {/leak@limit_m:mm}",
    "\n              but an open sheet: {/leak@open_edges} rim edges",
)
BARE = ("\n  leak        not certified: a bare cloud, points up to {/leak@largest_m:mm} apart",)


@command("info")
@FIXTURE
@option("--all", "everything", is_flag=True, help="Every attribute and table of the file.")
@option("--values", is_flag=True, help="In --json, the per-point tables in full too.")
def command(fixture, everything, values) -> Report:
    """Show what FIXTURE.h5 holds, in about ten lines; with --all, all of it.

    `--json` always holds all of it.
    """
    from vfplan.bundle import describe

    data = describe(fixture, values=values, work=True)
    return Report(data, _page(data) if everything else _summary(data))


def _summary(data: dict[str, Any]) -> str:
    """Frame, size, curve, rendering, registration, leak and seal: a line each that is there."""
    seal, work, closed = data["seal"], data.get("tick_work"), data.get("/curve/closed", ())
    more: dict[str, Any] = {
        "sound": "sound" if seal["ok"] else "broken",
        "signed": f"signed by {seal['key_id']}" if seal["signed"] else "not signed",
        "led": _led(data.get("/guidance@lead_force_n"), data.get("/guidance@lead_speed_m_s")),
        "which": "the curve",
    }
    if len(closed):
        more |= {"strokes": len(closed), "closed": sum(map(bool, closed))}
    if "/guidance@stroke" in data:
        more["which"] = f"stroke {data['/guidance@stroke']}"
    if "/rendering/stiffness" in data:
        more["k"] = ", ".join(f"{k:g}" for k in data["/rendering/stiffness"])
        more["radius_m"] = data["/rendering@contact_radius_m"] + data["/rendering@point_radius_m"]
        more |= {"work": work} if work["us"] is not None else {}
    if "/pieces/vertices" in data:
        more["pieces"] = len(data["/pieces/bulges"]) - sum(not c for c in closed)
    if "/registration/source" in data:
        more["markers"] = len(data["/registration/source"])
    leak = CERTIFIED if "/leak@limit_m" in data else BARE
    lines = [told(data | more, *LINES, *leak), *seal_lines(seal)]
    if "/rendering/stiffness" in data or data["findings"]:
        lines += finding_lines(data["findings"], data["reviewed"])
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
