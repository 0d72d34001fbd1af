"""What is rendered is what was approved: the review digest, the case, and one geometry."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import bundles
import numpy as np
import pytest
from conftest import ROOT, file_with
from refusals import refuses

import vfplan
from vfplan.bundle import rendered_values, review_digest
from vfplan.bundle.content import FIELDS, from_content, table, to_content
from vfplan.bundle.seal import keygen, sign
from vfplan.bundle.validation import validate
from vfplan.bundle.write import completed
from vfplan.conformance import fixtures, vectors
from vfplan.conformance.kit import trusted_key
from vfplan.errors import CheckFailed, SettingError, VfplanError
from vfplan.robot import Robot
from vfplan.stability.study import with_verdict

RENDERED = {row.path for row in table() if row.mark == "rendered"}


def whole_guide():
    """A guide that says all that one can say."""
    more = {"ends": "open", "lead_force": 1.0, "lead_speed": 0.03}
    return replace(fixtures.guided(), guidance=replace(fixtures.guided().guidance, **more))


def limited_cloud():
    cloud = fixtures.cloud()
    return replace(cloud, rendering=replace(cloud.rendering, max_iterations=9))


MADE = {
    "curve": fixtures.pieces, "guide": whole_guide, "mesh": fixtures.mesh, "cloud": limited_cloud,
    "surface": fixtures.drawn_mesh,
}  # fmt: skip


def other(path, value):
    """Another value that may stand at this path; any other number is one in the last place."""
    texts = {"/@frame": "patient_lps", "/guidance@ends": "stop"}
    if path in texts:
        return texts[path]
    changed = np.array(value)
    last = changed.reshape(-1)[-1:]
    if changed.dtype == np.uint8:
        last ^= 1
    else:
        last[:] = last + 1 if changed.dtype.kind == "i" else np.nextafter(last, last + 1)
    return changed if isinstance(value, np.ndarray) else changed.item()


def test_a_review_dies_with_any_rendered_value(tmp_path):
    tried = set()
    for name, make in MADE.items():
        approved = fixtures.approved(make())
        vfplan.write_fixture(approved, tmp_path / f"{name}.h5")
        content = to_content(approved)
        for path in content.keys() & RENDERED:
            changed = from_content(content | {path: other(path, content[path])})
            assert review_digest(changed) != approved.reviewed.digest, path
            with pytest.raises(VfplanError):
                vfplan.write_fixture(changed, tmp_path / "changed.h5")
            anew = vectors.of_content(completed(to_content(changed)))
            codes = [issue.code for issue in validate(anew)]
            # What is wrong in itself is not compared with the review.
            assert "unsafe.review" in codes or "leak.unchecked" in codes, (path, codes)
            tried.add(path)
    assert tried == RENDERED
    assert not (tmp_path / "changed.h5").exists()


def test_a_review_covers_registration_findings_answers_and_case():
    findings = replace(fixtures.findings(), case="case 17")
    seen = {review_digest(findings)}
    paths = {row.path for row in table() if row.mark == "reviewed"}
    for path, value in to_content(findings).items():
        if path in paths and isinstance(value, np.ndarray):
            seen.add(review_digest(from_content(to_content(findings) | {path: other(path, value)})))
    answered = [replace(f, answered_by="B", answered_utc=fixtures.TIME) for f in findings.findings]
    seen.add(review_digest(replace(findings, findings=tuple(answered))))
    seen.add(review_digest(replace(findings, case="case 18")))
    assert len(seen) == 11
    # Neither who reviewed it nor when it was made.
    assert review_digest(fixtures.approved(findings)) in seen
    assert review_digest(replace(findings, provenance=bundles.PROVENANCE)) in seen


def test_text_and_numbers_never_encode_alike():
    """Eight letters, and the number whose bytes are these letters."""
    letters = b"eight.ok"
    number = float(np.frombuffer(letters, "<f8")[0])
    base = to_content(fixtures.registered())
    digests = {review_digest(from_content(base | {path: value})) for path, value in (
        ("/registration@tre_rms_m", number), ("/registration@model", letters.decode()),
    )}  # fmt: skip
    assert len(digests) == 2


def test_the_marked_rows_are_what_an_engine_reads():
    """By the source of what `Engine(fixture)` is made of."""
    include = ROOT / "vfplan" / "native" / "include" / "vfplan" / "bundle"
    source = (include / "fixture.hpp").read_text()
    start, end = source.index("guidance_of(const Content"), source.rindex("Fixture read_fixture(")
    source = source[start:end]
    content = (include / "content.hpp").read_text()
    source += content[content.index("strokes_of(const Content") :]
    read = {path for path in re.findall(r'"(/[^"]+)"', source) if re.search("[@/].", path[1:])}
    beside = {"/@id", "/@case", "/provenance@created_utc", "/leak@certified", "/registration@tool"}
    read |= {path for path in re.findall(r'"(/@?\w+)"', source) if path in FIELDS}
    assert read - beside - {"/sigma", "/review", "/findings"} == RENDERED
    values = rendered_values(whole_guide())
    assert values.pop("kind") == "guide"
    assert values.keys() == to_content(whole_guide()).keys() & RENDERED


@pytest.mark.parametrize("command", ["validate", "info", "verify", "sign", "replay"])
def test_every_command_refuses_a_review_of_another_plan(command, vfplan_cli, tmp_path, monkeypatch):
    path, key = tmp_path / "f.h5", tmp_path / "k.pem"
    keygen(key)
    lying = replace(fixtures.reviewed(), case="case 17")
    monkeypatch.setattr(fixtures, "lying", lambda: lying, raising=False)
    path.write_bytes(vectors.signed("lying", False))
    words = {"verify": ["--keys", file_with(tmp_path / "k.pub", trusted_key())],
             "sign": ["--key", key, "-o", tmp_path / "s.h5"],
             "replay": [ROOT / "samples" / "elbow_session.csv"]}  # fmt: skip
    run = vfplan_cli(command, path, *words.get(command, []), "--json")
    assert run.code == 4
    assert "unsafe.review" in json.dumps(run.json)
    assert not (tmp_path / "s.h5").exists()


def test_a_verdict_drops_the_review():
    approved = fixtures.approved(fixtures.cloud())
    robot = Robot("arm", mass_kg=4.0, damping_n_s_per_m=40.0, rate_hz=1000.0)
    assert with_verdict(approved, robot).reviewed is None


def test_a_bundle_is_signed_for_its_own_case(tmp_path):
    keygen(tmp_path / "k.pem")
    vfplan.write_fixture(fixtures.of_a_case(), tmp_path / "f.h5")
    with refuses(CheckFailed, "case-other"):
        sign(tmp_path / "f.h5", tmp_path / "s.h5", tmp_path / "k.pem", case="case 19")
    for number, words in enumerate(({}, {"case": "case 18"})):
        seal = sign(tmp_path / "f.h5", tmp_path / f"{number}.h5", tmp_path / "k.pem", **words)
        assert seal["case"] == "case 18"


def test_a_case_can_be_read_off_a_page(tmp_path):
    with pytest.raises(VfplanError, match="/@case"):
        vfplan.write_fixture(replace(fixtures.minimal(), case="7\u00a0"), tmp_path / "f.h5")
    vfplan.write_fixture(replace(fixtures.minimal(), case="Fall 17 ä 第"), tmp_path / "f.h5")
    assert vfplan.read_fixture(tmp_path / "f.h5").case == "Fall 17 ä 第"


def test_pieces_may_leave_the_points_by_1_percent_of_the_radius(tmp_path):
    made = bundles.drawn()

    def moved(step):
        vertices = made.pieces.vertices + np.array([0.0, step, 0.0])
        drawn = replace(made.pieces, vertices=vertices, error=4.05e-5)
        return replace(made, curve=replace(made.curve, pieces=drawn))

    vfplan.write_fixture(moved(4e-5), tmp_path / "f.h5")
    with refuses(SettingError, "unsafe.pieces"):
        vfplan.write_fixture(moved(4.2e-5), tmp_path / "g.h5")
