"""Robot files: the shipped one is good, and anything the schema does not allow is refused."""

from __future__ import annotations

import dataclasses
import json
from importlib.resources import files

import pytest
from conftest import file_with
from refusals import refuses

from vfplan.errors import InputError
from vfplan.robot import Robot, read_robot

GOOD = """format = "vfplan-robot"
version = "1.0"
name = "mine"
mass_kg = 2
damping_n_s_per_m = 0.0
rate_hz = 500.0
"""


def test_shipped_robot_and_none():
    franka = read_robot("franka")
    assert (franka.name, franka.rate_hz, franka.force_limit_n) == ("franka", 1000.0, 20.0)
    assert franka.lost_packets_limit == 20
    assert read_robot("none") is None
    assert read_robot(None) is None


def test_the_fr3_stands_beside_the_panda():
    panda, fr3 = read_robot("franka"), read_robot("fr3")
    assert panda.torque_limit_nm == fr3.torque_limit_nm == (87.0,) * 4 + (12.0,) * 3
    assert panda.torque_step_limit_nm == (1.0,) * 7
    assert fr3.joint_speed_limit_rad_s[4] == 5.26
    assert (fr3.name, fr3.speed_limit_m_s) == ("fr3", 3.0)


def test_a_file_of_ones_own(tmp_path):
    assert read_robot(file_with(tmp_path / "mine.toml", GOOD)) == Robot("mine", 2, 0.0, 500.0)


def test_schema_and_type_name_the_same_things():
    schema = json.loads((files("vfplan.schemas") / "robot-1.1.json").read_text())
    names = set(schema["properties"]) - {"format", "version"}
    assert names == {field.name for field in dataclasses.fields(Robot)}


LINES = [
    ("mass_kg = 0", "robot-value"),
    ("mass_kg = nan", "robot-value"),
    ('mass_kg = "1"', "robot-value"),
    ("delay_ticks = 1.5", "robot-value"),
    ("delay_ticks = -1", "robot-value"),
    ("delay_ticks = true", "robot-value"),
    ("weight = 1", "robot-name-unknown"),
    ('version = "2.0"', "robot-version"),
    ("torque_limit_nm = [1.0]", "robot-name-unknown"),  # 1.0 has none
    ('name = ""', "robot-value"),
    # Numbers that are longer than a float, and longer than Python reads.
    ("mass_kg = " + "9" * 400, "robot-value"),
    ("mass_kg = " + "9" * 5000, "robot-not-toml"),
    # Lists of joints.
    ('version = "1.1"\ntorque_limit_nm = 87.0', "robot-value"),
    ('version = "1.1"\ntorque_limit_nm = []', "robot-value"),
    ('version = "1.1"\ntorque_limit_nm = [1.0, 0.0]', "robot-value"),
    (
        'version = "1.1"\ntorque_limit_nm = [1.0, 2.0]\njoint_speed_limit_rad_s = [1.0]',
        "robot-joints",
    ),
    # A key that is missing, no TOML, and tables within tables without end.
    ("rate_hz", "robot-incomplete"),
    ("= 3", "robot-not-toml"),
    ("a = " + "[" * 20_000 + "]" * 20_000, "robot-not-toml"),
]


@pytest.mark.parametrize("line, code", LINES, ids=[line[:60] for line, _ in LINES])
def test_what_the_schema_does_not_allow(tmp_path, line, code):
    key = line.split()[0]
    lines = [kept for kept in GOOD.splitlines() if not kept.startswith(f"{key} ")]
    text = "\n".join([*lines, *[line] * (code != "robot-incomplete")])
    path = file_with(tmp_path / "robot.toml", text)
    with refuses(InputError, code):
        read_robot(path)
