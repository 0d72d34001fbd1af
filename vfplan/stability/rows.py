"""One line of a stability report: what was expected, what was found."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

Outcome = Literal["pass", "fail", "finding"]


@dataclass(frozen=True)
class Row:
    """One case.

    Parameters
    ----------
    case
        Its name, parts joined by "/".
    outcome
        "pass"; "fail"; or "finding": rule `paper` did what no fixture should do. The paper's rule
        is kept as published, so its findings inform and do not fail the study.
    detail
        What was expected and what was found, in words.
    limit, measured
        The stated bound and the figure held against it; `None` where the case is a refusal.
    unit
        Of both.
    values
        Further figures by name.
    """

    case: str
    outcome: Outcome
    detail: str
    limit: float | None = None
    measured: float | None = None
    unit: str = ""
    values: dict[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """As the command's JSON holds it."""
        head = {name: getattr(self, name) for name in ("case", "outcome", "detail")}
        numbers = {"limit": self.limit, "measured": self.measured, "unit": self.unit}
        return {**head, **numbers, **self.values}


def verdict(good: bool, rule: str = "robust") -> Outcome:
    """The outcome of a check under a rule."""
    if good:
        return "pass"
    return "finding" if rule == "paper" else "fail"
