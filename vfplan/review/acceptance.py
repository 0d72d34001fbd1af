"""A person's word on a plan, stored in its bundle: answers to findings, a name, and the digest."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from vfplan.errors import CheckFailed, SettingError
from vfplan.findings import doubt
from vfplan.fixture import Fixture, Review
from vfplan.io.files import now_utc
from vfplan.review.digest import digest_of


def accept(
    fixture: Fixture,
    digest: str,
    by: str,
    *,
    answers: Collection[str] = (),
    answer_all: bool = False,
) -> Fixture:
    """The fixture with its findings answered and its review.

    Parameters
    ----------
    fixture
        What is accepted.
    digest
        The digest on the sheet that was looked at: 64 hexadecimal digits.
    by
        Who looked at it.
    answers
        Codes of the findings that are answered.
    answer_all
        Every finding is answered.

    Raises
    ------
    CheckFailed
        The digest is that of another plan, or a doubt stays without an answer. If the sheet did not
        show the slice, the fixture gets the doubt "slice-not-shown", which wants an answer too.
    SettingError
        There is no name, or a code that no open finding has.
    """
    if not by.strip() or not by.isprintable():
        raise SettingError(
            f"The name {by!r} is empty or holds signs that cannot be printed. Say who looked at "
            "the sheet.",
            code="name-missing",
        )
    if not is_digest_of(fixture, digest):
        raise CheckFailed(
            "This digest is not that of the bundle: the sheet that was looked at shows another "
            "plan. Draw the sheet of this bundle and look at it: vfplan review FIXTURE.h5 --slice "
            "IMAGE --sheet-out SHEET.png.",
            code="digest-other",
            numbers={"given": digest, "expected": digest_of(fixture)},
        )
    if digest.lower() != digest_of(fixture):
        fixture = without_slice(fixture)
        digest = digest_of(fixture, slice_shown=False)
    open_codes = {finding.code for finding in fixture.open_findings}
    unknown = sorted(set(answers) - open_codes)
    if unknown:
        raise SettingError(
            f"No open finding has the code {unknown[0]!r}. Open are: "
            f"{', '.join(sorted(open_codes)) or 'none'}.",
            code="answer-unknown",
            numbers={"unknown": unknown, "open": sorted(open_codes)},
        )
    now = now_utc()
    findings = []
    for finding in fixture.findings:
        if finding.is_open and (answer_all or finding.code in answers):
            finding = replace(finding, answered_by=by, answered_utc=now)
        findings.append(finding)
    left = sorted({finding.code for finding in findings if finding.is_open})
    if left:
        raise CheckFailed(
            f"These findings have no answer: {', '.join(left)}. Answer each with --answer CODE, or "
            "all with --answer-all.",
            code="findings-unanswered",
            numbers={"unanswered": left},
        )
    return replace(fixture, findings=tuple(findings), reviewed=Review(by, now, digest.lower()))


def without_slice(fixture: Fixture) -> Fixture:
    """The fixture with the doubt that nobody saw its line on the slice."""
    if any(finding.code == "slice-not-shown" for finding in fixture.findings):
        return fixture
    text = (
        "The sheet did not show the slice, so neither the line's ends nor other ink could be seen. "
        "Look at a sheet with the slice: vfplan review FIXTURE.h5 --slice IMAGE --sheet-out PNG."
    )
    return replace(fixture, findings=(*fixture.findings, doubt("slice-not-shown", "review", text)))


def is_digest_of(fixture: Fixture, digest: str) -> bool:
    """Whether a digest is that of the fixture's sheet, with its slice or without."""
    with_slice = digest_of(fixture)
    return digest.lower() in (with_slice, digest_of(fixture, slice_shown=False))
