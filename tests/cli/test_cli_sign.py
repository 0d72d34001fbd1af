"""`vfplan keygen`, `sign` and `verify`: who approved what, for which case, robot and day."""

import os
import stat
from datetime import UTC, datetime, timedelta
from functools import partial

import bundles
import pytest
from keyfolders import BESIDE, keys_beside

import vfplan
from vfplan.bundle.read import read_bundle
from vfplan.bundle.seal import Trust, read_keys, sign
from vfplan.errors import InputError, SettingError, SignatureError


@pytest.fixture(scope="module")
def desk(vfplan_cli, tmp_path_factory):
    """A folder with a bundle, two key pairs and the bundle signed by the first."""
    folder = tmp_path_factory.mktemp("desk")
    vfplan.write_fixture(bundles.whole(), folder / "a.h5")
    for name in ("alice", "mallory"):
        assert vfplan_cli("keygen", "-o", folder / f"{name}.key").sound
    hour_ago = (datetime.now(UTC) - timedelta(hours=1)).strftime("%Y-%m-%dT%H:%M:%SZ")
    words = ["--case", "C1", "--robot-serial", "R7", "--registered-at", hour_ago]
    words += ["--despite-findings"]
    key = folder / "alice.key"
    assert vfplan_cli("sign", folder / "a.h5", "--key", key, *words, "-o", folder / "s.h5").sound
    return folder


@pytest.fixture
def at_desk(vfplan_cli, desk):
    return partial(vfplan_cli, cwd=desk)


def test_the_private_key_is_its_owners_alone_and_no_key_is_lost(desk, at_desk):
    assert stat.S_IMODE(os.stat(desk / "alice.key").st_mode) == 0o600
    before = (desk / "alice.key").read_bytes()
    assert at_desk("keygen", "-o", "alice.key").code == 2
    assert (desk / "alice.key").read_bytes() == before


def test_a_signed_bundle_that_is_signed_again_stays_for_its_case(at_desk):
    words = ["--key", "mallory.key", "--despite-findings", "-o", "again.h5", "--json"]
    again = at_desk("sign", "s.h5", *words).sound
    assert (again.json["case"], again.json["robot_serial"]) == ("C1", "R7")
    other = at_desk("sign", "s.h5", *words, "--overwrite", "--case", "C2").sound
    assert (other.json["case"], other.json["robot_serial"]) == ("C2", "R7")
    # `diff` compares no signatures, and says how they differ.
    told = at_desk("diff", "a.h5", "again.h5").sound.stdout
    key = again.json["key_id"]
    assert f"A is not signed, B is signed by key {key}, for case 'C2', for robot" in told


def test_verify_names_the_key(desk, at_desk):
    words = ["--case", "C1", "--robot-serial", "R7", "--max-age", "2h"]
    run = at_desk("verify", "s.h5", "--keys", "alice.pub", *words, "--json").sound
    assert run.json["ok"]
    assert bytes.fromhex(run.json["key_id"]) in read_keys(desk / "alice.pub")
    assert (run.json["case"], run.json["robot_serial"]) == ("C1", "R7")
    # What it renders and who approved it, in one line.
    stiffness = "1000 N/m along x, 1000 along y, 800 along z"
    assert run.json["renders"].startswith(f"wall, {stiffness}, 5.00 mm, along (")
    assert run.json["renders"].endswith("approved by nobody")


@pytest.mark.parametrize("words, names", [
    ((), ["case", "robot_serial"]), (("--case", "C1"), ["robot_serial"]),
    (("--robot-serial", "R7"), ["case"]), (("--case", "C1", "--robot-serial", "R7"), []),
])  # fmt: skip
def test_what_was_compared_with_nothing_is_said(words, names, at_desk):
    run = at_desk("verify", "s.h5", "--keys", "alice.pub", *words, "--json").sound
    assert (run.json["not_compared"], len(run.json.get("warnings", []))) == (names, len(names))


@pytest.mark.parametrize("file, keys, words, kind, reason", [
    ("a.h5", "alice.pub", [], "SignatureError", "not signed"),
    ("s.h5", "alice.pub", ["--case", "C2"], "SignatureError", "C1"),
    ("s.h5", "alice.pub", ["--robot-serial", "R8"], "SignatureError", "R7"),
    ("s.h5", "alice.pub", ["--max-age", "30min"], "SignatureError", "s ago"),
    ("s.h5", "alice.pub", ["--max-age", "soon"], "UsageError", "30min"),
    ("s.h5", "mallory.pub", [], "SignatureError", "not trusted"),
    ("s.h5", "none.pub", [], "InputError", "error: "),
    ("s.h5", "a.h5", [], "InputError", "error: "),
    ("s.h5", "alice.key", [], "InputError", "begins a private key"),
])  # fmt: skip
def test_what_was_not_approved_is_refused_and_why(file, keys, words, kind, reason, at_desk):
    code = {"SignatureError": 4, "InputError": 3, "UsageError": 2}[kind]
    run = at_desk("verify", file, "--keys", keys, *words, "--json").fails(code, reason)
    assert run.json["error"]["kind"] == kind


def test_several_trusted_keys_stand_in_one_file(desk):
    both = desk / "both.pub"
    both.write_bytes((desk / "mallory.pub").read_bytes() + (desk / "alice.pub").read_bytes())
    assert len(read_keys(both)) == 2
    assert read_bundle(desk / "s.h5", trust=Trust(read_keys(both)))[1]["signed"]


def test_a_long_case_token_makes_a_longer_seal_that_plain_tools_ignore(desk, at_desk):
    import h5py

    token = "c" * 700
    words = ["--key", "alice.key", "--case", token, "--despite-findings", "-o", "long.h5"]
    assert at_desk("sign", "a.h5", *words, "--overwrite").sound
    assert read_bundle(desk / "long.h5")[1]["case"] == token
    with h5py.File(desk / "long.h5") as file:
        assert (file.userblock_size, file["points"].shape) == (0, (70, 3))
    assert len((desk / "long.h5").read_bytes()) - len((desk / "a.h5").read_bytes()) == 512
    vfplan.read_fixture(desk / "long.h5")


@pytest.mark.parametrize("words", [
    ["--registered-at", "yesterday"], ["--registered-at", "2026-01-01T00:00:00"],
    ["--registered-at", "2999-01-01T00:00:00Z"], ["--registered-at", "1970-01-01T00:00:00Z"],
    ["--registered-at", "9999-12-31T23:59:59-05:00"],
    ["--case", "c" * 5000], ["--case", "a\nb"],
])  # fmt: skip
def test_what_cannot_be_signed_is_refused_and_nothing_written(words, desk, at_desk):
    words = [*words, "--key", "alice.key", "--despite-findings", "-o", "none.h5"]
    at_desk("sign", "a.h5", *words).fails(2, "error: ")
    assert not (desk / "none.h5").exists()


@pytest.mark.parametrize("given, says", [
    *(({"keys": {}, "max_age": age}, "maximum age") for age in (float("nan"), float("inf"), -1.0)),
    *(({"keys": keys}, "read_keys") for keys in ("alice.pub", [], None, {"alice": 1})),
])  # fmt: skip
def test_keys_that_are_none_and_an_age_that_nothing_exceeds_are_refused(given, says):
    with pytest.raises(SettingError, match=says):
        Trust(**given)


@pytest.mark.parametrize("trust", ["alice.pub", {}, []])
def test_what_is_no_trust_is_refused(trust, desk):
    with pytest.raises(SettingError, match="Trust"):
        vfplan.read_fixture(desk / "s.h5", trust=trust)


def test_a_bundle_for_nobody_in_particular_is_not_for_this_case_or_robot(desk):
    anyone = desk / "anyone.h5"
    sign(desk / "a.h5", anyone, desk / "alice.key", despite_findings=True)
    keys = read_keys(desk / "alice.pub")
    assert vfplan.read_fixture(anyone, trust=Trust(keys))
    with pytest.raises(SignatureError, match="no particular robot"):
        vfplan.read_fixture(anyone, trust=Trust(keys, robot_serial="R7"))
    with pytest.raises(SignatureError, match="no particular case"):
        vfplan.read_fixture(anyone, trust=Trust(keys, case="C1"))


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o666])
def test_a_private_key_that_others_can_read_signs_nothing(mode, desk, at_desk, tmp_path):
    key = tmp_path / "open.key"
    key.write_bytes((desk / "alice.key").read_bytes())
    key.chmod(mode)
    words = ["sign", "a.h5", "--key", key, "--despite-findings", "-o", tmp_path / "x.h5"]
    at_desk(*words).fails(3, f"{mode:04o}")
    assert not (tmp_path / "x.h5").exists()
    key.chmod(0o400)
    assert at_desk(*words).sound


@pytest.mark.parametrize("name", BESIDE)
def test_a_file_of_keys_holds_keys_and_comments_only(name, tmp_path):
    path, reason = keys_beside(name, tmp_path), BESIDE[name][1]
    if reason is None:
        assert len(read_keys(path)) == 1
    else:
        with pytest.raises(InputError, match=reason):
            read_keys(path)


def test_a_public_key_in_place_of_the_private_one_is_told_as_that(at_desk, tmp_path):
    words = ("--key", "alice.pub", "-o", tmp_path / "s.h5", "--json")
    at_desk("sign", "a.h5", *words).fails(3, error="public-key")


def test_keygen_leaves_the_public_half_of_another_key(vfplan_cli, tmp_path):
    assert vfplan_cli("keygen", "-o", tmp_path / "bob.key").sound
    public = (tmp_path / "bob.pub").read_bytes()
    vfplan_cli("keygen", "-o", tmp_path / "bob", "--json").fails(2, error="public-key-exists")
    assert (tmp_path / "bob.pub").read_bytes() == public
    assert not (tmp_path / "bob").exists()
