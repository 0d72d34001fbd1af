"""A robot, as far as a fixture cares: its mass, its damping, its clock and what it tolerates."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vfplan.errors import InputError
from vfplan.io.files import MAX_SETTINGS_BYTES, FilePath, read_whole

SHIPPED = ("franka", "fr3")
VERSIONS = ("1.0", "1.1")
SCHEMAS = Path(__file__).parent / "schemas"


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
    delay_jitter_ticks
        By how many ticks that delay varies from tick to tick.
    filter_hz
        Cutoff of the first-order filter that the robot puts on its forces [Hz]; `None` or 0: none.
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
    delay_jitter_ticks: int = 0
    filter_hz: float | None = None
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


def read_robot(choice: FilePath | None) -> Robot | None:
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
        text = (SCHEMAS / "robots" / f"{choice}.toml").read_text("utf-8")
    else:
        choices = f"{', '.join(SHIPPED)}, none or a robot file"
        try:
            text = read_whole(Path(choice), MAX_SETTINGS_BYTES).decode("utf-8-sig")
        except InputError as error:
            error.message += f", or give {choices}"
            raise
        except UnicodeDecodeError:
            raise InputError(
                f"is not text. Give {choices}", where=choice, code="not-text"
            ) from None
    import tomllib

    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        # Besides its own kind of ValueError also another, for a number of thousands of digits, and
        # RecursionError for tables within tables without end.
        raise InputError(
            f"is no robot file: {error}. Correct its TOML", where=choice, code="robot-not-toml"
        ) from None
    check_robot(values, where=str(choice))
    return Robot(**{
        name: tuple(value) if isinstance(value, list) else value
        for name, value in values.items() if name not in ("format", "version")
    })  # fmt: skip


def check_robot(values: dict[str, Any], *, where: str) -> None:
    """Raise `InputError` for the first thing that the schema of the file's version forbids."""
    version = values.get("version", VERSIONS[-1])
    if version not in VERSIONS:
        text = f"version is {version!r}. Give {' or '.join(map(repr, VERSIONS))}"
        raise InputError(text, where=where, code="robot-version")
    schema = json.loads((SCHEMAS / f"robot-{version}.json").read_text("utf-8"))
    known = schema["properties"]
    for name in schema["required"]:
        if name not in values:
            text = f"{name} is missing. Add it to the robot file"
            raise InputError(text, where=where, code="robot-incomplete")
    for name, value in values.items():
        if name not in known:
            text = f"{name!r} is unknown. Give {', '.join(known)}"
            raise InputError(text, where=where, code="robot-name-unknown")
        wanted = _violation(value, known[name])
        if wanted is not None:
            raise InputError(f"{name} is {value!r}. Give {wanted}", where=where, code="robot-value")
    joints = {len(value) for value in values.values() if isinstance(value, list)}
    if len(joints) > 1:
        text = f"lists are of {min(joints)} and of {max(joints)} joints. Give all of one arm"
        raise InputError(text, where=where, code="robot-joints")


def _violation(value: Any, rule: dict[str, Any]) -> str | None:
    """What the schema wants instead of `value`; `None` when the value is good."""
    types = {"string": str, "integer": int, "number": (int, float), "array": list}
    kind = rule["type"]
    if isinstance(value, bool) or not isinstance(value, types[kind]):
        return "a list" if kind == "array" else f"a {kind}"
    if "const" in rule and value != rule["const"]:
        return repr(rule["const"])
    if kind == "string":
        return "some text" if len(value) < rule.get("minLength", 0) else None
    if kind == "array":
        if not rule["minItems"] <= len(value) <= rule["maxItems"]:
            return f"a list of {rule['minItems']} to {rule['maxItems']} numbers"
        for item in value:
            wanted = _violation(item, rule["items"])
            if wanted is not None:
                return f"a list of which each is {wanted}"
        return None
    # NaN is not <= anything, so it is refused too, and so is a whole number that no float holds.
    if not abs(value) <= sys.float_info.max:
        return "a finite number"
    if not value > rule.get("exclusiveMinimum", -float("inf")):
        return f"more than {rule['exclusiveMinimum']}"
    if not rule.get("minimum", value) <= value <= rule.get("maximum", value):
        if "maximum" in rule:
            return f"{rule.get('minimum')} to {rule['maximum']}"
        return f"at least {rule['minimum']}"
    return None
