"""Acceptance: only of the plan that was seen, with every doubt answered by somebody."""

from __future__ import annotations

from dataclasses import replace

import bundles
import numpy as np
from refusals import refuses

from vfplan.bundle import review_digest
from vfplan.bundle.read import read_fixture
from vfplan.bundle.write import write_fixture
from vfplan.errors import CheckFailed, SettingError
from vfplan.findings import doubt, note
from vfplan.review.rendered import accept, digest_of

FINDINGS = (
    doubt("ink-left", "extract", "Ink is left.", place_px=(3.0, 4.0)),
    doubt("end-other-colour", "extract", "The end has another colour."),
    note("extrapolated", "register", "A part lies beyond the markers."),
)


def fixture():
    return replace(bundles.whole(), findings=FINDINGS)


def test_every_doubt_is_answered_with_name_and_time(monkeypatch, tmp_path):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    digest = digest_of(fixture())
    accepted = accept(fixture(), digest, "A. Surgeon", answer_all=True)
    assert not accepted.open_findings
    assert [f.answered_by for f in accepted.findings] == ["A. Surgeon", "A. Surgeon", None]
    assert accepted.findings[0].answered_utc == "2023-11-14T22:13:20Z"
    assert accepted.reviewed.by == "A. Surgeon"
    assert accepted.reviewed.digest == review_digest(accepted)
    # What was accepted is still the same plan, also after it was written.
    write_fixture(accepted, tmp_path / "f.h5")
    again = read_fixture(tmp_path / "f.h5")
    assert digest_of(again) == digest
    assert again.reviewed == accepted.reviewed
    assert again.findings == accepted.findings


def test_answers_go_by_code():
    given, digest = fixture(), digest_of(fixture())
    with refuses(CheckFailed, "findings-unanswered", unanswered=["end-other-colour"]):
        accept(given, digest, "A", answers=["ink-left"])
    accepted = accept(given, digest, "A", answers=["ink-left", "end-other-colour"])
    assert not accepted.open_findings
    with refuses(SettingError, "answer-unknown"):
        accept(given, digest, "A", answers=["extrapolated"], answer_all=False)


def test_answer_of_somebody_else_stays():
    before = replace(FINDINGS[0], answered_by="B", answered_utc="2026-01-02T03:04:05Z")
    given = replace(bundles.whole(), findings=(before, FINDINGS[1]))
    accepted = accept(given, digest_of(given), "A", answer_all=True)
    assert [f.answered_by for f in accepted.findings] == ["B", "A"]


def test_digest_of_another_plan_is_refused():
    given = fixture()
    points = given.points.copy()
    points[0, 0] = np.nextafter(points[0, 0], 1)
    other = digest_of(replace(given, points=points))
    for digest in (other, "", "0" * 64, digest_of(given)[:-1]):
        with refuses(CheckFailed, "digest-other"):
            accept(given, digest, "A", answer_all=True)
