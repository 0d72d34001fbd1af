"""`Finding`: what a person should look at before the plan is used.

Every stage that doubts something says so with one finding. A finding travels in the fixture bundle
until a person has answered it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

Severity = Literal["note", "doubt"]


@dataclass(frozen=True)
class Finding:
    """One thing that a person should look at.

    Parameters
    ----------
    code
        A stable name, such as "end-other-colour". The same kind of finding always has the same
        code, whatever the wording.
    severity
        A "note" informs. A "doubt" wants an answer before the bundle may be signed.
    text
        One or two short sentences: what was found, and what to do about it.
    stage
        The step that found it: "extract", "register", "plan" or "surface".
    place_px
        (u, v) on the slice [px]; `None` where the finding has no place there.
    place_m
        (x, y, z) in the frame of the fixture [m]; `None` where the finding has no place there.
    answered_by
        Who accepted it; `None` while nobody has.
    answered_utc
        When it was accepted, as "2026-01-31T12:00:00Z"; `None` while nobody has.
    """

    code: str
    severity: Severity
    text: str
    stage: str
    place_px: tuple[float, float] | None = None
    place_m: tuple[float, float, float] | None = None
    answered_by: str | None = None
    answered_utc: str | None = None

    @property
    def is_open(self) -> bool:
        """Whether it is a doubt that nobody has answered."""
        return self.severity == "doubt" and self.answered_by is None

    def as_dict(self) -> dict[str, Any]:
        """The finding as `--json` reports it."""
        return asdict(self)

    def __str__(self) -> str:
        return self.text


Findings = tuple[Finding, ...]


def acceptance(by: str, utc: str) -> str:
    """What people read behind a finding that somebody answered: the plan stays as it is."""
    return f" (accepted as it is by {by}, {utc})"


def doubt(code: str, stage: str, text: str, **place: Any) -> Finding:
    """A finding that wants an answer; `place` is `place_px` or `place_m`."""
    return Finding(code, "doubt", text, stage, **place)


def note(code: str, stage: str, text: str, **place: Any) -> Finding:
    """A finding that only informs; `place` is `place_px` or `place_m`."""
    return Finding(code, "note", text, stage, **place)
