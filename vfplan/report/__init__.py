"""One self-contained HTML page about a replay: no network, no other file needed."""

from __future__ import annotations

from vfplan.report.page import write_report

__all__ = ["write_report"]
