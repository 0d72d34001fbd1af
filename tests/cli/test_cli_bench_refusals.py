"""`vfplan bench`: what it refuses."""

import sys

import pytest


@pytest.mark.parametrize(("arguments", "code"), [
    (("paint",), 2),
    (("extract", "--tolerance", "0"), 2),
    (("proxy", "--quick", "--peer", "/nowhere/peer"), 2),
    (("--from", "/nowhere/bench.json"), 3),
    (("extract", "-o", "/nowhere/at/all"), 2),
    (("extract", "--peer", "true"), 2),
    (("--from", "bench.json", "--quick"), 2),
    (("--from", "bench.json", "--tolerance", "0.01"), 2),
])  # fmt: skip
def test_errors_are_one_line_with_their_code(vfplan_cli, arguments, code):
    run = vfplan_cli("bench", *arguments, "--json").fails(code)
    assert run.json["error"]["message"]
    assert run.error_line


def test_a_failing_peer_leaves_nothing_behind(vfplan_cli, tmp_path):
    peer = tmp_path / "peer.py"
    peer.write_text("raise SystemExit('no')")
    out = tmp_path / "out"
    vfplan_cli("bench", "proxy", "--quick", "--peer", f"{sys.executable} {peer}", "-o",
               out).fails(2, "exit code 1: no")  # fmt: skip
    assert not out.exists()
