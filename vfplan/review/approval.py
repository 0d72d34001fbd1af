"""A person's approval, stored in the bundle: the answers, the name, the time and the digest."""

from __future__ import annotations

from dataclasses import replace

from vfplan.findings import Finding
from vfplan.fixture import Fixture
from vfplan.fixture import Review
from vfplan.io.files import now_utc
from vfplan.review.digest import digest_of


def approved(
    fixture: Fixture,
    findings: tuple[Finding, ...],
    by: str,
    steps_sha256: str,
    *,
    slice_shown: bool,
) -> Fixture:
    """The fixture with its findings answered, approved by a person now.

    The digest is that of the review sheet of the same bundle, so a sheet that is printed later
    shows whether it is the plan that was approved.
    """
    settings = {**fixture.provenance.settings, "review_steps_sha256": steps_sha256}
    provenance = replace(fixture.provenance, settings=settings)
    fixture = replace(fixture, provenance=provenance, findings=findings, reviewed=None)
    digest = digest_of(fixture, slice_shown=slice_shown)
    return replace(fixture, reviewed=Review(by, now_utc(), digest))
