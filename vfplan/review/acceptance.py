"""A person's word on a plan, stored in its bundle: answers to findings, a name, and the digest.

The digest is 64 hexadecimal digits over what a review sheet shows: every value of the bundle, so
the SHA-256 of the slice too, and the findings. It does not cover when and by which program the
bundle was made, nor who answered a finding. So the same plan has the same digest tomorrow and after
its acceptance, and no other plan has it. What the bundle holds of the review is another digest,
`vfplan.bundle.review_digest`, which every reader computes again.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from vfplan.bundle.content import digest_of_content, review_digest, to_content
from vfplan.errors import CheckFailed, SettingError
from vfplan.findings import Finding, doubt
from vfplan.fixture import Fixture, Review
from vfplan.io.files import now_utc

# What changes although the plan does not.
LEFT_OUT = {"/provenance@created_utc", "/provenance@software", "/provenance/history"}

# Characters that Unicode counts as letters, marks or symbols and that show nothing.
INVISIBLE = {*"\u034f\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0", *map(chr, range(0xFE00, 0xFE10))}
INVISIBLE |= {*"\u180b\u180c\u180d\u180f", *map(chr, range(0xE0100, 0xE01F0))}

# Characters of a name at most, as a bundle holds them.
MAX_NAME = 64


def slice_not_shown() -> Finding:
    """The doubt of who looked at a plan without its slice."""
    text = (
        "The slice is not shown, so neither the line's ends nor other ink can be seen. Look at the "
        "bundle with its slice: vfplan review FIXTURE.h5 --slice IMAGE."
    )
    return doubt("slice-not-shown", "extract", text)


def visible_name(name: str) -> str:
    """A person's name without the blanks around it; refuses one that cannot be read as it is."""
    name = name.strip()
    is_visible = name.isprintable() and not INVISIBLE & set(name) and any(map(str.isalnum, name))
    if not is_visible or len(name) > MAX_NAME:
        raise SettingError(
            f"The name {name[:MAX_NAME]!a} is empty, longer than {MAX_NAME} characters, or holds "
            "signs that cannot be seen. Say who looks at the plan, in letters that show.",
            code="name-missing",
        )
    return name


def digest_of(fixture: Fixture, *, slice_shown: bool = True) -> str:
    """The digest of a fixture with its findings.

    Parameters
    ----------
    fixture
        The bundle's content.
    slice_shown
        Whether the sheet shows the slice that the curve was drawn on. A sheet without it has
        another digest: who saw that sheet has not seen the ends of the line.
    """
    unanswered = (replace(f, answered_by=None, answered_utc=None) for f in fixture.findings)
    content = to_content(replace(fixture, reviewed=None, findings=tuple(unanswered)))
    is_drawn = fixture.provenance.inputs.get("image") is not None
    title = "vfplan review sheet 2" + (", slice not shown" if is_drawn and not slice_shown else "")
    return digest_of_content(title, content, content.keys() - LEFT_OUT)


def accept(
    fixture: Fixture, digest: str, by: str, *, answers: Collection[str] = (),
    answer_all: bool = False,
) -> Fixture:  # fmt: skip
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
    by = visible_name(by)
    typed, digest, with_slice = digest, digest.lower(), digest_of(fixture)
    if digest not in (with_slice, digest_of(fixture, slice_shown=False)):
        raise CheckFailed(
            "This digest is not that of the bundle: the sheet that was looked at shows another "
            "plan. Draw the sheet of this bundle and look at it: vfplan review FIXTURE.h5 --slice "
            "IMAGE --sheet-out SHEET.png.",
            code="digest-other",
            numbers={"given": typed, "expected": with_slice},
        )
    is_asked = any(finding.code == "slice-not-shown" for finding in fixture.findings)
    if digest != with_slice and not is_asked:
        fixture = replace(fixture, findings=(*fixture.findings, slice_not_shown()))
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
    findings = tuple(
        replace(finding, answered_by=by, answered_utc=now)
        if finding.is_open and (answer_all or finding.code in answers)
        else finding
        for finding in fixture.findings
    )
    left = sorted({finding.code for finding in findings if finding.is_open})
    if left:
        message = (
            f"These findings have no answer: {', '.join(left)}. Answer each with --answer CODE, or "
            "all with --answer-all."
        )
        raise CheckFailed(message, code="findings-unanswered", numbers={"unanswered": left})
    accepted = replace(fixture, findings=findings, reviewed=None)
    return replace(accepted, reviewed=Review(by, now, review_digest(accepted)))
