"""The table of extreme cases: what is tried, and what must come of it.

The expectation is data, written before the run. A case either gives the right value within
`limit`, or is refused by one of the named errors, or may do either where both stand.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

Group = Literal["cloud", "hip", "setting", "long"]

INSIDE = "m inside the free distance R - band"
# Rounding of a distance of centimetres; the guarantee itself has no slack.
ROUNDING = 1e-12


@dataclass(frozen=True)
class Extreme:
    """One case."""

    name: str  # in the report "extreme/<group>/<name>"
    # What is extreme: the cloud, the HIP or a setting; or a long run
    group: Group
    expected: str  # in words
    probe: str  # function of `probes` that returns the figure held against `limit`
    args: dict[str, Any] = field(default_factory=dict)  # its arguments
    # The figure is at most this; `None`: only a refusal will do
    limit: float | None = ROUNDING
    unit: str = INSIDE
    refusal: tuple[str, ...] = ()  # names of errors (`vfplan.errors`) that are as good
    full: bool = False  # runs with `--full` only


def _press(name: str, limit: float, **args: Any) -> Extreme:
    text = f"the proxy rests R from the wall within {limit:.3g} m"
    return Extreme(name, "cloud", text, "press", args, limit, "m")


def _outside(name: str, group: Group, probe: str, full: bool = False, **args: Any) -> Extreme:
    return Extreme(name, group, "the proxy stays outside", probe, args, full=full)


def _refused(name: str, group: Group, probe: str, *errors: str, **args: Any) -> Extreme:
    text = f"refused: {' or '.join(errors)}"
    return Extreme(name, group, text, probe, args, None, "", errors)


CLOUDS = (
    # The band of a 0.5 mm patch is 12.5 µm; 1e6 m resolves 0.12 nm.
    _press("offset 1 m", 1.3e-5, offset=1.0),
    _press("offset 1 km", 1.3e-5, offset=1e3),
    _press("offset 1000 km", 1.3e-5, offset=999_999.0),
    _refused("offset beyond 1000 km", "cloud", "press", "SceneError", offset=1.1e6),
    _press("scene and radius times 1e-6", 1.3e-11, scale=1e-6),
    _press("scene and radius times 1e3", 1.3e-2, scale=1e3),
    _press("scene and radius times 2e-7, R = 1 nm", 2.6e-12, scale=2e-7),
    _press("scene and radius times 4e7, R = 200 km", 5.2e2, scale=4e7),
    _outside("cloud of 1 µm", "cloud", "speck", extent=1e-6),
    _outside("cloud of 1 km, 1e6 points", "cloud", "line", count=1_000_001, spacing=1e-3),
    _outside("one point", "cloud", "blob", kind="one"),
    _outside("two points", "cloud", "blob", kind="two"),
    _outside("all points equal", "cloud", "blob", kind="equal"),
    _outside("every point three times", "cloud", "blob", kind="repeated"),
    _outside("collinear", "cloud", "blob", kind="collinear"),
    _outside("coplanar", "cloud", "blob", kind="coplanar"),
    _outside("dust, 1e5 points in 1 cm³", "cloud", "blob", kind="dust"),
    _outside("1e7 points", "cloud", "sheet", side_points=3163),
    _outside("1e6 points", "cloud", "sheet", side_points=1000),
    _refused("no point", "cloud", "blob", "SceneError", kind="none"),
    _refused("a point at NaN", "cloud", "blob", "SceneError", kind="nan"),
    _outside("curve, spacing 0.001 R", "cloud", "line", count=20_001, spacing=5e-6),
    _outside("sheet, spacing 0.02 R", "cloud", "sheet", side_points=401, spacing=1e-4),
    _outside("sheet, spacing R", "cloud", "sheet", side_points=41, spacing=5e-3),
    # No engine can hold what leaks: it must stay outside every ball, and the bundle must say so.
    _outside("sheet, spacing 1.5 R, leaks", "cloud", "sheet", side_points=31, spacing=7.5e-3),
    Extreme("curve, spacing 2.1 R", "cloud", "the bundle's certificate says it leaks", "certified",
            {"spacing": 10.5e-3}, 0.0, "certified"),
    Extreme("curve, spacing 1.9 R", "cloud", "the bundle's certificate says it holds", "leaking",
            {"spacing": 9.5e-3}, 0.0, "leaking"),
    _outside("sharp cusp", "cloud", "curve", kind="cusp"),
    _outside("spiral, turns 11 mm apart", "cloud", "curve", kind="spiral"),
    _outside("self-near curve, 1 mm apart", "cloud", "curve", kind="near"),
    _outside("needle channel, 9.9 mm for a proxy of 10", "cloud", "curve", kind="needle"),
)  # fmt: skip

SETTINGS = (
    _outside("band 1 nm", "setting", "walk", band=1e-9),
    _refused("band 1 pm", "setting", "walk", "SettingError", band=1e-12),
    _outside("band = r_c (r1 = 0)", "setting", "walk", band=5e-3, outer_radius=11e-3),
    # The ends of the ranges and what is beyond them.
    _outside("band 1e-8 R", "setting", "walk", band=5e-11),
    _refused("band below 1e-8 R", "setting", "walk", "SettingError", band=4.9e-11),
    _refused("band denormal", "setting", "walk", "SettingError", band=5e-324),
    *(
        _refused(f"r_c = {rc:g} m", "setting", "walk", "SettingError", contact_radius=rc)
        for rc in (1e-300, 0.99e-9, 1.01e6, 1e300)
    ),
    _outside("r_v = 1 km", "setting", "walk", point_radius=1e3),
    _refused("r_v = 1e300 m", "setting", "walk", "SettingError", point_radius=1e300),
    _outside("r3 = 2000 km", "setting", "walk", outer_radius=2e6),
    _refused("r3 = 1e300 m", "setting", "walk", "SettingError", outer_radius=1e300),
    _refused("band 0", "setting", "walk", "SettingError", band=0.0),
    _refused("band above r_c", "setting", "walk", "SettingError", band=5.1e-3),
    _outside("r3 one part in 1e12 above r2", "setting", "walk", outer_over_r2=1 + 1e-12),
    _refused("r3 = r2", "setting", "walk", "SettingError", outer_over_r2=1.0),
    _outside("r3 = 100 r_c", "setting", "walk", outer_over_r2=100.0),
    _outside("r_v = r3", "setting", "walk", point_radius=10e-3),
    _outside("r_v = 10 r3", "setting", "walk", point_radius=100e-3),
    _refused("r_v below 0", "setting", "walk", "SettingError", point_radius=-1e-9),
    *(
        Extreme(f"K = {k:g} N/m", "setting", "F = K (proxy - HIP) to two roundings", "force",
                {"stiffness": k}, 4.5e-16, "relative")
        for k in (1e-3, 1.0, 1e6, 1e9)
    ),
    Extreme("K anisotropic 1 : 1e6", "setting", "F = K (proxy - HIP) to two roundings", "force",
            {"stiffness": (1.0, 1e3, 1e6)}, 4.5e-16, "relative"),
    *(
        _refused(f"K = {k}", "setting", "force", "SettingError", stiffness=k)
        for k in (0.0, -1.0, float("inf"), float("nan"))
    ),
)  # fmt: skip

HIPS = (
    Extreme("at rest for 1e7 ticks", "hip", "no drift at all", "rest", {"ticks": 10_000_000}, 0.0,
            "m of drift"),
    _outside("jumps 1000 km and back", "hip", "jump", distance=9e5),
    _outside("1000 m/s through the wall", "hip", "pierce", speed=1e3, rate=1000.0),
    *(_outside(f"{rate:g} Hz", "hip", "pierce", speed=0.2, rate=rate)
      for rate in (10.0, 100.0, 1e3, 1e4, 4e4)),
    Extreme("moves by denormals", "hip", "every answer finite, the proxy outside", "denormals", {}),
    Extreme("exactly on a point", "hip", "every answer finite, the proxy outside", "on_point", {}),
    Extreme("on the medial axis of a ring", "hip", "proxy = HIP, force 0", "medial", {}, 0.0, "m"),
    Extreme("NaN, Inf, 1e7 m, then back", "hip", "as if the bad ticks had not been", "interrupted",
            {}, 0.0, "m"),
)  # fmt: skip

LONG = (
    Extreme("1e8 ticks of random motion", "long", "the proxy stays outside", "wander",
            {"ticks": 100_000_000}, full=True),
    Extreme("1e8 ticks, time", "long", "the last tenth takes no longer than the first", "slowing",
            {"ticks": 100_000_000}, 0.5, "of the first tenth's time, more", full=True),
    Extreme("1e8 ticks, memory", "long", "no growth", "growth", {"ticks": 100_000_000}, 4e6,
            "bytes", full=True),
)  # fmt: skip

TABLE: tuple[Extreme, ...] = (*CLOUDS, *SETTINGS, *HIPS, *LONG)
"""Every case, in the order of the report."""
