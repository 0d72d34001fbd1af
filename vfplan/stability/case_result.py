"""One case of a stability study: what was expected, and what was measured."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

Outcome = Literal["pass", "fail", "finding"]


@dataclass(frozen=True)
class CaseResult:
    """The result of one case.

    Parameters
    ----------
    case
        The name of the case; its parts are joined by "/".
    outcome
        "pass", "fail" or "finding". A finding is a failure of rule "paper". That rule is kept as it
        was published, and no robot renders it, so its failures do not fail the study.
    detail
        What was expected and what was measured, in words.
    limit, measured
        The stated bound and the figure that is held against it, both in `unit`. `None` where the
        case was refused.
    unit
        The unit of `limit` and `measured`.
    values
        Further figures by name. The unit is part of the name.
    """

    case: str
    outcome: Outcome
    detail: str
    limit: float | None = None
    measured: float | None = None
    unit: str = ""
    values: dict[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The result as `vfplan stability --json` reports it."""
        return {
            "case": self.case,
            "outcome": self.outcome,
            "detail": self.detail,
            "limit": self.limit,
            "measured": self.measured,
            "unit": self.unit,
            **self.values,
        }


def outcome_of(is_good: bool, rule: str = "robust") -> Outcome:
    """The outcome of a check of what `rule` did."""
    if is_good:
        return "pass"
    return "finding" if rule == "paper" else "fail"
