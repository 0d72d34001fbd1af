"""`vfplan accept`: a script approves by the digest on the sheet, and `sign` then has no doubts."""

from __future__ import annotations

from dataclasses import replace

import bundles
import pytest

from vfplan.bundle.read import read_fixture
from vfplan.findings import doubt, note

FINDINGS = (doubt("ink-left", "extract", "Ink is left.", place_px=(3.0, 4.0)),
            note("extrapolated", "register", "A part lies beyond the markers."))  # fmt: skip


@pytest.fixture
def sheet(vfplan_cli, tmp_path):
    """A mesh with a finding, and its digest as `review` says it."""
    path = bundles.stored(tmp_path / "f.h5", replace(bundles.sheet(), findings=FINDINGS))
    run = vfplan_cli("review", path, "--sheet-out", tmp_path / "s.png", "--json").sound
    return path, run.json["digest"]


def test_accepted_bundle_is_signed_without_despite_findings(vfplan_cli, sheet, tmp_path):
    path, digest = sheet
    key, accepted, signed = tmp_path / "k.pem", tmp_path / "a.h5", tmp_path / "s.h5"
    assert vfplan_cli("keygen", "-o", key).sound
    call = ("accept", path, "--digest", digest, "--by", "A. Surgeon", "-o", accepted)
    run = vfplan_cli(*call, "--answer", "ink-left", "--json").sound
    assert (run.json["answered"], run.json["digest"]) == (["ink-left"], digest)
    assert "vfplan: note: Ink is left." in run.stderr
    assert [f["answered_by"] for f in run.json["findings"]] == ["A. Surgeon", None]
    assert vfplan_cli("sign", accepted, "--key", key, "-o", signed).sound
    # The sheet of the accepted bundle has the same digest, and names who approved it.
    again = vfplan_cli("review", signed, "--sheet-out", tmp_path / "again.png", "--json")
    assert again.json["digest"] == digest
    assert "A. Surgeon" in again.json["verdict"]


@pytest.mark.parametrize("words, code, error", [
    (("--digest", "0" * 64, "--by", "A", "--answer-all"), 1, "digest-other"),
    (("--by", "A"), 1, "findings-unanswered"),
    (("--by", "A", "--answer", "ink-lost"), 2, "answer-unknown"),
    (("--by", "A", "--answer", "extrapolated"), 2, "answer-unknown"),
    (("--by", " ", "--answer-all"), 2, "name-missing"),
    (("--by", "A", "--answer", "ink-left", "--answer-all"), 2, None),
])  # fmt: skip
def test_a_wrong_call_or_an_open_finding_writes_nothing(words, code, error, vfplan_cli, sheet,
                                                        tmp_path):  # fmt: skip
    path, digest = sheet
    out = tmp_path / "a.h5"
    run = vfplan_cli("accept", path, "--digest", digest, *words, "-o", out, "--json")
    assert (run.code, run.json["error"].get("code")) == (code, error)
    assert not out.exists()


def test_a_sheet_without_its_slice_leaves_a_doubt_to_answer(vfplan_cli, tmp_path):
    path = bundles.stored(tmp_path / "f.h5", bundles.whole())
    run = vfplan_cli("review", path, "--sheet-out", tmp_path / "s.png", "--json")
    out = tmp_path / "a.h5"
    call = ("accept", path, "--digest", run.json["digest"], "--by", "A", "-o", out, "--json")
    vfplan_cli(*call).fails(1, error="findings-unanswered")
    done = vfplan_cli(*call, "--answer", "slice-not-shown").sound
    assert done.json["answered"] == ["slice-not-shown"]
    accepted = read_fixture(out)
    (finding,) = [f for f in accepted.findings if f.code == "slice-not-shown"]
    assert (accepted.reviewed.by, finding.answered_by) == ("A", "A")
