"""What is wrong with a bundle: raised at the first when loading, listed in full when validating."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from vfplan.errors import BundleError, CorruptError, UnsafeError, VersionError


@dataclass(frozen=True)
class Issue:
    """One thing found in a bundle: where, a code for programs, how grave, and a sentence."""

    location: str
    code: str
    severity: Literal["error", "warning", "note"]
    message: str


KINDS: dict[str, type[BundleError]] = {
    "version": VersionError,
    "unsafe": UnsafeError,
    "corrupt": CorruptError,
}


@dataclass
class Findings:
    """Collects issues; a strict one raises the first error instead.

    Parameters
    ----------
    strict
        Raise at the first error (loading) or go on (validating).
    """

    strict: bool = True
    issues: list[Issue] = field(default_factory=list)

    def error(self, code: str, location: str, message: str) -> None:
        """Report an error; `code` begins with a key of `KINDS`, a dot and the detail."""
        if self.strict:
            kind = KINDS.get(code.partition(".")[0], BundleError)
            raise kind(message, where=location)
        self.issues.append(Issue(location, code, "error", message))

    def warning(self, code: str, location: str, message: str) -> None:
        """Report something that is probably a mistake but breaks no rule."""
        self.issues.append(Issue(location, code, "warning", message))

    def note(self, code: str, location: str, message: str) -> None:
        """Report something a person should know that does not make the bundle invalid."""
        self.issues.append(Issue(location, code, "note", message))

    @property
    def valid(self) -> bool:
        """Whether no error was found."""
        return not any(issue.severity == "error" for issue in self.issues)
