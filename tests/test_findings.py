"""Findings: which of them are open, and how `--json` reports them."""

import json

import pytest

from vfplan.findings import Finding, doubt, note

DOUBT = doubt("end-unsure", "extract", "The end is known to 2 px only.", place_px=(12.5, 40.0))
KEYS = {
    "code",
    "severity",
    "text",
    "stage",
    "place_px",
    "place_m",
    "answered_by",
    "answered_utc",
}


def test_a_doubt_is_open_until_somebody_answers_it():
    assert DOUBT.is_open
    answered = Finding(**{**DOUBT.as_dict(), "answered_by": "A. Surgeon"})
    assert not answered.is_open


def test_a_note_is_never_open():
    assert not note("bridge-short", "extract", "A gap of 6 px is bridged.").is_open


def test_its_text_is_its_string():
    assert str(DOUBT) == "The end is known to 2 px only."


@pytest.mark.parametrize(
    "finding",
    [DOUBT, note("side", "register", "The slice is seen from above.", place_m=(0.1, 0.2, 0.3))],
)
def test_json_has_the_keys_that_scripts_rely_on(finding):
    reported = json.loads(json.dumps(finding.as_dict()))
    assert set(reported) == KEYS
    assert reported["severity"] in ("note", "doubt")
    assert reported["answered_by"] is None
    for name in ("place_px", "place_m"):
        place = getattr(finding, name)
        assert reported[name] == (None if place is None else list(place))


def test_a_finding_cannot_be_changed():
    with pytest.raises(AttributeError):
        DOUBT.severity = "note"
