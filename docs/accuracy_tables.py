"""The tables of docs/accuracy.md, made from a bench.json; `scenes` from the paper's figures."""

from __future__ import annotations

from collections.abc import Iterable
from statistics import median
from textwrap import fill
from typing import Any

Document = dict[str, Any]
Result = dict[str, Any]

ENGINES = ("exact", "robust", "paper", "nanoflann_peer", "nearest-point penalty")
SPACING_M = 0.5e-3
"""Distance between points at which the engines are compared [m]."""


def micrometres(metres: float) -> str:
    """Three digits, never an exponent; below a nanometre it is rounding."""
    value = metres * 1e6
    if value < 1e-3:
        return "< 0.001"
    rounded = float(f"{value:.3g}")
    if rounded < 1e3:
        return f"{rounded:.3g}"
    return f"{rounded:.0f}"


def microseconds(us: float) -> str:
    """Two digits below 10, whole numbers above, never an exponent."""
    if us < 10:
        return f"{us:.2g}"
    return f"{us:.0f}"


def results_of(document: Document, **wanted: Any) -> list[Result]:
    """The results that have these values under these keys."""
    chosen = []
    for result in document["results"]:
        if all(result.get(key) == value for key, value in wanted.items()):
            chosen.append(result)
    return chosen


def table(head: list[str], rows: Iterable[list[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def values_of(results: list[Result], key: str) -> list[Any]:
    """The values under a key, each once, in order."""
    return list(dict.fromkeys(result[key] for result in results))


def machine(document: Document) -> str:
    """One line on the machine of the run."""
    m = document["machine"]
    return (
        f"Machine: {m['processor']}, {m['cores']} cores, {m['system']}, Python {m['python']}, "
        f"NumPy {m['numpy']}. The run took {document['elapsed_s'] / 60:.1f} minutes and gave "
        f"{len(document['results'])} results."
    )


def summary(document: Document) -> str:
    """The sentence of `vfplan bench summary`."""
    from vfplan.bench.record import summaries

    return "```\n" + fill(summaries(document)["proxy"], 130) + "\n```"


def extraction(document: Document) -> str:
    """RMS error and time of each method at scale 1, by drawing."""
    results = []
    for result in results_of(document, stage="extract"):
        if result["settings"]["scale"] == 1.0:
            results.append(result)
    methods = values_of(results, "method")
    rows = []
    for scene in values_of(results, "scene"):
        row = [scene]
        by_method = {r["method"]: r for r in results if r["scene"] == scene}
        for method in methods:
            if method not in by_method:
                row.append("refused")
                continue
            result = by_method[method]
            time_ms = result["time_us_median"] / 1e3
            row.append(f"{result['error_rms']:.3f} px, {time_ms:.0f} ms")
        rows.append(row)
    return table(["drawing", *methods], rows)


def ridges(document: Document) -> str:
    """How much `ridge` gains over `skeleton`, and where it was refused or broke."""
    results = results_of(document, stage="extract")
    skeletons = {}
    for result in results:
        if result["method"] == "skeleton":
            skeletons[result["scene"], result["settings"]["scale"]] = result
    gains = []
    costs = []
    gaps = []
    for result in results:
        key = result["scene"], result["settings"]["scale"]
        if result["method"] != "ridge":
            continue
        if key in skeletons:
            gains.append(skeletons[key]["error_rms"] / result["error_rms"])
            costs.append(result["time_us_median"] / skeletons[key]["time_us_median"])
        if result["uncovered_px"] > 5:
            gaps.append(f"{key[0]} at scale {key[1]:g} ({result['uncovered_px']:.0f} px)")
    refused = []
    for refusal in document.get("refused", ()):
        if refusal["stage"] == "extract":
            scale = refusal["settings"]["scale"]
            refused.append(f"{refusal['scene']} at scale {scale:g} (`{refusal['method']}`)")
    refusals = "; ".join(dict.fromkeys(refused)) or "none"
    return (
        f"- On {len(gains)} pictures the error of `skeleton` is {min(gains):.1f} to "
        f"{max(gains):.0f} times that of `ridge`, in the median {median(gains):.1f} times. `ridge` "
        f"takes {median(costs):.1f} times as long.\n"
        f"- The method in brackets refused these pictures: {refusals}.\n"
        f"- `ridge` missed parts of these lines, by the distance in brackets: "
        f"{'; '.join(gaps) or 'none'}."
    )


def sampling(document: Document) -> str:
    """The worst error of the surface, the points and the cost of a tick, by tolerance."""
    results = []
    tolerances = set()
    for result in results_of(document, stage="sample"):
        if not result.get("chosen"):
            results.append(result)
            tolerances.add(result["settings"].get("tolerance_m", 1e-5))
    rows = []
    for scene in values_of(results, "scene"):
        for tolerance in (1e-5, min(tolerances)):
            row = [scene, f"{tolerance * 1e6:g} µm"]
            for result in results:
                if result["scene"] == scene and result["settings"].get("tolerance_m") == tolerance:
                    error = micrometres(result["error_max"])
                    time = microseconds(result["time_us_median"])
                    row.append(f"{error} µm, {result['points']} points, {time} µs")
            rows.append(row)
    return table(["curve", "tolerance", "spacing by curvature", "even spacing"], rows)


def registration(document: Document) -> str:
    """Target registration error by model, print and number of markers, at 0.2 mm of noise."""
    results = []
    for result in results_of(document, stage="register"):
        if result["scene"].startswith("0.2 mm"):
            results.append(result)
    max_markers = max(result["settings"]["markers"] for result in results)
    columns = []
    head = ["model"]
    for scene in values_of(results, "scene"):
        for markers in (9, max_markers):
            columns.append((scene, markers))
            head.append(f"{scene.split(', ')[1]}, {markers} markers")
    rows = []
    for method in values_of(results, "method"):
        by_column = {}
        for result in results:
            if result["method"] == method:
                by_column[result["scene"], result["settings"]["markers"]] = result
        row = [method]
        for column in columns:
            row.append(f"{1e3 * by_column[column]['error_rms']:.3f} mm")
        row.append(f"{by_column[columns[0]]['time_us_median']:.0f} µs")
        rows.append(row)
    return table([*head, "time of a fit, 9 markers"], rows)


def engines(document: Document) -> str:
    """RMS error of the proxy and median time of a tick of each engine, by scene."""
    results = results_of(document, stage="proxy")
    methods = [engine for engine in ENGINES if results_of(document, stage="proxy", method=engine)]
    rows = []
    for scene in values_of(results, "scene"):
        row = [scene]
        for method in methods:
            row.append(engine_cell(results, scene, method))
        if set(row[1:]) != {"–"}:
            rows.append(row)
    return table(["scene", *(f"`{method}`" for method in methods)], rows)


def engine_cell(results: list[Result], scene: str, method: str) -> str:
    """Error and time of an engine on a scene; a dash where it was not run."""
    for result in results:
        same = result["scene"] == scene and result["method"] == method
        if same and result["settings"].get("spacing_m") == SPACING_M:
            time = microseconds(result["time_us_median"])
            return f"{micrometres(result['error_rms'])} µm, {time} µs"
    return "–"


def chosen(document: Document) -> str:
    """What the tolerance chose, by scene."""
    rows = []
    for result in results_of(document, stage="proxy", chosen=True):
        size = f"{result['points']} points"
        if "lines_and_arcs" in result:
            size = f"{result['lines_and_arcs']} lines and arcs"
        if "triangles" in result:
            size = f"{result['triangles']} triangles"
        surface = max(result["surface_error_m"], result["inside_m"])
        kept = "**no**"
        if result["meets_tolerance"]:
            kept = "yes"
        time = microseconds(result["time_us_median"])
        slow = microseconds(result["time_us_p999"])
        row = [result["scene"], size, f"{micrometres(surface)} µm", kept]
        row += [f"{micrometres(result['error_rms'])} µm", f"{time} / {slow} µs"]
        rows.append(row)
    head = ["scene", "rendered from", "largest error of the surface", "within the tolerance"]
    return table([*head, "RMS error of the proxy", "tick, median / p99.9"], rows)


def choice(document: Document) -> str:
    """The settings of this run's tolerance."""
    settings = document["chosen"]
    iterations = []
    for result in results_of(document, stage="proxy", chosen=True):
        if "max_iterations" in result["settings"]:
            iterations.append(result["settings"]["max_iterations"])
    return (
        f"With τ = {settings['tolerance_m'] * 1e3:g} mm and R = 5 mm, points are at most "
        f"{settings['spacing_m'] * 1e3:.3g} mm apart, and the band is "
        f"{settings['band_m'] * 1e6:.3g} µm. A tick has at most {settings['max_iterations']} "
        f"iterations in the plane and {max(iterations)} in space."
    )


def plans(document: Document) -> str:
    """The whole pipeline on the elbow."""
    rows = []
    for result in results_of(document, stage="plan"):
        tolerance = result["settings"].get("tolerance_m", document["tolerance_m"])
        if tolerance != document["tolerance_m"]:
            continue
        error = f"{micrometres(result['error_rms'])} / {micrometres(result['error_max'])} µm"
        time_ms = result["time_us_median"] / 1e3
        markers = result["scene"].split(", ")[1]
        row = [markers, result["method"], str(result["points"]), error, f"{time_ms:.0f} ms"]
        rows.append(row)
    return table(["markers", "method", "points", "error of the surface, RMS / max", "time"], rows)


def scenes(figures: dict[str, dict[str, Any]]) -> str:
    """The paper's figures: its numbers, where it states them, and ours under both rules."""
    rows = []
    for name, figure in figures.items():
        paper = figure.get("in_the_paper", {})
        points = str(figure["points"])
        if "points" in paper:
            points += f" ({paper['points']})"
        density = "–"
        if "density_per_mm" in figure:
            density = f"{figure['density_per_mm']:.2f} ({paper['density_per_mm']:g})"
        row = [name, points, density]
        for rule in ("robust", "paper"):
            run = figure[rule]
            row.append(
                f"{run['force_least_n']:.1f} to {run['force_most_n']:+.1f} N along "
                f"{run['strongest_axis']}, {run['clearance_min_um']:+.1f} µm, "
                f"{run['entrenched_ticks']} of {run['ticks']}"
            )
        rows.append(row)
    columns = "force, smallest clearance, ticks inside"
    head = ["scene", "points (in the paper)", "points/mm (in the paper)"]
    return table([*head, f"`robust`: {columns}", f"`paper`: {columns}"], rows)


TABLES = {
    function.__name__: function
    for function in (
        machine,
        summary,
        extraction,
        ridges,
        sampling,
        registration,
        engines,
        choice,
        chosen,
        plans,
    )
}
"""Each table that stands on the page, by the name of its place there."""
