"""The digest of a sheet, and acceptance by it: of the plan that was seen, each doubt answered."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace

import bundles
import numpy as np
import pytest
from refusals import refuses

from vfplan.bundle import review_digest
from vfplan.bundle.read import read_fixture
from vfplan.errors import CheckFailed
from vfplan.findings import doubt, note
from vfplan.fixture import Review
from vfplan.review.rendered import accept, digest_of

LEFT_OUT = {"created_utc", "software", "history", "reviewed"}

FINDING = doubt("ink-left", "extract", "Ink is left.", place_px=(3.0, 4.0))


def changes(value, path=""):
    """(where, the same thing with one value changed) for every value of a nested record."""
    for field in fields(value):
        part = getattr(value, field.name)
        if field.name in LEFT_OUT or part is None or (isinstance(part, tuple) and not part):
            continue
        where = f"{path}.{field.name}"
        if is_dataclass(part):
            for inner, changed in changes(part, where):
                yield inner, replace(value, **{field.name: changed})
        else:
            yield where, replace(value, **{field.name: changed_value(part)})


def changed_value(value):
    if isinstance(value, np.ndarray):
        changed = value.copy()
        flat = changed.reshape(-1)
        flat[-1] = not flat[-1] if changed.dtype == bool else np.nextafter(flat[-1], 9e9)
        if changed.dtype.kind in "iu":
            flat[-1] += 1
        return changed
    if isinstance(value, str):
        return value + "x"
    if isinstance(value, dict):
        return {**value, "another": "1"}
    if isinstance(value, tuple):
        return (*value[:-1], changed_value(value[-1]))
    return np.nextafter(value, 9e9) if isinstance(value, float) else value + 1


@pytest.mark.parametrize("name", ["whole", "guided", "sheet", "patient"])
def test_any_change_of_content_changes_it_and_writing_does_not(name, tmp_path):
    fixture = getattr(bundles, name)()
    assert digest_of(read_fixture(bundles.stored(tmp_path / "f.h5", fixture))) == digest_of(fixture)
    seen = {digest_of(fixture): "the fixture itself"}
    for where, changed in changes(fixture):
        digest = digest_of(changed)
        assert digest not in seen, (where, seen[digest])
        seen[digest] = where
    assert len(seen) > 8


def test_findings_count_and_answers_do_not():
    def digest(*findings):
        return digest_of(replace(bundles.whole(), findings=findings))

    bare, asked = digest(), digest(FINDING)
    assert bare != asked
    assert asked != digest(replace(FINDING, text="Other ink is left."))
    assert asked != digest(replace(FINDING, place_px=(3.0, 5.0)))
    answered = replace(FINDING, answered_by="A", answered_utc="2026-01-02T03:04:05Z")
    assert asked == digest(answered)
    review = Review("A", "2026-01-02T03:04:05Z", "0" * 64)
    assert bare == digest_of(replace(bundles.whole(), reviewed=review))


def test_sheet_without_its_slice_has_another_and_that_of_tomorrow_the_same():
    fixture = bundles.whole()
    assert digest_of(fixture) != digest_of(fixture, slice_shown=False)
    # A mesh was drawn on no slice.
    assert digest_of(bundles.sheet()) == digest_of(bundles.sheet(), slice_shown=False)
    # Time and program do not change it.
    changed = {"created_utc": "2031-01-01T00:00:00Z", "software": "vfplan 9", "history": ("moved",)}
    later = replace(fixture.provenance, **changed)
    assert digest_of(replace(fixture, provenance=later)) == digest_of(fixture)


FINDINGS = (
    FINDING,
    doubt("end-other-colour", "extract", "The end has another colour."),
    note("extrapolated", "register", "A part lies beyond the markers."),
)


def test_every_doubt_is_answered_with_name_and_time(monkeypatch, tmp_path):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    given = replace(bundles.whole(), findings=FINDINGS)
    digest = digest_of(given)
    with refuses(CheckFailed, "findings-unanswered", unanswered=["end-other-colour"]):
        accept(given, digest, "A", answers=["ink-left"])
    for other in ("", digest[:-1]):
        with refuses(CheckFailed, "digest-other"):
            accept(given, other, "A", answer_all=True)
    accepted = accept(given, digest, "A. Surgeon", answer_all=True)
    assert not accepted.open_findings
    assert [f.answered_by for f in accepted.findings] == ["A. Surgeon", "A. Surgeon", None]
    assert accepted.findings[0].answered_utc == "2023-11-14T22:13:20Z"
    assert accepted.reviewed.by == "A. Surgeon"
    assert accepted.reviewed.digest == review_digest(accepted)
    # What was accepted is still the same plan, also after it was written.
    again = read_fixture(bundles.stored(tmp_path / "f.h5", accepted))
    assert (digest_of(again), again.reviewed) == (digest, accepted.reviewed)
    assert again.findings == accepted.findings


def test_answer_of_somebody_else_stays():
    before = replace(FINDINGS[0], answered_by="B", answered_utc="2026-01-02T03:04:05Z")
    given = replace(bundles.whole(), findings=(before, FINDINGS[1]))
    accepted = accept(given, digest_of(given), "A", answer_all=True)
    assert [f.answered_by for f in accepted.findings] == ["B", "A"]
