"""A robot, as far as a fixture cares: its mass, its damping, its clock and what it tolerates."""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from vfplan.errors import InputError
from vfplan.io.files import read_whole

SHIPPED = ("franka", "fr3")
VERSIONS = ("1.0", "1.1")
MAX_BYTES = 2**20


@dataclass(frozen=True)
class Robot:
    """A robot file (`schemas/robot-1.1.json`); a limit that is not known is `None`.

    Parameters
    ----------
    name
        What reports call it.
    mass_kg
        Moving mass felt at the tip [kg].
    damping_n_s_per_m
        Viscous damping at the tip, hand included [N·s/m].
    rate_hz
        Control rate [1/s].
    delay_ticks
        Ticks between a position and the force it causes.
    quantum_m
        Resolution of a measured position [m].
    force_limit_n, force_step_limit_n
        Largest force at the tip, and largest change of it from one tick to the next [N].
    friction_n
        Coulomb friction along each axis at the tip [N].
    speed_limit_m_s, acceleration_limit_m_s2
        Largest speed and acceleration of the tip.
    torque_limit_nm, torque_step_limit_nm
        Largest torque of each joint, and largest change of it from one tick to the next [N·m].
    joint_speed_limit_rad_s
        Largest speed of each joint [rad/s].
    lost_packets_limit
        Packets lost in a row before the robot stops itself.
    """

    name: str
    mass_kg: float
    damping_n_s_per_m: float
    rate_hz: float
    delay_ticks: int = 0
    quantum_m: float | None = None
    force_limit_n: float | None = None
    force_step_limit_n: float | None = None
    friction_n: float | None = None
    speed_limit_m_s: float | None = None
    acceleration_limit_m_s2: float | None = None
    torque_limit_nm: tuple[float, ...] | None = None
    torque_step_limit_nm: tuple[float, ...] | None = None
    joint_speed_limit_rad_s: tuple[float, ...] | None = None
    lost_packets_limit: int | None = None


def read_robot(choice: str | Path | None) -> Robot | None:
    """The robot that `--robot` names.

    Parameters
    ----------
    choice
        "franka" (a Panda), "fr3", a path to a robot file, or "none" or `None`: no robot.

    Raises
    ------
    InputError
        A file that cannot be read, is not TOML, or is not what the schema says.
    """
    if choice is None or str(choice) == "none":
        return None
    if str(choice) in SHIPPED:
        text = (files("vfplan.schemas") / "robots" / f"{choice}.toml").read_text("utf-8")
    else:
        text = _text(Path(choice))
    try:
        values = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:  # tables within tables within ...
        raise InputError(f"not a robot file: {error}", where=str(choice)) from None
    check_robot(values, where=str(choice))
    return Robot(**{
        k: tuple(v) if isinstance(v, list) else v
        for k, v in values.items() if k not in ("format", "version")
    })  # fmt: skip


def _text(path: Path) -> str:
    try:
        return read_whole(path, MAX_BYTES).decode("utf-8")
    except (InputError, UnicodeDecodeError) as error:
        reason = getattr(error, "message", "is not text")
        raise InputError(
            f"{reason}; {', '.join(SHIPPED)}, none or a robot file wanted", where=str(path)
        ) from None


def check_robot(values: dict[str, Any], *, where: str) -> None:
    """Raise `InputError` for the first thing that the schema of the file's version forbids."""
    version = values.get("version")
    chosen = version if version in VERSIONS else VERSIONS[-1]
    schema = json.loads((files("vfplan.schemas") / f"robot-{chosen}.json").read_text("utf-8"))
    known = schema["properties"]
    if "version" in values and version not in VERSIONS:
        raise InputError(
            f"version is {version!r}; {' or '.join(map(repr, VERSIONS))} wanted", where=where
        )
    for name in schema["required"]:
        if name not in values:
            raise InputError(f"{name} is missing; a robot file must say it", where=where)
    for name, value in values.items():
        if name not in known:
            raise InputError(f"{name!r} is unknown; {', '.join(known)} are known", where=where)
        fault = _fault(value, known[name])
        if fault:
            raise InputError(f"{name} is {value!r}; {fault} wanted", where=where)
    joints = {len(v) for v in values.values() if isinstance(v, list)}
    if len(joints) > 1:
        raise InputError(
            f"lists of {min(joints)} and of {max(joints)} joints; all of one arm's wanted",
            where=where,
        )


def _fault(value: Any, rule: dict[str, Any]) -> str | None:
    """What the schema wants instead of `value`; `None` when it is good."""
    types = {"string": str, "integer": int, "number": (int, float), "array": list}
    if isinstance(value, bool) or not isinstance(value, types[rule["type"]]):
        return f"a {'list' if rule['type'] == 'array' else rule['type']}"
    if "const" in rule and value != rule["const"]:
        return repr(rule["const"])
    if rule["type"] == "string":
        return None if len(value) >= rule.get("minLength", 0) else "some text"
    if rule["type"] == "array":
        if not rule["minItems"] <= len(value) <= rule["maxItems"]:
            return f"{rule['minItems']} to {rule['maxItems']} numbers"
        faults = (_fault(item, rule["items"]) for item in value)
        return next((f"a list of which each is {f}" for f in faults if f), None)
    # Written so that NaN fails.
    if not abs(value) < float("inf"):
        return "a finite number"
    if not value > rule.get("exclusiveMinimum", -float("inf")):
        return f"more than {rule['exclusiveMinimum']}"
    if not rule.get("minimum", value) <= value <= rule.get("maximum", value):
        low, high = rule.get("minimum"), rule.get("maximum")
        return f"{low} to {high}" if high is not None else f"{low} at least"
    return None
