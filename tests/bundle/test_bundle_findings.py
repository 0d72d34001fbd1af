"""What planning found and who looked at it: in the file, and before a signature."""

from __future__ import annotations

import bundles
import pytest
from refusals import refuses

import vfplan
from vfplan.bundle.seal import keygen, sign
from vfplan.bundle.validation import describe, validate
from vfplan.errors import CheckFailed
from vfplan.io.files import to_json_types


@pytest.fixture
def key(tmp_path):
    keygen(tmp_path / "key")
    return tmp_path / "key"


def test_info_validate_and_verify_show_findings_and_review(vfplan_cli, key, tmp_path):
    vfplan.write_fixture(bundles.doubtful(), tmp_path / "a.h5")
    info = vfplan_cli("info", tmp_path / "a.h5", "--json").json
    assert info["findings"] == to_json_types([finding.as_dict() for finding in bundles.FINDINGS])
    assert info["reviewed"] is None
    issues = {i.code: i.severity for i in validate(tmp_path / "a.h5")}
    assert issues["end-other-colour"] == issues["tick-too-long"] == "warning"
    assert issues["bridge-short"] == issues["marker-suspect"] == "note"
    assert issues["review.missing"] == "note"
    words = ["--key", key, "--case", "C 1", "--robot-serial", "R7", "--despite-findings"]
    assert vfplan_cli("sign", tmp_path / "a.h5", *words, "-o", tmp_path / "s.h5").sound
    run = vfplan_cli("verify", tmp_path / "s.h5", "--keys", f"{key}.pub", "--json")
    assert run.json["despite_findings"]
    assert len(run.json["findings"]) == 4
    for command in (["info"], ["verify", "--keys", f"{key}.pub"]):
        text = vfplan_cli(command[0], tmp_path / "s.h5", *command[1:]).stdout
        for part in ("C 1", "R7", run.json["signed_utc"], "end-other-colour", "not answered"):
            assert part in text
        assert "(accepted as it is by A. Planner, " in text


UNANSWERED = ("findings-unanswered", ["end-other-colour", "tick-too-long"])
OPEN = [(bundles.doubtful, *UNANSWERED), (bundles.whole, "not-reviewed", None)]


@pytest.mark.parametrize("make, code, codes", OPEN)
def test_what_is_open_or_not_reviewed_is_signed_only_when_told(make, code, codes, key, tmp_path):
    vfplan.write_fixture(make(), tmp_path / "a.h5")
    with refuses(CheckFailed, code) as raised:
        sign(tmp_path / "a.h5", tmp_path / "s.h5", key)
    assert raised.value.numbers.get("codes") == codes
    approved = tmp_path / "a-approved.h5"
    page = f"vfplan review {tmp_path / 'a.h5'} --slice {tmp_path} -o {approved}"
    assert page in raised.value.message
    assert not (tmp_path / "s.h5").exists()
    signed = sign(tmp_path / "a.h5", tmp_path / "s.h5", key, despite_findings=True)
    assert signed["despite_findings"]
    assert describe(tmp_path / "s.h5")["seal"]["despite_findings"]


@pytest.mark.parametrize("despite", [False, True])
def test_what_is_answered_and_reviewed_is_signed_without_a_mark(despite, key, tmp_path):
    vfplan.write_fixture(bundles.reviewed(), tmp_path / "a.h5")
    signed = sign(tmp_path / "a.h5", tmp_path / "s.h5", key, despite_findings=despite)
    assert "despite_findings" not in signed
    assert vfplan.read_fixture(tmp_path / "s.h5").reviewed == bundles.reviewed().reviewed
