"""An arm's model file: the shipped ones, and what is not let through to MuJoCo."""

from __future__ import annotations

import pytest
from conftest import file_with
from refusals import refuses

from vfplan.arm.model import ARMS, MAX_NODES, Arm
from vfplan.errors import InputError, SettingError
from vfplan.robot import Robot, read_robot

ROBOT = Robot("mine", 1.0, 5.0, 1000.0, 1)
TWO = """<mujoco><worldbody><body><inertial pos="0.2 0 0" mass="2" diaginertia="0.02 0.02 0.02"/>
<joint name="a" axis="0 0 1" range="-90 90" limited="true"/><body pos="0.4 0 0">
<inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.01 0.01"/><joint axis="0 0 1"/>
<site name="tip" pos="0.3 0 0"/></body></body></worldbody></mujoco>"""


def written(tmp_path, text):
    return file_with(tmp_path / "arm.xml", text)


@pytest.mark.parametrize("name", ARMS)
def test_the_shipped_arms_are_as_published(name):
    arm = Arm(name, tool=(0, 0, 0))
    assert arm.joints == 7
    assert arm.robot == read_robot(ARMS[name])
    arm.hold([0.0] * 7)  # stretched up: 0.333 + 0.316 + 0.384 - 0.107, and 0.088 to the front
    assert arm.read_tip()[0] == pytest.approx([0.088, 0, 0.333 + 0.316 + 0.384 - 0.107], abs=1e-12)
    arm.hold(arm.ready)
    assert arm.read_tip()[0] == pytest.approx([0.306891, 0, 0.590282], abs=1e-6)
    assert (arm.ready > arm.low).all()
    assert (arm.ready < arm.high).all()
    assert 10 < arm.model.body_mass.sum() < 20


def test_an_arm_of_ones_own(tmp_path):
    arm = Arm(written(tmp_path, TWO), ROBOT, base=(1, 2, 3, 0, 0, 0, 1), tool=(0, 0, 0))
    arm.hold([0, 0])
    assert arm.read_tip()[0] == pytest.approx([1 - 0.7, 2, 3])  # half a turn about z
    with refuses(SettingError, "arm-without-robot"):
        Arm(written(tmp_path, TWO))
    with refuses(SettingError, "arm-unknown"):
        Arm("foo")
    with refuses(SettingError, "robot-of-another-arm"):
        Arm(written(tmp_path, TWO), read_robot("franka"))


@pytest.mark.parametrize("was, becomes, message", [
    ("<worldbody>", '<include file="/etc/passwd"/><worldbody>', "<include> is not allowed"),
    ("<worldbody>", '<asset><mesh file="a.stl"/></asset><worldbody>', "<asset> is not"),
    ("<worldbody>", '<extension><plugin plugin="a"/></extension><worldbody>', "<extension>"),
    ("<worldbody>", '<compiler meshdir="/"/><worldbody>', 'meshdir="..." is not allowed'),
    ("<worldbody>", '<worldbody><geom mesh="a" type="mesh"/>', 'mesh="..." is not allowed'),
    ("<worldbody>", '<size memory="900G"/><worldbody>', "<size> is not allowed"),
    ("<worldbody>", "<worldbody><replicate count='9999999'/>", "<replicate> is not allowed"),
    ("<worldbody>", "<worldbody>" + "<site/>" * MAX_NODES, "more than 5000 elements"),
    ("<worldbody>", "<worldbody>" + "<body>" * 70, "64 within each other"),
    ("<mujoco>", '<!DOCTYPE a [<!ENTITY b "c">]><mujoco>', "a document type is not allowed"),
    ("mujoco", "robot", "<robot> is no MJCF"),
    ("</mujoco>", "", "no XML"),
    ('name="tip"', 'name="end"', 'no <site name="tip"/>'),
    ('<joint name="a"', '<joint type="slide" name="a"', "1 of them no hinges"),
    ('mass="2"', 'mass="-2"', "MuJoCo refuses it"),
    ('mass="2"', 'mass="nan"', "a number is nan"),
])  # fmt: skip
def test_what_is_not_let_through(tmp_path, was, becomes, message):
    with pytest.raises(InputError, match=message):
        Arm(written(tmp_path, TWO.replace(was, becomes)), ROBOT)


def test_a_simulation_that_warns_leaves_no_file(tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    arm = Arm("panda")
    arm.hold(arm.ready)
    arm.data.qvel[:] = 1e12
    for _ in range(3):
        arm._mj.mj_step(arm.model, arm.data)
    assert "Nan, Inf or huge value" in caplog.text
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_no_text_is_refused(tmp_path):
    path = file_with(tmp_path / "arm.xml", b"<mujoco>\xff</mujoco>")
    with pytest.raises(InputError, match="is not text"):
        Arm(path, ROBOT)


def test_a_base_without_direction_is_refused():
    with refuses(SettingError, "base-without-direction"):
        Arm("panda", base=[0.0] * 7)
