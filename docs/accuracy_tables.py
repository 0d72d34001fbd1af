"""The tables of docs/accuracy.md, made from a bench.json; `scenes` from the paper's figures."""

from __future__ import annotations

from collections.abc import Iterable
from statistics import median
from typing import Any

ENGINES = ("exact", "robust", "paper", "nanoflann_peer", "paper in NumPy", "nearest-point penalty")
RULES = ("exact", "robust", "paper")
SPACING = 0.5e-3


def micrometres(metres: float) -> str:
    """Three digits; below a nanometre it is rounding."""
    value = metres * 1e6
    return "< 0.001" if value < 1e-3 else f"{value:.3g}"


def microseconds(us: float) -> str:
    """Three digits at most, no exponent."""
    return f"{us:.2g}" if us < 10 else f"{us:.0f}"


def of(document: dict[str, Any], **wanted: Any) -> list[dict[str, Any]]:
    """Results whose keys have these values."""
    return [r for r in document["results"] if all(r.get(k) == v for k, v in wanted.items())]


def machine(document: dict[str, Any]) -> str:
    """One line on what it ran on."""
    m = document["machine"]
    return (
        f"Machine: {m['processor']}, {m['cores']} cores, {m['system']}, "
        f"Python {m['python']}, NumPy {m['numpy']}; {document['elapsed_s'] / 60:.1f} minutes for "
        f"{len(document['results'])} results."
    )


def table(head: list[str], rows: Iterable[list[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def names(values: Iterable[str]) -> list[str]:
    """Each once, in order."""
    return list(dict.fromkeys(values))


def runs(document: dict[str, Any]) -> str:
    """How this run was made."""
    words = ["vfplan bench all", "--quick" if document["quick"] else "", "-o DIR"]
    words += [f"--peer ./{p['name']}" for p in document["peers"] if p["ran"]]
    return "```\n$ " + " ".join(w for w in words if w) + "\n```"


def extraction(document: dict[str, Any]) -> str:
    """RMS error and time of each method at scale 1, by drawing."""
    rows = [r for r in of(document, stage="extract") if r["settings"]["scale"] == 1.0]
    methods = names(r["method"] for r in rows)
    lines = []
    for scene in names(r["scene"] for r in rows):
        found = {r["method"]: r for r in rows if r["scene"] == scene}
        cells = [
            f"{found[m]['error_rms']:.3f} px, {found[m]['time_us_median'] / 1e3:.0f} ms"
            if m in found else "refused"
            for m in methods
        ]  # fmt: skip
        lines.append([scene, *cells])
    return table(["drawing", *methods], lines)


def ridges(document: dict[str, Any]) -> str:
    """What `ridge` buys over `skeleton` on the same drawing, and where it was refused or broke."""
    rows = of(document, stage="extract")
    key = lambda r: (r["scene"], r["settings"]["scale"])  # noqa: E731 - reads as what it is
    thin = {key(r): r for r in rows if r["method"] == "skeleton"}
    pairs = [(r, thin[key(r)]) for r in rows if r["method"] == "ridge" and key(r) in thin]
    better = sorted(t["error_rms"] / r["error_rms"] for r, t in pairs)
    dearer = sorted(r["time_us_median"] / t["time_us_median"] for r, t in pairs)
    said = (
        f"On {len(pairs)} drawings `ridge` is {better[0]:.1f} to {better[-1]:.0f} times nearer to "
        f"the true line than `skeleton` (median {median(better):.1f}), in {dearer[0]:.1f} to "
        f"{dearer[-1]:.1f} times its time (median {median(dearer):.1f})."
    )
    refused = [r for r in document.get("refused", ()) if r["stage"] == "extract"]
    where = names(
        f"{r['scene']} at scale {r['settings']['scale']:g} (`{r['method']}`)" for r in refused
    )
    broken = [r for r in rows if r["method"] == "ridge" and r["uncovered_px"] > 5]
    gaps = [
        f"{r['scene']} at scale {r['settings']['scale']:g} ({r['uncovered_px']:.0f} px)"
        for r in broken
    ]
    return (
        f"- {said}\n- Refused: {'; '.join(where) or 'nothing'}.\n"
        f"- More than 5 px of the true line missed by `ridge`: {'; '.join(gaps) or 'nowhere'}."
    )


def sampling(document: dict[str, Any]) -> str:
    """Worst error of the surface over the tolerance it was to keep, and the cost of a tick."""
    rows = [r for r in of(document, stage="sample") if not r.get("chosen")]
    tolerances = sorted(
        {r["settings"]["tolerance_m"] for r in rows if "tolerance_m" in r["settings"]}
    )
    lines = []
    for scene in names(r["scene"] for r in rows):
        for tolerance in (1e-5, tolerances[0]):
            here = {
                r["method"]: r
                for r in rows
                if r["scene"] == scene and r["settings"].get("tolerance_m") == tolerance
            }
            cells = [f"{micrometres(r['error_max'])} µm, {r['points']} points, "
                     f"{microseconds(r['time_us_median'])} µs" for r in here.values()]  # fmt: skip
            lines.append([scene, f"{tolerance * 1e6:g} µm", *cells])
    return table(["curve", "tolerance", "by curvature", "even, by R alone"], lines)


def registration(document: dict[str, Any]) -> str:
    """Target registration error by model, print and number of markers, at 0.2 mm of noise."""
    rows = [r for r in of(document, stage="register") if r["scene"].startswith("0.2 mm")]
    most = max(r["settings"]["markers"] for r in rows)
    columns = [(s, n) for s in names(r["scene"] for r in rows) for n in (9, most)]
    lines = []
    for method in names(r["method"] for r in rows):
        own = {(r["scene"], r["settings"]["markers"]): r for r in rows if r["method"] == method}
        cells = [f"{1e3 * own[c]['error_rms']:.3f} mm" for c in columns]
        lines.append([method, *cells, f"{own[columns[0]]['time_us_median']:.0f} µs"])
    heads = [f"{s.split(', ')[1]}, {n} markers" for s, n in columns]
    return table(["model", *heads, "a fit, 9 markers"], lines)


def engines(document: dict[str, Any]) -> str:
    """RMS proxy error and median time of each engine at 0.5 mm, by scene."""
    here = [e for e in ENGINES if of(document, stage="proxy", method=e)]
    lines = []
    for scene in names(r["scene"] for r in of(document, stage="proxy")):
        found = _at_half_a_millimetre(document, scene)
        lines.append([scene, *(_cell(found[e]) if e in found else "–" for e in here)])
    return table(["scene", *(f"`{e}`" for e in here)], lines)


def _at_half_a_millimetre(document: dict[str, Any], scene: str) -> dict[str, dict[str, Any]]:
    rows = of(document, stage="proxy", scene=scene)
    return {r["method"]: r for r in rows if r["settings"].get("spacing_m") == SPACING}


def _cell(result: dict[str, Any]) -> str:
    error, time = micrometres(result["error_rms"]), microseconds(result["time_us_median"])
    return f"{error} µm, {time} µs"


def promises(document: dict[str, Any]) -> str:
    """What the rules do besides being near: come inside, lag across the exact force."""
    lines = []
    for scene in names(r["scene"] for r in of(document, stage="proxy")):
        found = _at_half_a_millimetre(document, scene)
        cells = [text for rule in RULES for text in _kept(found.get(rule))]
        lines.append([scene, *cells])
    heads = [f"`{rule}`: {what}" for rule in RULES for what in
             ("inside, worst", "lag, RMS", "force error, RMS")]  # fmt: skip
    return table(["scene", *heads], lines)


def _kept(r: dict[str, Any] | None) -> tuple[str, str, str]:
    if r is None:
        return ("–",) * 3
    inside, lag = micrometres(r["inside_m"]), micrometres(r["lag_rms_m"])
    return f"{inside} µm", f"{lag} µm", f"{1e3 * r['force_rms_n']:.3g} mN"


def left_out(document: dict[str, Any]) -> str:
    """What leaving a part out saves: median tick without it, and with it."""
    others = ["robust, every point", "robust, not planar"]
    others += [
        m for m in names(r["method"] for r in of(document, stage="proxy")) if "iteration" in m
    ]
    lines = []
    for scene in names(r["scene"] for r in of(document, stage="proxy")):
        found = _at_half_a_millimetre(document, scene)
        if "robust" not in found:
            continue  # a scene that is tried at another spacing alone
        cells = [_cell(found[m]) if m in found else "–" for m in ("robust", *others)]
        lines.append([scene, str(found["robust"]["points"]), *cells])
    return table(
        ["scene", "points", "`robust`", *(m.removeprefix("robust, ") for m in others)], lines
    )


def chosen(document: dict[str, Any]) -> str:
    """What the tolerance chose, by scene."""
    head = ["scene", "points, or lines and arcs", "surface, worst", "kept", "proxy, RMS / worst",
            "where it can be followed", "kept there", "force, RMS", "tick, median / p99.9",
            "against the cheapest"]  # fmt: skip
    return table(head, (_chosen_row(r) for r in of(document, stage="proxy", chosen=True)))


def _chosen_row(r: dict[str, Any]) -> list[str]:
    ratio = r["time_over_cheapest"]
    share = (
        "all ticks"
        if r["followed_ticks"] == r["ticks"]
        else f"{r['followed_ticks']} of {r['ticks']} ticks"
    )
    return [
        r["scene"],
        str(r["points"]) if "lines_and_arcs" not in r else f"{r['lines_and_arcs']} arcs",
        f"{micrometres(max(r['surface_error_m'], r['inside_m']))} µm",
        "yes" if r["meets_tolerance"] else "**no**",
        f"{micrometres(r['error_rms'])} / {micrometres(r['error_max'])} µm",
        f"{micrometres(r['followed_rms_m'])} µm ({share})",
        "yes" if r["follows"] else "no",
        f"{1e3 * r['force_rms_n']:.3g} mN",
        f"{microseconds(r['time_us_median'])} / {microseconds(r['time_us_p999'])} µs",
        "–" if ratio is None else f"{ratio:.1f} ×",
    ]


def choice(document: dict[str, Any]) -> str:
    """The settings of this run's tolerance."""
    c = document["chosen"]
    made = [r["settings"] for r in of(document, stage="proxy", chosen=True)]
    space = max(s["max_iterations"] for s in made if "max_iterations" in s)
    return (
        f"For {c['tolerance_m'] * 1e3:g} mm and R = 5 mm: points at most "
        f"{c['spacing_m'] * 1e3:.3g} mm apart, a band of {c['band_m'] * 1e6:.3g} µm, "
        f"{c['max_iterations']} iterations in the plane and {space} in space. "
        "On the bench's scenes, the planar drawings by their lines and arcs:"
    )


def plans(document: dict[str, Any]) -> str:
    """The whole pipeline on the elbow."""
    lines = [
        [
            r["scene"].split(", ")[1],
            r["method"],
            str(r["points"]),
            f"{micrometres(r['error_rms'])} / {micrometres(r['error_max'])} µm",
            f"{r['time_us_median'] / 1e3:.0f} ms",
        ]
        for r in of(document, stage="plan")
        if r["settings"].get("tolerance_m", document["tolerance_m"]) == document["tolerance_m"]
    ]
    return table(["markers", "way", "points", "error of the surface, RMS / max", "time"], lines)


def scenes(told: dict[str, dict[str, Any]]) -> str:
    """The paper's figures: its numbers, where it states them, and ours under both rules."""
    lines = []
    for name, n in told.items():
        theirs = n.get("in_the_paper", {})
        points = f"{n['points']}" + (f" ({theirs['points']})" if "points" in theirs else "")
        density = "–"
        if "density_per_mm" in n:
            density = f"{n['density_per_mm']:.2f} ({theirs['density_per_mm']:g})"
        cells = [
            f"{n[rule]['force_least_n']:.1f} to {n[rule]['force_most_n']:+.1f} N along "
            f"{n[rule]['strongest_axis']}, {n[rule]['clearance_min_um']:+.1f} µm, "
            f"{n[rule]['entrenched_ticks']} of {n[rule]['ticks']}"
            for rule in ("robust", "paper")
        ]
        lines.append([name, points, density, *cells])
    what = "force, least clearance, ticks inside"
    heads = [f"`{rule}`: {what}" for rule in ("robust", "paper")]
    return table(["scene", "points (the paper's)", "points/mm (the paper's)", *heads], lines)


TABLES = {f.__name__: f for f in (
    machine, runs, extraction, ridges, sampling, registration, engines, promises, left_out,
    choice, chosen, plans,
)}  # fmt: skip
